"""Where scenes and references lie: one's own first, then those that come with raytwin.

The command line asks this before all else: it imports nothing heavy.
"""

import difflib
import os
import shutil
from itertools import takewhile
from pathlib import Path

from raytwin.errors import InputError


def _home() -> Path:
    """What holds `scenes` and `reference`: a folder of the installed package, or the checkout that this file is in."""
    package = Path(__file__).resolve().parent
    return package / "shipped" if (package / "shipped").is_dir() else package.parents[1]


SCENES, REFERENCES = _home() / "scenes", _home() / "reference"
OWN_SCENES = Path("scenes")
KINDS = "scene.toml", "scene.xml"
"""The file that makes a folder a scene: raytwin's own, or Mitsuba's."""


def scene_folders() -> dict[str, Path]:
    """Every scene that a name finds from the current folder: those of `scenes/`, then those shipped."""
    found = [f.parent for folder in (OWN_SCENES, SCENES) for kind in KINDS for f in sorted(folder.glob(f"*/{kind}"))]
    return {folder.name: folder for folder in reversed(found)}


def _written_in(folder: Path) -> Path | None:
    """The scene's file in its folder: scene.toml, scene.xml, or the only XML file; None where there is none."""
    for kind in KINDS:
        if (folder / kind).is_file():
            return folder / kind
    others = sorted(folder.glob("*.xml"))
    return others[0] if len(others) == 1 else None


def all_scenes() -> list[Path]:
    """The folders in `scenes/`, or those shipped where there is none."""
    own = sorted(f.parent for kind in KINDS for f in OWN_SCENES.glob(f"*/{kind}"))
    return own or list(scene_folders().values())


def find_scene(path: str | os.PathLike[str]) -> Path:
    """The file of the scene `path`: a file, a folder, or a name: ./NAME, then scenes/NAME, then what is shipped."""
    path = Path(path)
    if path.suffix == ".exr":
        raise InputError(path, "a scene's folder, its scene.toml or its name", "an image")
    if path.suffix in (".toml", ".xml") or path.is_file():
        return path
    if (file := _written_in(path)) is not None:
        return file
    there = scene_folders()
    if (len(path.parts) == 1 and path.name in there) or (path == OWN_SCENES / path.name and path.name in there):
        return _written_in(there[path.name]) or there[path.name] / "scene.toml"
    if path.is_dir():
        raise InputError(path, "a scene's folder, holding scene.toml or scene.xml", "none")
    if path.exists():
        raise InputError(path, "a scene's folder, its scene.toml or its name", "a file")
    close = difflib.get_close_matches(path.name, there, 1)
    known = f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(there))}"
    raise InputError(path, "a scene's folder, its scene.toml or its name", f"no such scene ({known})")


def scenes() -> list[dict[str, str]]:
    """Return a row per scene that a name finds: `name`, what it `shows`, its `folder`.

    A scene of yours in scenes/ comes before one of that name that raytwin brings.

    >>> [row["name"] for row in scenes()][:3]
    ['ball', 'desk', 'distorted']
    """
    found = sorted(scene_folders().items())
    return [{"name": name, "shows": scene_sentence(folder), "folder": str(folder)} for name, folder in found]


def scene_sentence(folder: Path) -> str:
    """The first sentence of the comment at the head of its file."""
    text = find_scene(folder).read_text(encoding="utf-8")
    if text.startswith("<"):
        comment = text.partition("<!--")[2].partition("-->")[0]
    else:
        head = takewhile(lambda line: line.startswith("#"), text.splitlines())
        comment = " ".join(line.lstrip("# ") for line in head)
    return " ".join(comment.split()).split(". ")[0].rstrip(".")


def copy_scene(path: str | os.PathLike[str], out: str | os.PathLike[str]) -> Path:
    """The scene's folder with all that it needs, copied to `out`, which must not be there yet."""
    folder, out = find_scene(path).parent, Path(out)
    if out.exists():
        raise InputError(out, "exists. Give the copy another folder.")
    try:
        shutil.copytree(folder, out)
    except OSError as error:
        raise InputError(out, "a writable path", error.strerror or error) from error
    return out
