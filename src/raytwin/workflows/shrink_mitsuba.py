"""What can be taken out of a Mitsuba file: shapes, emitters, materials, bounces, most of the picture."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from raytwin import files
from raytwin.scene import MitsubaScene

DEPTHS = 2, 3, 4, 6, 8
"""Bounces that are tried, Mitsuba's max_depth, where fewer than the file's."""
GREY = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>'


@dataclass(frozen=True)
class FileScene:
    """A Mitsuba file on its way down."""

    scene: MitsubaScene

    file_name, rung = "scene.xml", ""

    @property
    def name(self) -> str:
        return self.scene.name

    @classmethod
    def begin(cls, scene: MitsubaScene, size: tuple[int, int] | None = None) -> "FileScene":
        """Give each emitter an id, so that it is called the same as others go."""
        root = ET.fromstring(scene.text)
        for i, element in enumerate(root.findall("emitter")):
            element.set("id", element.get("id") or f"{element.get('type')}-light-{i}")
        made = files.edited(scene, root)
        return cls(files.with_film(made, width=size[0], height=size[1]) if size else made)

    @property
    def key(self) -> bytes:
        return self.scene.text.encode()

    def placed(self, folder: Path) -> MitsubaScene:
        """The scene as a file in `folder`, for programs to read."""
        return files.write_mitsuba(self.scene, folder)

    @property
    def image_size(self) -> tuple[int, int]:
        return self.scene.image_size

    @property
    def count(self) -> int:
        """Shapes."""
        return len(self.scene.names)

    def parts(self) -> list[str]:
        root = ET.fromstring(self.scene.text)
        shapes = [shape.get("id", "") for shape in root.findall("shape")]
        lights = [light.get("id", "") for light in root.findall("emitter")]
        special = [f"the material of {shape.get('id')}" for shape in root.findall("shape") if _is_special(root, shape)]
        return [*shapes, *lights, *special]

    def only(self, kept: list[str]) -> "FileScene":
        """The file with these parts alone: grey and matt in the place of a material that goes."""
        root, keep = ET.fromstring(self.scene.text), set(kept)
        for element in [*root.findall("shape"), *root.findall("emitter")]:
            if element.get("id") not in keep:
                root.remove(element)
            elif f"the material of {element.get('id')}" not in keep and _is_special(root, element):
                for material in _materials(root, element):
                    element.remove(material)
                element.append(ET.fromstring(GREY))
        used = {ref.get("id") for ref in root.iter("ref")}
        for material in [*root.findall("bsdf"), *root.findall("texture")]:
            if material.get("id") not in used:
                root.remove(material)
        return FileScene(files.edited(self.scene, root))

    def resized(self, width: int, height: int) -> "FileScene":
        return FileScene(files.with_film(self.scene, width=width, height=height))

    def cropped(self, x: int, y: int, width: int, height: int) -> "FileScene":
        return FileScene(files.with_window(self.scene, x, y, width, height))

    def fewer_bounces(self) -> Iterator[tuple[str, "FileScene"]]:
        root = ET.fromstring(self.scene.text)
        integrator = root.find("integrator")
        if integrator is None:
            return
        depth = next((e for e in integrator.findall("integer") if e.get("name") == "max_depth"), None)
        if depth is None:
            depth = ET.SubElement(integrator, "integer", {"name": "max_depth", "value": "-1"})
        own = int(depth.get("value", "-1"))
        for fewer in DEPTHS:
            if own < 0 or fewer < own:
                depth.set("value", str(fewer))
                yield f"light beyond a max_depth of {fewer}", FileScene(files.edited(self.scene, root))

    def write(self, folder: Path, comment: str) -> Path:
        """Write scene.xml with the files that it still needs."""
        return Path(files.write_mitsuba(self.scene, folder, comment).file)


def _materials(root: ET.Element, shape: ET.Element) -> list[ET.Element]:
    """The shape's own <bsdf>, or the <ref> to one."""
    named = {material.get("id") for material in root.findall("bsdf")}
    return [*shape.findall("bsdf"), *(ref for ref in shape.findall("ref") if ref.get("id") in named)]


def _is_special(root: ET.Element, shape: ET.Element) -> bool:
    """Whether its material is more than one matt colour."""
    known = {material.get("id"): material for material in root.findall("bsdf")}
    for material in _materials(root, shape):
        whole = known.get(material.get("id")) if material.tag == "ref" else material
        kinds = {e.get("type") for e in whole.iter("bsdf")} if whole is not None else set()
        if kinds - {"diffuse", "twosided"} or (whole is not None and whole.find(".//texture") is not None):
            return True
    return False
