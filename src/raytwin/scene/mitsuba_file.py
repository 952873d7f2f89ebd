"""A Mitsuba scene file (XML): what identifies it and how large its image is, read without Mitsuba. No more is modelled.

Mitsuba itself loads the file with all that it names: it is like code. Open files that you trust.
"""

import hashlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.images.limits import MAX_PIXELS
from raytwin.safe_write import check_file
from raytwin.scene.record_base import PixelCount, Record
from raytwin.scene.scene import Tolerance
from raytwin.scene_folders import find_scene

DEEPEST_INCLUDE = 15
"""Most includes within includes, as in Mitsuba."""
USUAL_SIDES = {"width": 768, "height": 576}
"""Mitsuba's own film, in pixels."""


class MitsubaScene(Record, frozen=True):
    """A Mitsuba XML file: what stands for a Scene where any renderer's scene will do.

    `file`: what Mitsuba and other programs are given. `image_size` is the film's. `files`: the file and every one that
    it names, relative to its folder, with their SHA-256; an XML file's leaves comments out. `names`: of its shapes, in
    Mitsuba's order, once Mitsuba has loaded it (`twin.named_shapes`).
    """

    name: str
    file: str
    image_size: tuple[PixelCount, PixelCount]
    files: dict[str, str]
    names: tuple[str, ...] = ()
    tolerance: Tolerance = Tolerance()

    @property
    def digest(self) -> str:
        """SHA-256 of the contents of all files and of the image's size, 32 hexadecimal digits."""
        return hashlib.sha256(msgspec.json.encode((sorted(self.files.items()), self.image_size))).hexdigest()[:32]


def is_mitsuba(path: str | os.PathLike[str]) -> bool:
    """Whether the scene that `path` names is a Mitsuba file."""
    return find_scene(path).suffix.lower() == ".xml"


def read_mitsuba(path: str | os.PathLike[str]) -> MitsubaScene:
    """Read a Mitsuba scene, given its file, its folder or its name. Raises InputError with file and place."""
    file = find_scene(path)
    folder, found = file.absolute().parent, dict[Path, str]()
    elements = list(_elements(file.absolute(), [folder], {}, found))
    if not elements or elements[0].tag != "scene":
        raise InputError(file, "a Mitsuba scene, whose outermost element is <scene>", "another")
    files = {os.path.relpath(one, folder): digest for one, digest in sorted(found.items())}
    name = folder.name if file.stem.startswith("scene") else file.stem
    return MitsubaScene(name, str(file.absolute()), _image_size(file, elements), files)


def _elements(
    file: Path, folders: list[Path], parameters: dict[str, str], found: dict[Path, str], depth: int = 0
) -> Iterator[ET.Element]:
    """Yield every element of the file and of those that it includes, in order, with Mitsuba's parameters put in.

    `found` gets each file that is named with its SHA-256.
    """
    if depth > DEEPEST_INCLUDE:
        raise InputError(file, f"includes at most {DEEPEST_INCLUDE} deep", "more")
    read = _content(file)
    try:
        content = read.decode("utf-8-sig")
        root = ET.fromstring(content)
        found[file] = hashlib.sha256(ET.canonicalize(content, strip_text=True).encode()).hexdigest()
    except (ET.ParseError, ValueError) as error:
        raise InputError(file, "a Mitsuba scene (XML)", error) from None
    for element in root.iter():
        for key, value in element.attrib.items():
            for name in sorted(parameters, key=len, reverse=True) if "$" in value else ():  # the longest first
                value = value.replace(f"${name}", parameters[name])
            element.set(key, value)
        if element.tag == "default":
            parameters.setdefault(element.get("name", ""), element.get("value", ""))
        elif element.tag == "path":
            folders.insert(0, _found(file, element.get("value", ""), folders))
        elif element.tag == "include":
            inner = _found(file, element.get("filename", ""), folders)
            yield from _elements(inner, [inner.parent, *folders], parameters, found, depth + 1)
        else:
            named = element.get("value" if element.get("name") == "filename" else "filename")
            if named and (inside := _found(file, named, folders)) not in found:
                found[inside] = hashlib.sha256(_content(inside)).hexdigest()
            yield element


def _found(file: Path, value: str, folders: list[Path]) -> Path:
    """Return the file or folder of this name in the first folder that has it."""
    there = next((path for folder in folders if (path := Path(os.path.normpath(folder / value))).exists()), None)
    if there is None or not value:
        raise InputError(f"{file}: filename", "a file", f"{value}: none there")
    return there


def _content(file: Path) -> bytes:
    check_file(file, "a file of a Mitsuba scene")
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(file, "a file that can be read", error.strerror or error) from None


def _image_size(file: Path, elements: list[ET.Element]) -> tuple[int, int]:
    """Return the size of the first film's crop window."""
    sensor = next((e for e in elements if e.tag == "sensor"), None)
    if sensor is None or not any(e.tag == "integrator" for e in elements):
        missing = "sensor" if sensor is None else "integrator"
        raise InputError(file, "a scene with a sensor, a film and an integrator of its own", f"no <{missing}>")
    said = {e.get("name", ""): e.get("value", "") for e in sensor.iterfind("film/integer")}
    width, height = (
        said.get(f"crop_{side}", said.get(side, str(usual))).strip() for side, usual in USUAL_SIDES.items()
    )
    if not (re.fullmatch("[1-9][0-9]{0,5}", width) and re.fullmatch("[1-9][0-9]{0,5}", height)):
        raise InputError(f"{file}: film", "a width and a height in pixels", f"{width[:80]} x {height[:80]}")
    if int(width) * int(height) > MAX_PIXELS:
        raise InputError(f"{file}: film", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{width} x {height}")
    return int(width), int(height)
