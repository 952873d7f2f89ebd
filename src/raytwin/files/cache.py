"""What is kept between runs, by content: a file's name is a hash of all that decides what is in it, so none is stale.

A kept file may be damaged, or of another's making: whoever reads one checks it, and makes anew what is not sound.
"""

import contextlib
import hashlib
import os
import platform
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from raytwin.errors import InputError
from raytwin.files.safe_write import replacing


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


@cache
def made_by(sources: tuple[Path, ...], packages: tuple[str, ...]) -> str:
    """A hash of what computes: our own source, each a file or a folder of them, and the packages' versions."""
    total = hashlib.sha256(repr(installed(packages)).encode())
    for place in sources:
        for file in sorted(place.rglob("*.py")) or [place]:
            total.update(file.name.encode() + file.read_bytes())
    return total.hexdigest()


def is_plain(path: Path) -> bool:
    """A file, or nothing yet, where either may be; a planted pipe would be waited for without end."""
    try:
        return path.is_file() or not path.exists()
    except OSError:  # a folder above that may not be entered, a name too long
        return False


def mark_used(path: Path) -> None:
    """What was used last is dropped last."""
    with contextlib.suppress(OSError):
        os.utime(path)


def drop_oldest(folder: Path, limit: int) -> None:
    """Of a folder's files the ones used longest ago go, so that no more than `limit` bytes stay."""
    files = (f for f in folder.iterdir() if f.is_file() and not f.name.startswith("."))  # others are being written
    known = sorted(((f.stat().st_mtime, f.stat().st_size, f) for f in files), reverse=True)
    total = 0
    for _, size, file in known:
        total += size
        if total > limit:
            file.unlink(missing_ok=True)


def load_arrays(path: Path) -> dict[str, np.ndarray] | None:
    """Return the arrays of a stored .npz by their names, not yet checked; None if it is damaged in whatever way."""
    if not is_plain(path):
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
            arrays = {name: kept[name] for name in kept.files}
    except Exception:  # encrypted, cut off, of an unknown compression, ...: zipfile has an error for each
        return None
    return arrays if all(isinstance(a, np.ndarray) for a in arrays.values()) else None


def keep(path: Path, write: Callable[[Path], object], limit: int) -> None:
    """`write` it, and drop the oldest beside it beyond `limit` bytes; a cache that cannot be written is no error."""
    if not is_plain(path):
        return
    with contextlib.suppress(InputError, OSError):
        with replacing(path) as temporary:
            write(temporary)
        drop_oldest(path.parent, limit)
