"""The everyday word for a colour."""

import colorsys
from collections.abc import Sequence

GREYEST, BLACKEST, WHITEST = 0.25, 0.06, 0.7
"""Saturation below which a colour is a grey; lightness (HSV's value, of linear light) of black and of white."""
HUES = (
    (20, "red"), (45, "orange"), (70, "yellow"), (165, "green"), (195, "cyan"), (265, "blue"), (300, "purple"),
    (340, "pink"), (360, "red"),
)  # fmt: skip
"""Degrees up to which a hue has its name."""


def colour_word(albedo: Sequence[float]) -> str:
    """Return the everyday word for a linear colour.

    >>> [colour_word(c) for c in ((0.75, 0.2, 0.15), (0.2, 0.35, 0.8), (0.6, 0.6, 0.6), (0.36, 0.25, 0.17), (0.9,) * 3)]
    ['red', 'blue', 'grey', 'brown', 'white']
    """
    hue, saturation, value = colorsys.rgb_to_hsv(*albedo)
    if saturation < GREYEST or value < BLACKEST:
        return "black" if value < BLACKEST else "white" if value > WHITEST else "grey"
    word = next(word for end, word in HUES if 360 * hue <= end)
    return "brown" if word in ("red", "orange") and value < 0.45 and saturation < 0.7 else word
