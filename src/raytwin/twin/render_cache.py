"""Renders stored between runs, under a hash of everything that decides their pixels."""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from raytwin import files
from raytwin.image import Image, Surface

CACHE = files.Cache("renders", ".npz", 2 << 30)
WORTH_KEEPING = 1.0
"""Seconds: a render that took less is not stored, since reading it back would save nothing."""


def cached(about: dict[str, str], size: tuple[int, int], use: bool, make: Callable[[], Image]) -> Image:
    """The image of this provenance and (width, height): the stored one where the cache is in `use`, else what `make`
    renders."""
    key = hashlib.sha256(repr(about).encode()).hexdigest()[:32]
    if use and (image := load(key, (*size[::-1], 3))) is not None:
        return image
    start = time.perf_counter()
    image = make()
    if use and time.perf_counter() - start > WORTH_KEEPING:
        store(key, image)
    return image


def load(key: str, shape: tuple[int, ...]) -> Image | None:
    """The image stored under `key`, of `shape` (H, W, 3); None where there is none, or one that no render can be."""

    def read(path: Path) -> Image | None:
        found = files.read_arrays(path)
        image = Image(
            found["mean"],
            found.get("variance"),
            int(found["samples"]),
            Surface(found["ids"], found["depth"], found["normal"]),
            int(found["batches"]) if "batches" in found else None,
        )
        return image if _is_whole(image, shape) else None

    return CACHE.load(key, read)


def _is_whole(image: Image, shape: tuple[int, ...]) -> bool:
    """A file in the cache may be of another's making: shapes, kinds and finiteness are those of a render."""
    s = image.surface
    if s is None:
        return False
    floats = [image.mean, s.normal, *([] if image.variance is None else [image.variance])]
    shapes = all(a.shape == shape for a in floats) and s.ids.shape == s.depth.shape == shape[:2]
    kinds = all(a.dtype == np.float32 for a in (*floats, s.depth)) and s.ids.dtype == np.int32
    return shapes and kinds and all(bool(np.isfinite(a).all()) for a in (*floats, s.depth)) and image.samples > 0


def store(key: str, image: Image) -> None:
    """Store the image; a cache that cannot be written is no error."""
    assert image.surface is not None  # the twin always has one
    parts: dict[str, Any] = {"mean": image.mean, "samples": image.samples}
    if image.variance is not None:
        parts["variance"] = image.variance
    if image.batches is not None:
        parts["batches"] = image.batches
    parts |= {"ids": image.surface.ids, "depth": image.surface.depth, "normal": image.surface.normal}
    CACHE.store(key, lambda to: np.savez(to, **parts))
