"""The folder of results stored between runs, and a hash of the code that made them."""

import contextlib
import hashlib
import os
import platform
from functools import cache
from pathlib import Path


def cache_folder() -> Path:
    """The user's cache folder of raytwin, or RAYTWIN_CACHE."""
    import platformdirs

    return Path(os.environ.get("RAYTWIN_CACHE") or platformdirs.user_cache_dir("raytwin", appauthor=False))


def installed(packages: tuple[str, ...]) -> dict[str, str]:
    """Python's version, and those of these packages that are installed."""
    from importlib import metadata

    found = {"python": platform.python_version()}
    for name in packages:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


SOURCES = (".py", ".tsv", ".json", ".toml")
"""Name endings of code, and of the tables that it reads."""


@cache
def made_by(sources: tuple[Path, ...], packages: tuple[str, ...]) -> str:
    """SHA-256 of our own `sources`, each a file or a folder of files, and of the packages' versions."""
    total = hashlib.sha256(repr(installed(packages)).encode())
    for place in sources:
        for file in sorted(p for p in place.rglob("*") if p.suffix in SOURCES) or [place]:
            total.update(file.name.encode() + file.read_bytes())
    return total.hexdigest()
