"""Results stored between runs. A file's name is a hash of all that decides its content, so none is ever stale."""

import contextlib
import hashlib
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from raytwin.errors import InputError
from raytwin.files.safe_write import replacing

SEAL = "seal"
"""The name of the hash among a file's arrays."""


@dataclass(frozen=True)
class Cache:
    """The files `<cache_folder()>/<folder>/<key><ending>`; beyond `limit` bytes those used longest ago are deleted.

    A file may be damaged, or written by somebody else: `load_arrays` returns only what `store_arrays` has written under
    the same key.
    """

    folder: str
    ending: str
    limit: int

    def path(self, key: str) -> Path:
        return cache_folder() / self.folder / f"{key}{self.ending}"

    def load_arrays(self, key: str) -> dict[str, np.ndarray] | None:
        """Return the arrays stored under this key by their names; None where there are none, or others."""
        path = self.path(key)
        if not _is_plain(path):
            return None
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            if arrays.pop(SEAL).tobytes() != _seal(key, arrays):
                return None
        except Exception:  # encrypted, cut off, of an unknown compression, no array, ...: each has an error of its own
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return arrays

    def store_arrays(self, key: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Store the arrays with a hash of key and content; a cache that cannot be written is no error."""
        path, seal = self.path(key), np.frombuffer(_seal(key, arrays), np.uint8)
        if not _is_plain(path):
            return
        with contextlib.suppress(InputError, OSError):
            with replacing(path) as temporary:
                np.savez(temporary, allow_pickle=False, **arrays, **{SEAL: seal})
            self._drop_oldest(path.parent)

    def _drop_oldest(self, folder: Path) -> None:
        files = (f for f in folder.iterdir() if f.is_file() and not f.name.startswith("."))  # others are being written
        known = sorted(((f.stat().st_mtime, f.stat().st_size, f) for f in files), reverse=True)
        total = 0
        for _, size, file in known:
            total += size
            if total > self.limit:
                file.unlink(missing_ok=True)


def _is_plain(path: Path) -> bool:
    """Whether the path is a regular file or does not exist yet: reading a planted pipe would never end."""
    try:
        return path.is_file() or not path.exists()
    except OSError:  # a folder above that may not be entered, a name too long
        return False


def _seal(key: str, arrays: Mapping[str, np.ndarray]) -> bytes:
    """A hash of the key, and of the arrays' names, kinds, shapes and numbers. It shows what is altered or crafted by
    hand, not what somebody seals with this very function."""
    total = hashlib.sha256(key.encode())
    for name, array in sorted(arrays.items()):
        total.update(repr((name, array.dtype.str, array.shape)).encode())
        total.update(np.ascontiguousarray(array).data)
    return total.digest()


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
"""Endings of code and of the tables that it reads."""


@cache
def made_by(sources: tuple[Path, ...], packages: tuple[str, ...]) -> str:
    """A hash of what computes: our own source, each a file or a folder of them, and the packages' versions."""
    total = hashlib.sha256(repr(installed(packages)).encode())
    for place in sources:
        for file in sorted(p for p in place.rglob("*") if p.suffix in SOURCES) or [place]:
            total.update(file.name.encode() + file.read_bytes())
    return total.hexdigest()
