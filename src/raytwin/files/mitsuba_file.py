"""A Mitsuba scene file (XML): read and checked without Mitsuba, every file that it names found and hashed.

A stranger's scene must not reach for what is not its own: files outside its folder are refused unless allowed by name
(`RAYTWIN_ALLOW`, names or folders separated as in PATH), and so are, when it is rendered, plugins that Mitsuba does not
bring.
"""

import hashlib
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.files.limits import MAX_PIXELS
from raytwin.files.safe_write import check_file, replacing, write_text
from raytwin.scene.mitsuba_scene import MitsubaScene
from raytwin.scene_folders import find_scene

ALLOW = "RAYTWIN_ALLOW"
"""The environment variable that names files, folders and plugins that a Mitsuba scene may use although they are not its
own; the processes that raytwin starts see it too."""

MOST_BYTES = 1 << 30
"""Bytes per file."""
DEEPEST = 8
"""Includes within includes."""
DEFAULT_SIZE = {"width": 768, "height": 576}
"""Mitsuba's, where a film has none."""


def allowed() -> tuple[str, ...]:
    """What RAYTWIN_ALLOW names."""
    return tuple(name for name in os.environ.get(ALLOW, "").split(os.pathsep) if name)


def is_mitsuba(path: str | os.PathLike) -> bool:
    """Whether the scene that `path` names is a Mitsuba file."""
    return find_scene(path).suffix.lower() == ".xml"


def read_mitsuba(path: str | os.PathLike) -> MitsubaScene:
    """Read a Mitsuba scene, given its file, its folder or its name. Raises InputError with file and place."""
    file = find_scene(path)
    found: dict[Path, str] = {}
    root = _parsed(file, found, 0)
    folder = file.absolute().parent
    _substitute(file, root)
    text_folders = [folder]
    for holder in list(root.iter()):
        for element in holder.findall("path"):
            where = f"{file}: <path>"
            text_folders.append(_own(where, element.get("value", ""), folder, folder, is_folder=True))
            holder.remove(element)
    for element in root.iter():
        for key in _files_of(element):
            if not _names_file(element, key, text_folders):
                continue
            inside = _found(f"{file}: {element.get('name') or element.tag}", element.get(key, ""), text_folders)
            found[inside] = hashlib.sha256(_content(inside, "a file")).hexdigest()
            element.set(key, os.path.relpath(inside, folder))
    named = {os.path.relpath(one, folder): digest for one, digest in sorted(found.items())}
    named.pop(file.name, None)  # what is in it, is in the text
    shapes = [e for e in root.iter("shape") if e.get("type") != "shapegroup"]
    for number, shape in enumerate(shapes):
        shape.set("id", shape.get("id") or f"{shape.get('type')}-{number}")
    name = folder.name if file.stem.startswith("scene") else file.stem
    text = ET.tostring(root, "unicode")
    names = tuple(shape.get("id", "") for shape in shapes)
    return MitsubaScene(name, str(file.absolute()), text, str(folder), _image_size(file, root), names, named)


def _parsed(file: Path, found: dict[Path, str], depth: int) -> ET.Element:
    """The file's elements with those of its includes in their place; each file read is noted in `found`."""
    content = _content(file)
    found[file.absolute()] = hashlib.sha256(content).hexdigest()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise InputError(file, "a Mitsuba scene (XML) without a DOCTYPE", "one with")
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(file, "a Mitsuba scene (XML)", error) from None
    if root.tag != "scene":
        raise InputError(file, "a Mitsuba scene, whose outermost element is <scene>", f"<{root.tag}>")
    if depth > DEEPEST:
        raise InputError(file, f"includes at most {DEEPEST} deep", "more")
    for parent in list(root.iter()):
        for place, element in reversed(list(enumerate(parent))):
            if element.tag == "include":
                folder = file.absolute().parent
                inner = _own(f"{file}: <include>", element.get("filename", ""), folder, folder)
                parent[place : place + 1] = list(_parsed(inner, found, depth + 1))
    return root


def _content(file: Path, kind: str = "a Mitsuba scene (XML)") -> bytes:
    check_file(file, kind)
    try:
        if (size := file.stat().st_size) > MOST_BYTES:
            raise InputError(file, f"{kind} of at most {MOST_BYTES >> 20} MB", f"{size >> 20} MB")
        return file.read_bytes()
    except OSError as error:
        raise InputError(file, "a file that can be read", error.strerror or error) from None


def _substitute(file: Path, root: ET.Element) -> None:
    """Put each <default>'s value in the place of its $name, the longest name first, as Mitsuba does."""
    known: dict[str, str] = {}
    for holder in list(root.iter()):
        for element in holder.findall("default"):
            known.setdefault(element.get("name", ""), element.get("value", ""))
            holder.remove(element)
    for element in root.iter():
        for key, value in element.attrib.items():
            for name in sorted(known, key=len, reverse=True):
                value = value.replace(f"${name}", known[name])
            if "$" in value:
                raise InputError(f"{file}: <{element.tag}> {key}", "a parameter with a <default>", value)
            element.set(key, value)


def _files_of(element: ET.Element) -> Iterator[str]:
    """The attributes that name files: whatever is called so, and texts that look like paths."""
    if element.get("filename"):
        yield "filename"
    value = element.get("value", "")
    if element.tag == "string" and (element.get("name") == "filename" or "/" in value or "\\" in value):
        yield "value"


