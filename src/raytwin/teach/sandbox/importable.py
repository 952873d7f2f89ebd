"""What a submission may import beside the standard library: the packages of a rubric, with all that they need."""

import functools
import re
from importlib import metadata
from typing import NamedTuple

ALWAYS = ("numpy", "scipy")

MODULE_OF = {f"opencv-{kind}": "cv2" for kind in ("python", "python-headless", "contrib-python")} | {
    "opencv-contrib-python-headless": "cv2",
    "scikit-image": "skimage",
    "pillow": "PIL",
}
"""Packages of one module that may stand in for each other: any that is installed serves a rubric that names another."""


class Importable(NamedTuple):
    """`modules`: names that `import` takes. `entries`: what lies for them in a folder of installed packages."""

    modules: tuple[str, ...]
    entries: tuple[str, ...]


@functools.cache
def importable(packages: tuple[str, ...]) -> Importable:
    """Return what these packages (requirements in words for pip), `ALWAYS` and all that they require consist of."""
    todo = [*ALWAYS, *packages]
    seen: set[str] = set()
    entries: set[str] = set()
    while todo:
        name = _name(todo.pop())
        if name in seen:
            continue
        seen.add(name)
        found = _installed(name)
        if found is None:
            entries.add(MODULE_OF.get(name, name.replace("-", "_")))
            continue
        entries |= _entries(found)
        todo += [text for text in found.requires or () if "extra ==" not in text]
    modules = {entry.partition(".")[0] for entry in entries if not entry.endswith(("-info", ".libs"))}
    return Importable(tuple(sorted(modules)), tuple(sorted(entries)))


def _name(requirement: str) -> str:
    match = re.match(r"\s*([A-Za-z0-9][A-Za-z0-9._-]*)", requirement)
    return re.sub(r"[-_.]+", "-", match[1]).lower() if match else ""


def _installed(name: str) -> metadata.Distribution | None:
    others = [other for other, module in MODULE_OF.items() if module == MODULE_OF.get(name, "")]
    for one in (name, *others):
        try:
            return metadata.distribution(one)
        except (metadata.PackageNotFoundError, ValueError):
            continue
    return None


def _entries(package: metadata.Distribution) -> set[str]:
    tops = {file.parts[0] for file in package.files or () if file.parts[0] not in ("..", "__pycache__")}
    return tops | set((package.read_text("top_level.txt") or "").split())
