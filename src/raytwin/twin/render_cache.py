"""Renders stored between runs, under a hash of everything that decides their pixels."""

import hashlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from raytwin import files
from raytwin.image import Image, Surface

CACHE = files.Cache("renders", ".npz", 2 << 30)
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
    """The image stored under `key`; None where there is none."""
    if (found := CACHE.load_arrays(key)) is None:
        return None
    batches = int(found["batches"]) if "batches" in found else None
    surface = Surface(found["ids"], found["depth"], found["normal"])
    return Image(
        found["mean"], found.get("variance"), int(found["samples"]), surface, batches, third=found.get("third")
    )


def store(key: str, image: Image) -> None:
    """Store the image; a cache that cannot be written is no error."""
    assert image.surface is not None  # the twin always has one
    parts: dict[str, Any] = {"mean": image.mean, "samples": np.array(image.samples)}
    if image.variance is not None:
        parts["variance"] = image.variance
    if image.third is not None:
        parts["third"] = image.third
    if image.batches is not None:
        parts["batches"] = np.array(image.batches)
    parts |= {"ids": image.surface.ids, "depth": image.surface.depth, "normal": image.surface.normal}
    CACHE.store_arrays(key, parts)