def _names_file(element: ET.Element, key: str, folders: list[Path]) -> bool:
    """Whether it names a file: called `filename`, or a text that looks like a path and leads to something. Others, such
    as the `aovs` of an integrator, may have slashes too."""
    called = key == "filename" or element.get("name") == "filename"
    return called or any(os.path.exists(folder / element.get(key, "")) for folder in folders)  # noqa: PTH110 long texts


def as_loaded(scene: MitsubaScene) -> ET.Element:
    """The scene's elements with the whole path of each file in the place of its name."""
    root = ET.fromstring(scene.text)
    for element in root.iter():
        for key in _files_of(element):
            if _names_file(element, key, [Path(scene.folder)]):
                element.set(key, str(Path(scene.folder) / element.get(key, "")))
    return root


def _found(where: str, value: str, folders: list[Path]) -> Path:
    """The file that the text names, in the first folder that has it."""
    for folder in folders:
        if (folder / value).is_file():
            return _own(where, value, folder, folders[0])
    return _own(where, value, folders[0], folders[0])


def _own(where: str, value: str, folder: Path, own: Path, is_folder: bool = False) -> Path:
    """`folder`/`value`, where it lies in the scene's `own` folder, links followed, or is allowed by name."""
    path = Path(os.path.normpath(folder / value))
    real, names = path.resolve(), [Path(name).resolve() for name in allowed()]
    if not real.is_relative_to(own.resolve()) and not any(real.is_relative_to(name) for name in names):
        raise InputError(where, f"a file in the scene's folder, or one that --allow names ({ALLOW})", value)
    there = path.is_dir() if is_folder else path.is_file()
    if not there:
        raise InputError(where, "a folder" if is_folder else "a file", f"{value}: none there")
    return path


def _image_size(file: Path, root: ET.Element) -> tuple[int, int]:
    """The film's size, cropped, of the first sensor."""
    sensor, integrator = root.find("sensor"), root.find("integrator")
    if sensor is None or integrator is None:
        missing = "sensor" if sensor is None else "integrator"
        raise InputError(file, "a scene with a sensor, a film and an integrator of its own", f"no <{missing}>")
    film = sensor.find("film")
    sides = {e.get("name", ""): e.get("value", "") for e in film.findall("integer")} if film is not None else {}
    size = []
    for side, usual in DEFAULT_SIZE.items():
        text = sides.get(f"crop_{side}", sides.get(side, str(usual)))
        if not text.strip().isdecimal() or not 1 <= int(text) <= 100_000:
            raise InputError(f"{file}: film {side}", "pixels, from 1 to 100000", text)
        size.append(int(text))
    if size[0] * size[1] > MAX_PIXELS:
        raise InputError(f"{file}: film", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{size[0]} x {size[1]}")
    return size[0], size[1]


def with_film(scene: MitsubaScene, **integers: int) -> MitsubaScene:
    """The scene with these integers in its film: width, height, crop_width and so on."""
    root = ET.fromstring(scene.text)
    film = root.find("sensor/film")
    if film is None:
        sensor = root.find("sensor")
        assert sensor is not None  # checked when it was read
        film = ET.SubElement(sensor, "film", {"type": "hdrfilm"})
    for name, value in integers.items():
        for element in [e for e in film.findall("integer") if e.get("name") == name]:
            film.remove(element)
        ET.SubElement(film, "integer", {"name": name, "value": str(value)})
    return edited(scene, root)


def edited(scene: MitsubaScene, root: ET.Element) -> MitsubaScene:
    """The scene with other elements, which name no further files."""
    named = {element.get(key, "") for element in root.iter() for key in _files_of(element)}
    names = {shape.get("id", "") for shape in root.iter("shape")}
    return msgspec.structs.replace(
        scene,
        text=ET.tostring(root, "unicode"),
        image_size=_image_size(Path(scene.file), root),
        names=tuple(name for name in scene.names if name in names),
        files={name: digest for name, digest in scene.files.items() if name in named},
    )


def write_mitsuba(scene: MitsubaScene, folder: Path, comment: str = "") -> MitsubaScene:
    """Write the scene as `folder`/scene.xml with copies of all files that it names; the scene as it lies there."""
    root, names = ET.fromstring(scene.text), {}
    for name in scene.files:
        inside = not name.startswith("..") and not Path(name).is_absolute()
        names[name] = name if inside else f"{scene.files[name][:8]}-{Path(name).name}"
        content = _content(Path(scene.folder) / name, "a file")
        if not (folder / names[name]).is_file() or (folder / names[name]).read_bytes() != content:
            with replacing(folder / names[name]) as temporary:
                temporary.write_bytes(content)
    for element in root.iter():
        for key in _files_of(element):
            element.set(key, names.get(element.get(key, ""), element.get(key, "")))
    ET.indent(root)
    text = ET.tostring(root, "unicode")
    said = f"<!--\n{comment.replace('--', '- -')}\n-->\n" if comment else ""
    write_text(folder / "scene.xml", f"{said}{text}\n")
    named = {names[name]: digest for name, digest in scene.files.items()}
    file = str((folder / "scene.xml").absolute())
    return msgspec.structs.replace(scene, text=text, file=file, folder=str(folder.absolute()), files=named)
