"""Where the reasons of a verdict are: the coordinates that their words give."""

import re
from collections.abc import Iterable, Sequence

PLACE = re.compile(r"(?:(\d+) x (\d+) tile at )?\(x=(\d+), y=(\d+)\)")
"""`the 16 x 16 tile at (x=32, y=48)`, or a pixel: as compare.finding.at writes it."""

AROUND = 48
"""Pixels across what is shown around a pixel; a tile gets three times its side."""


Reason = tuple[str, str | None]
"""What is said, and the address of its place in the picture."""


def linked(reasons: Iterable[str], shape: Sequence[int]) -> tuple[list[Reason], list[dict[str, int]]]:
    """Each reason with the address of its place, or None, and the places themselves, each once: (x, y, width, height).

    `shape`: the image's. A reason about the whole image leads to all of it.
    """
    found: list[Reason] = []
    places: list[dict[str, int]] = []
    for text in reasons:
        match = PLACE.search(text)
        address = "#whole" if text.startswith("the whole image") else None
        if match and len(shape) > 1:
            width, height, x, y = (int(n or 1) for n in match.groups())
            if x < shape[1] and y < shape[0]:
                address = f"#pixel={x + width // 2},{y + height // 2},{max(AROUND, 3 * max(width, height))}"
                place = {"x": x, "y": y, "width": width, "height": height}
                if place not in places:
                    places.append(place)
        found.append((text, address))
    return found, places
