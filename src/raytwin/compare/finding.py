"""A thing that is wrong with an image, in words, and how it ranks among others."""

from typing import NamedTuple

import numpy as np

CHANNELS = ("red", "green", "blue")

# Worst first: what is no image at all, then where things are, then how bright.
HARD, SILHOUETTE, SHIFT, DEPTH, NORMAL, IMAGE, TILE, VALUE, EXACT = range(9)


class Finding(NamedTuple):
    """`rank` is one of the constants above; `text` a sentence with pixel coordinates (x, y), x to the right."""

    rank: int
    text: str


class Place(NamedTuple):
    """A part of the image that fails, in pixels."""

    x: int
    y: int
    width: int
    height: int

    def above(self, edge: int) -> "Place":
        """Itself, cut at the image's lower edge."""
        return self._replace(height=min(self.height, edge - self.y))


BLOCK, MOST_PLACES = 16, 400
"""Pixels of the side of a place that holds single values; at most this many places of a kind are reported."""


def blocks_of(wrong: np.ndarray, y0: int) -> tuple[Place, ...]:
    """Where pixels (h, w) bool of the rows from y0 on are `wrong`: blocks of BLOCK x BLOCK, cut at the right alone."""
    ys, xs = np.nonzero(wrong)
    at_ = np.unique(np.stack([(ys + y0) // BLOCK, xs // BLOCK], axis=1), axis=0)[:MOST_PLACES] * BLOCK
    return tuple(Place(x, y, min(BLOCK, wrong.shape[1] - x), BLOCK) for y, x in at_.tolist())


def at(x: int, y: int) -> str:
    return f"(x={x}, y={y})"


def plural(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
