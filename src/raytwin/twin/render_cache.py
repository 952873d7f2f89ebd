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
"""Bytes of all stored renders: beyond these, those used longest ago are deleted."""
WORTH_KEEPING = 1.0
"""Seconds that a render must have taken to be stored: reading a quicker one back would save nothing."""
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
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:  # with a checksum of each array
            parts: dict[str, Any] = {name: part if part.ndim else int(part) for name, part in stored.items()}
        image = Image(surface=Surface(parts.pop("ids"), parts.pop("depth"), parts.pop("normal")), **parts)
    except Exception:  # cut off, encrypted, of an unknown compression, no array, ...: each has an error of its own
        return None
    os.utime(path)
    return image


def store(path: Path, image: Image) -> None:
    """Store the image, and delete the renders used longest ago; a cache that cannot be written is no error."""
    assert image.surface is not None  # the twin always has one
    known = {name: part for name in PARTS if (part := getattr(image, name)) is not None}
    with contextlib.suppress(InputError, OSError):
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **known, **vars(image.surface))
        total = 0
        for file in sorted(path.parent.glob("[!.]*.npz"), key=lambda file: file.stat().st_mtime, reverse=True):
            total += file.stat().st_size
            if total > LIMIT:
                file.unlink(missing_ok=True)
