"""A Mitsuba scene file (XML): read and checked without Mitsuba, every file that it names found and hashed.

A stranger's scene must not reach for what is not its own: files outside its folder and plugins that Mitsuba does not
bring are refused unless allowed by name (`RAYTWIN_ALLOW`, names or folders separated as in PATH).
"""

import hashlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import msgspec

from raytwin.errors import InputError
from raytwin.images.limits import MAX_PIXELS
from raytwin.safe_write import check_file
from raytwin.scene.mitsuba_scene import MitsubaScene
from raytwin.scene_folders import find_scene

ALLOW = "RAYTWIN_ALLOW"
"""The environment variable that names files, folders and plugins that a Mitsuba scene may use although they are not its
own; the processes that raytwin starts see it too."""

MOST_BYTES = 1 << 30
"""Bytes per mesh, texture or other file that a scene names."""
MOST_XML = 1 << 26
"""Characters of a scene's XML with all includes and parameters put in, and parameters looked up while doing so."""
MOST_INCLUDES = 1000
"""Files that a scene includes, counted each time."""
DEEPEST_INCLUDE = 15
"""Includes within includes, as in Mitsuba."""
DEEPEST_ELEMENT = 100
"""Elements within elements: Python walks them by recursion."""
OUTERMOST = "a Mitsuba scene, whose outermost element is <scene>"
FILM = ("width", "x", 768), ("height", "y", 576)
"""A film's sides, their axes and, where a film has none, Mitsuba's lengths in pixels."""
COLOURS = {"rgba": "rgb", "xyz": "rgb", "xyza": "rgb", "luminance_alpha": "luminance"}
"""Pixel formats that are rendered in another one: linear Rec. 709 or grey, without coverage, as raytwin compares."""


def allowed() -> tuple[str, ...]:
    """What RAYTWIN_ALLOW names."""
    return tuple(name for name in os.environ.get(ALLOW, "").split(os.pathsep) if name)


def is_mitsuba(path: str | os.PathLike[str]) -> bool:
    """Whether the scene that `path` names is a Mitsuba file."""
    return find_scene(path).suffix.lower() == ".xml"


def read_mitsuba(path: str | os.PathLike[str]) -> MitsubaScene:
    """Read a Mitsuba scene, given its file, its folder or its name. Raises InputError with file and place."""
    file = find_scene(path)
    folder = file.absolute().parent
    reading, folders = _Reading(file), [folder]
    root = reading.element(file, folders, 0, 0)
    if root.tag != "scene":
        raise InputError(file, OUTERMOST, f"<{root.tag}>")
    found = reading.found
    for element in root.iter():
        for key in _files_of(element, folders):
            inside = _found(f"{file}: {element.get('name') or element.tag}", element.get(key, ""), folders, folder)
            if inside not in found:
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


