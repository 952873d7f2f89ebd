"""Renders stored between runs. A file's name is a hash of all that decides its pixels, so that none is ever stale."""

import contextlib
import hashlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.images.cache import cache_folder
from raytwin.images.image import Image, Surface
from raytwin.safe_write import replacing

LIMIT = 2 << 30
"""Bytes: beyond these the renders that were used longest ago are deleted."""
WORTH_KEEPING = 1.0
"""Seconds: a render that took less is not stored, since reading it back would save nothing."""
PARTS = "mean", "variance", "third", "samples", "batches"
"""Fields of an Image that are stored beside its surface."""


def cached(about: dict[str, str], use: bool, make: Callable[[], Image]) -> Image:
    """The image of this provenance: the stored one where the cache is in `use`, else what `make` renders."""
    path = cache_folder() / "renders" / f"{hashlib.sha256(repr(about).encode()).hexdigest()[:32]}.npz"
    if use and (image := load(path)) is not None:
        return image
    start = time.perf_counter()
    image = make()
    if use and time.perf_counter() - start > WORTH_KEEPING:
        store(path, image)
    return image


def load(path: Path) -> Image | None:
    """The image that `store` has written; None where there is none, or a damaged one."""
    try:
        if not path.is_file():  # reading a pipe would never end
            return None
        with (
            path.open("rb") as file,
            np.load(file, allow_pickle=False) as stored,
        ):  # the archive has a checksum of each array
            found = {name: stored[name] for name in PARTS if name in stored}
            surface = Surface(stored["ids"], stored["depth"], stored["normal"])
    except Exception:  # encrypted, cut off, of an unknown compression, no array, ...: each has an error of its own
        return None
    os.utime(path)
    parts: dict[str, Any] = {name: part if part.ndim else int(part) for name, part in found.items()}
    return Image(surface=surface, **parts)


def store(path: Path, image: Image) -> None:
    """Store the image; a cache that cannot be written is no error."""
    assert image.surface is not None  # the twin always has one
    known = {name: part for name in PARTS if (part := getattr(image, name)) is not None}
    with contextlib.suppress(InputError, OSError):
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **known, **vars(image.surface))
        stored = [(f.stat().st_mtime, f.stat().st_size, f) for f in path.parent.glob("[!.]*.npz")]
        total = 0
        for _, size, file in sorted(stored, reverse=True):
            total += size
            if total > LIMIT:
                file.unlink(missing_ok=True)
