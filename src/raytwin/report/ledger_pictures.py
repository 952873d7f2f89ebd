"""Small signed pictures of the ledger's parts: where each makes the image too bright (red) or too dark (blue)."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from raytwin.compare.heatmap import error_scale
from raytwin.image import Image
from raytwin.report import data_urls

if TYPE_CHECKING:
    from raytwin.analysis.ledger import Ledger

WIDE = 144
"""Pixels across, at most."""


class Small(NamedTuple):
    """`url`: a PNG; `scale`: the radiance, of all channels' mean, that has the full colour."""

    url: str
    scale: float
    width: int
    height: int


def small_pictures(ledger: "Ledger | None") -> dict[str, Small]:
    """part -> its picture: means of blocks, in which noise averages out; none of a part that is 0."""
    found = {}
    for name, picture in (ledger.pictures if ledger else {}).items():
        side = math.ceil(picture.shape[1] / WIDE)
        h, w = (max(n // side, 1) for n in picture.shape[:2])
        blocks = picture[: h * side, : w * side].reshape(h, min(side, picture.shape[0]), w, side, 3)
        mean = np.ascontiguousarray(blocks.mean(axis=(1, 3, 4), dtype=float), np.float32)
        grey = Image(np.repeat(mean[..., None], 3, axis=-1))
        scale = error_scale(grey, Image(np.zeros_like(grey.mean)))
        if mean.any():
            indices = data_urls.error_indices(mean, data_urls.Scale(0.0, scale, False))
            found[name] = Small(data_urls.png_url(indices, data_urls.palette()), scale, w, h)
    return found
