"""A thing that is wrong with an image, in words, and how it ranks among others."""

from typing import NamedTuple

CHANNELS = ("red", "green", "blue")

# Worst first: what is no image at all, then where things are, then how bright.
HARD, SILHOUETTE, SHIFT, DEPTH, NORMAL, IMAGE, TILE, VALUE, EXACT = range(9)


class Finding(NamedTuple):
    """`rank` is one of the constants above; `text` a sentence with pixel coordinates (x, y), x to the right."""

    rank: int
    text: str


def at(x: int, y: int) -> str:
    return f"(x={x}, y={y})"


def plural(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
