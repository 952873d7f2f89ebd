"""Lengths and paper sizes as a user writes them: `30mm`, `0.8in`, `letter`, `200mmx300mm`."""

import re
from decimal import Decimal

from raytwin.errors import InputError

UNITS = {"mm": "0.001", "cm": "0.01", "m": "1", "in": "0.0254", "inch": "0.0254"}
"""Metres, exactly."""

PAPERS = {
    "a4": ("210mm", "297mm"),
    "a3": ("297mm", "420mm"),
    "letter": ("8.5in", "11in"),
    "legal": ("8.5in", "14in"),
    "tabloid": ("11in", "17in"),
}
"""Width and height, upright."""

LONGEST = 5.0
"""Metres: a PDF's page goes up to 200 inches."""

_LENGTH = re.compile(r"\s*([0-9]{1,12}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})\s*([a-z]*)\s*", re.ASCII | re.IGNORECASE)


def parse_length(text: str, where: str, zero: bool = False) -> float:
    """Return metres, the nearest double, of `30mm`, `3 cm`, `0.03 m`, `0.8in` or `.8 inch`.

    Raises InputError for a number without a unit, and outside (0, LONGEST], or [0, LONGEST] with `zero`.
    """
    want = "a length with its unit (mm, cm, m, in), as 30mm or 0.8in"
    match = _LENGTH.fullmatch(text)
    if not match or (match[2] and match[2].lower() not in UNITS):
        raise InputError(where, want, repr(text[:40]))
    if not match[2]:
        raise InputError(where, want, f"{text.strip()} without a unit")
    metres = float(Decimal(match[1]) * Decimal(UNITS[match[2].lower()]))
    if not (metres > 0 or (zero and metres == 0)) or metres > LONGEST:
        raise InputError(where, f"{'0' if zero else 'more than 0'} to {LONGEST:g} m", text.strip())
    return metres


def parse_paper(text: str, where: str) -> tuple[float, float]:
    """(width, height), metres, of a name in PAPERS or of `200mmx300mm`."""
    width, height = PAPERS.get(text.strip().lower(), text.lower().partition("x")[::2])
    if not height:
        raise InputError(where, f"{', '.join(PAPERS)}, or WIDTHxHEIGHT as 200mmx300mm", repr(text[:40]))
    return parse_length(width, where), parse_length(height, where)
