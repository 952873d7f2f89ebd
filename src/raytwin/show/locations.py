"""Links from a verdict's findings to places in its pictures."""

from collections.abc import Iterable, Sequence

from raytwin.compare.finding import Finding

AROUND = 48
"""Pixels across the view that a link opens; a tile larger than a third of it gets three times its own side."""


Reason = tuple[str, str | None]
"""The text of a reason, and the address of its place in the picture, or None."""


def linked(findings: Iterable[Finding], shape: Sequence[int]) -> tuple[list[Reason], list[dict[str, int]]]:
    """Return each finding's reason with the address of its place, and the places themselves, each once.

    `shape`: the image's. A finding about the whole image leads to all of it.
    """
    found: list[Reason] = []
    places: list[dict[str, int]] = []
    for finding in findings:
        address, place = "#whole" if finding.kind == "image" else None, finding.place
        if address is None and place is not None and len(shape) > 1 and place.x < shape[1] and place.y < shape[0]:
            x, y = place.x + place.width // 2, place.y + place.height // 2
            address = f"#pixel={x},{y},{max(AROUND, 3 * max(place.width, place.height))}"
            if place._asdict() not in places:
                places.append(place._asdict())
        found.append((finding.reason, address))
    return found, places