class _Reading:
    """One walk through a scene's files in the order of their text, as Mitsuba's parser walks."""

    def __init__(self, file: Path) -> None:
        self.file, self.own = file, file.absolute().parent
        self.found: dict[Path, str] = {}  # every XML file with its SHA-256
        self._parameters: dict[str, str] = {}
        self._spent = self._includes = 0

    def element(self, file: Path, folders: list[Path], depth: int, level: int) -> ET.Element:
        """The file's outermost element, without includes, parameters and search folders: these go to `folders`."""
        content = _content(file, "a Mitsuba scene (XML)", MOST_XML)
        self._spend(len(content))
        self.found[file.absolute()] = hashlib.sha256(content).hexdigest()
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise InputError(file, "a Mitsuba scene (XML) without a DOCTYPE", "one with")
        try:
            root = ET.fromstring(content)
        except (ET.ParseError, ValueError, LookupError) as error:
            raise InputError(file, "a Mitsuba scene (XML)", error) from None
        if root.tag in ("default", "include", "path"):
            raise InputError(file, OUTERMOST, f"<{root.tag}>")
        return self._expanded(root, file, folders, depth, level)[0]

    def _expanded(
        self, element: ET.Element, file: Path, folders: list[Path], depth: int, level: int
    ) -> list[ET.Element]:
        """What stands in the element's place: nothing, itself with all in it expanded, or what it includes."""
        where = f"{file}: <{element.tag}>"
        if level > DEEPEST_ELEMENT:
            raise InputError(where, f"elements at most {DEEPEST_ELEMENT} deep", "more")
        self._put_in_parameters(where, element)
        if element.tag == "default":
            self._parameters.setdefault(element.get("name", ""), element.get("value", ""))
            return []
        if element.tag == "path":
            folders.insert(0, _found(where, element.get("value", ""), folders, self.own, is_folder=True))
            return []
        if element.tag == "include":
            return self._included(element, where, folders, depth + 1, level)
        _check_type(where, element.get("type"))
        if element.get("filename"):  # Mitsuba looks for it here, and for a <string>'s with the outermost file's folders
            element.set("filename", str(_found(where, element.get("filename", ""), folders, self.own)))
        element[:] = [e for child in element for e in self._expanded(child, file, folders, depth, level + 1)]
        return [element]

    def _included(
        self, include: ET.Element, where: str, folders: list[Path], depth: int, level: int
    ) -> list[ET.Element]:
        self._includes += 1
        if depth > DEEPEST_INCLUDE or self._includes > MOST_INCLUDES:
            raise InputError(where, f"at most {MOST_INCLUDES} includes, {DEEPEST_INCLUDE} deep", "more")
        inner = _found(where, include.get("filename", ""), folders, self.own)
        root = self.element(inner, [inner.parent, *folders], depth, level)
        if root.tag == "scene":
            return list(root)
        root.attrib.pop("version", None)
        root.attrib.pop("name", None)
        root.attrib.update({"name": include.get("name", "")} if include.get("name") else {})
        return [root]

    def _put_in_parameters(self, where: str, element: ET.Element) -> None:
        """Put each parameter's value in the place of its $name, the longest name first, as Mitsuba does."""
        for key, value in element.attrib.items():
            if "$" not in value:
                continue
            self._spend(len(self._parameters))
            for name in sorted(self._parameters, key=len, reverse=True):
                self._spend(value.count(f"${name}") * len(self._parameters[name]))
                value = value.replace(f"${name}", self._parameters[name])
            if "$" in value:
                raise InputError(f"{where} {key}", "a parameter with a <default> before it", value[:80])
            element.set(key, value)

    def _spend(self, characters: int) -> None:
        self._spent += characters
        if self._spent > MOST_XML:
            expected = f"at most {MOST_XML >> 20} MB of XML with all includes and parameters put in"
            raise InputError(self.file, expected, "more")


@cache
def mitsuba_plugins() -> frozenset[str]:
    """What the installed Mitsuba brings: its libraries, and the plugins written in Python. Empty without Mitsuba."""
    spec = find_spec("mitsuba")
    if spec is None or spec.origin is None:
        return frozenset()
    package = Path(spec.origin).parent
    libraries = {path.stem.removeprefix("lib") for path in (package / "plugins").iterdir()}
    texts = (path.read_text(encoding="utf-8") for path in (package / "python" / "ad").rglob("*.py"))
    return frozenset(libraries.union(re.findall(r'^mi\.register_\w+\(\s*"(\w+)"', "\n".join(texts), re.MULTILINE)))


def _check_type(where: str, name: str | None) -> None:
    """Raise InputError for a plugin that is none of Mitsuba's own: loading it runs its code."""
    known = mitsuba_plugins()
    if known and name not in (None, "scene", *known, *allowed()):
        raise InputError(where, f"a plugin of Mitsuba's, or one that --allow names ({ALLOW})", name)


def _content(file: Path, kind: str, most: int = MOST_BYTES) -> bytes:
    check_file(file, kind)
    try:
        if (size := file.stat().st_size) > most:
            raise InputError(file, f"{kind} of at most {most >> 20} MB", f"{size >> 20} MB")
        return file.read_bytes()
    except OSError as error:
        raise InputError(file, "a file that can be read", error.strerror or error) from None


def _files_of(element: ET.Element, folders: list[Path]) -> Iterator[str]:
    """The attributes that name files: whatever is called so, and texts that look like paths and lead to something.

    Others, such as the `aovs` of an integrator, may have slashes too.
    """
    if element.get("filename"):
        yield "filename"
    value = element.get("value", "")
    leads = ("/" in value or "\\" in value) and any(os.path.exists(f / value) for f in folders)  # noqa: PTH110 long texts
    if element.tag == "string" and (leads or element.get("name") == "filename"):
        yield "value"


