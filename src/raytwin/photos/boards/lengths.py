"""Lengths as a user writes them: `30mm`, `3 cm`, `0.8in`."""

import re

from raytwin.errors import InputError

METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}
"""Metres per unit."""


def parse_length(text: str, where: str, zero: bool = False) -> float:
    """Return metres, to the nanometre. Raises InputError for a number without a unit, and for 0 unless `zero`."""
    match = re.fullmatch(r"\s*(\d{1,9}\.?\d{0,9}|\.\d{1,9})\s*(mm|cm|m|in)\s*", text, re.ASCII | re.IGNORECASE)
    metres = round(float(match[1]) * METRES[match[2].lower()], 9) if match else 0.0
    if not match or (metres == 0 and not zero):
        raise InputError(where, "a length with its unit (mm, cm, m, in), as 30mm or 0.8in", repr(text[:40]))
    return metres
