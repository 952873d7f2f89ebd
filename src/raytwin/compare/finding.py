"""What a comparison found, as a record: its kind, a sentence, and where in the image."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Bool

CHANNELS = ("red", "green", "blue")


class Kind(NamedTuple):
    """A kind of finding: its `rank`, worst first; what sort of `failure` it is; the `prefix` of its sentence."""

    rank: int = 0
    failure: str = "radiance"
    prefix: str = ""


HARD = 0
"""Rank of what is no image to compare: nothing else is asked then."""

KINDS = {
    "shape": Kind(HARD, "no such image"),
    "NaN": Kind(HARD, "not a number"),
    "infinite": Kind(HARD, "infinite values"),
    "negative": Kind(HARD, "negative values"),
    "black": Kind(HARD, "all black"),
    "silhouettes": Kind(1, "other objects are seen"),
    "shift": Kind(2),
    "depth": Kind(3, "depth"),
    "normals": Kind(4, "normals"),
    "image": Kind(5),
    "tile": Kind(6),
    "value": Kind(7),
    "exact": Kind(8),
    "below zero": Kind(9, "negative values"),
    "proved": Kind(prefix="cause (proved): "),
    "likely": Kind(prefix="cause (likely): "),
    "rounding": Kind(prefix="cause (likely): "),
    "unknown": Kind(prefix="cause unknown: "),
    "expected": Kind(prefix="Expected difference: "),
    "note": Kind(),
}
"""What is no image at all, then where things are, then how bright; below them why, and what else is said."""


CAUSES = "proved", "likely", "rounding", "unknown"
"""Kinds that say why an image is wrong; the last of them says only where."""


class Place(NamedTuple):
    """A part of the image that fails, in pixels."""

    x: int
    y: int
    width: int = 1
    height: int = 1


class Finding(NamedTuple):
    """`kind`: a row of KINDS; `text`: a sentence with pixel coordinates (x, y), x to the right; `place`: of what."""

    kind: str
    text: str
    place: Place | None = None

    @property
    def rank(self) -> int:
        return KINDS[self.kind].rank

    @property
    def names_a_cause(self) -> bool:
        """It says why the image is wrong, and not only where."""
        return self.kind in CAUSES[:-1]

    @property
    def reason(self) -> str:
        """The sentence as a person reads it."""
        return f"{KINDS[self.kind].prefix}{self.text}"


def notes(texts: Iterable[str]) -> tuple[Finding, ...]:
    return tuple(Finding("note", text) for text in texts)


BLOCK, MOST_PLACES = 16, 400
"""Pixels of the side of a place that holds single values; at most this many places of a kind are reported."""


def blocks_of(wrong: Bool[np.ndarray, "h w"], top: int, image_height: int) -> tuple[Place, ...]:
    """Where pixels of the rows from `top` on are `wrong`: blocks of BLOCK x BLOCK, cut at the image's edges."""
    ys, xs = np.nonzero(wrong)
    corners = np.unique(np.stack([(ys + top) // BLOCK, xs // BLOCK], axis=1), axis=0)[:MOST_PLACES] * BLOCK
    width = wrong.shape[1]
    return tuple(Place(x, y, min(BLOCK, width - x), min(BLOCK, image_height - y)) for y, x in corners.tolist())


def at(x: int, y: int) -> str:
    return f"(x={x}, y={y})"


def plural(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