def as_loaded(scene: MitsubaScene) -> ET.Element:
    """The scene's elements with the whole path of each file in the place of its name, and COLOURS on its films."""
    root = ET.fromstring(scene.text)
    for element in root.iterfind(".//film/string[@name='pixel_format']"):
        element.set("value", COLOURS.get(element.get("value", "").lower(), element.get("value", "")))
    for element in root.iter():
        for key in _files_of(element, [Path(scene.folder)]):
            element.set(key, str(Path(scene.folder) / element.get(key, "")))
    return root


def _found(where: str, value: str, folders: list[Path], own: Path, is_folder: bool = False) -> Path:
    """The file that the text names, in the first folder that has it, where it lies in the scene's `own` folder, links
    followed, or is allowed by name."""
    tried = [Path(os.path.normpath(folder / value)) for folder in folders]
    there = [path for path in tried if (path.is_dir() if is_folder else path.is_file())]
    path = (there or tried)[0]
    real, names = path.resolve(), [Path(name).resolve() for name in allowed()]
    if not real.is_relative_to(own.resolve()) and not any(real.is_relative_to(name) for name in names):
        raise InputError(where, f"a file in the scene's folder, or one that --allow names ({ALLOW})", value)
    if not there:
        raise InputError(where, "a folder" if is_folder else "a file", f"{value}: none there")
    return path


def _film(file: Path, root: ET.Element) -> dict[str, int]:
    """Size and window of the first sensor's film, in pixels, under Mitsuba's names."""
    sensor, integrator = root.find("sensor"), root.find("integrator")
    if sensor is None or integrator is None:
        missing = "sensor" if sensor is None else "integrator"
        raise InputError(file, "a scene with a sensor, a film and an integrator of its own", f"no <{missing}>")
    said = {e.get("name", ""): e.get("value", "") for e in sensor.findall("film/integer")}
    film: dict[str, int] = {}

    def pixels(name: str, usual: int, fewest: int) -> int:
        text = said.get(name, str(usual)).strip()
        if not re.fullmatch("[0-9]{1,6}", text) or not fewest <= int(text) <= 100_000:
            raise InputError(f"{file}: film {name}", f"pixels, from {fewest} to 100000", text[:80])
        film[name] = int(text)
        return film[name]

    for side, axis, usual in FILM:
        whole = pixels(side, usual, 1)
        window, offset = pixels(f"crop_{side}", whole, 1), pixels(f"crop_offset_{axis}", 0, 0)
        if offset + window > whole:
            expected = f"a window inside the film, {whole} pixels"
            raise InputError(f"{file}: film crop_{side}", expected, f"{window} pixels from {offset} on")
    return film


def _image_size(file: Path, root: ET.Element) -> tuple[int, int]:
    """The size of what the film shows: its window's."""
    film = _film(file, root)
    width, height = film["crop_width"], film["crop_height"]
    if width * height > MAX_PIXELS:
        raise InputError(f"{file}: film", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{width} x {height}")
    return width, height


def with_film(scene: MitsubaScene, width: int, height: int) -> MitsubaScene:
    """The scene with an image of this size that shows the same: a window in the film becomes larger or smaller, too."""
    old = _film(Path(scene.file), ET.fromstring(scene.text))
    new: dict[str, int] = {}
    for (side, axis, _), length in zip(FILM, (width, height), strict=True):
        ratio = length / old[f"crop_{side}"]
        offset = round(old[f"crop_offset_{axis}"] * ratio)
        new[side] = max(round(old[side] * ratio), offset + length)
        new |= {f"crop_{side}": length, f"crop_offset_{axis}": offset} if old[side] > old[f"crop_{side}"] else {}
    return _with_film(scene, new)


def _with_film(scene: MitsubaScene, integers: dict[str, int]) -> MitsubaScene:
    """The scene whose film has these numbers of pixels, and no others."""
    root = ET.fromstring(scene.text)
    film = root.find("sensor/film")
    if film is None:
        sensor = root.find("sensor")
        assert sensor is not None  # checked when it was read
        film = ET.SubElement(sensor, "film", {"type": "hdrfilm"})
    names = {name for side, axis, _ in FILM for name in (side, f"crop_{side}", f"crop_offset_{axis}")}
    for element in [e for e in film.findall("integer") if e.get("name") in names]:
        film.remove(element)
    for name, value in integers.items():
        ET.SubElement(film, "integer", {"name": name, "value": str(value)})
    size = _image_size(Path(scene.file), root)
    return msgspec.structs.replace(scene, text=ET.tostring(root, "unicode"), image_size=size)
