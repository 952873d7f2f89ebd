"""Renders stored between runs. A file's name is a hash of all that decides its pixels, so that none is ever stale."""

import contextlib
import hashlib
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from raytwin.errors import InputError
from raytwin.images.cache import cache_folder
from raytwin.images.image import Image, Surface
from raytwin.safe_write import replacing

LIMIT = 2 << 30
"""Bytes: beyond these the renders that were used longest ago are deleted."""
WORTH_KEEPING = 1.0
"""Seconds: a render that took less is not stored, since reading it back would save nothing."""


def cached(about: dict[str, str], use: bool, make: Callable[[], Image]) -> Image:
    """The image of this provenance: the stored one where the cache is in `use`, else what `make` renders."""
    key = hashlib.sha256(repr(about).encode()).hexdigest()[:32]
    if use and (image := load(key)) is not None:
        return image
    start = time.perf_counter()
    image = make()
    if use and time.perf_counter() - start > WORTH_KEEPING:
        store(key, image)
    return image


def load(key: str) -> Image | None:
    """The image that `store` has written under this key; None where there is none, or another, or a damaged one."""
    path = path_of(key)
    if not _is_plain(path):
        return None
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            found = {name: stored[name] for name in stored.files}
        if found.pop("seal").tobytes() != _seal(key, found):
            return None
    except Exception:  # encrypted, cut off, of an unknown compression, no array, ...: each has an error of its own
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    batches = int(found["batches"]) if "batches" in found else None
    surface = Surface(found["ids"], found["depth"], found["normal"])
    return Image(
        found["mean"], found.get("variance"), int(found["samples"]), surface, batches, third=found.get("third")
    )


def store(key: str, image: Image) -> None:
    """Store the image; a cache that cannot be written is no error."""
    path, surface = path_of(key), image.surface
    assert surface is not None  # the twin always has one
    parts = {"mean": image.mean, "samples": image.samples, "variance": image.variance, "batches": image.batches}
    parts["third"] = image.third
    parts |= {"ids": surface.ids, "depth": surface.depth, "normal": surface.normal}
    arrays = {name: np.asarray(part) for name, part in parts.items() if part is not None}
    if not _is_plain(path):
        return
    with contextlib.suppress(InputError, OSError):
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays, seal=np.frombuffer(_seal(key, arrays), np.uint8))
        _drop_oldest(path.parent)


def path_of(key: str) -> Path:
    return cache_folder() / "renders" / f"{key}.npz"


def _drop_oldest(folder: Path) -> None:
    stored = (f for f in folder.iterdir() if f.is_file() and not f.name.startswith("."))  # others are being written
    known = sorted(((f.stat().st_mtime, f.stat().st_size, f) for f in stored), reverse=True)
    total = 0
    for _, size, file in known:
        total += size
        if total > LIMIT:
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
