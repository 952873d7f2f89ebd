"""Parse the texts of options, and check that outputs can be written, before any work begins."""

import math
import os
import re
from pathlib import Path
from typing import Any

from raytwin.errors import InputError

MAX_SIDE = 100_000
"""Largest width or height of a picture, in pixels, that is not taken for a typing error."""


def parse_size(text: str, option: str) -> tuple[int, int]:
    """
    >>> parse_size("640x480", "--size")
    (640, 480)
    """
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text)
    if not match or not all(0 < int(side) <= MAX_SIDE for side in match.groups()):
        raise InputError(option, "WIDTHxHEIGHT in pixels, as 640x480", text)
    from raytwin.images.limits import MAX_PIXELS

    width, height = int(match[1]), int(match[2])
    if width * height > MAX_PIXELS:
        gigabytes = 12e-9 * width * height
        raise InputError(option, f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{text}, {gigabytes:.0f} GB an image")
    return width, height


def parse_numbers(text: str, option: str) -> tuple[float, ...]:
    """Finite numbers, as many as there are.

    >>> parse_numbers("0.1,0.2", "--sizes"), parse_numbers("", "--sizes")
    ((0.1, 0.2), ())
    """
    try:
        numbers = tuple(float(part) for part in text.split(",")) if text.strip() else ()
    except ValueError:
        raise InputError(option, "numbers separated by commas", text) from None
    if not all(map(math.isfinite, numbers)):
        raise InputError(option, "finite numbers", text)
    return numbers


def parse_placed(text: str, option: str, names: str) -> Any:
    """Return as many numbers as `names` has, in metres, each with or without a unit; the last is a length above 0.

    >>> parse_placed("-60mm,0.15,2cm", "--stand", "x,y,h")
    (-0.06, 0.15, 0.02)
    """
    from raytwin.photos.boards.lengths import parse_length  # OpenCV comes with it

    def metres(part: str) -> float:
        if not part[-1:].isalpha():
            return parse_numbers(part or "nothing", option)[0]
        return (-1 if part.startswith("-") else 1) * parse_length(part.removeprefix("-"), option, zero=True)

    numbers = tuple(metres(part.strip()) for part in text.split(","))
    if len(numbers) != len(names.split(",")) or not numbers[-1] > 0:
        raise InputError(option, f"{names} in metres or with units (20mm), {names[-1]} > 0", text)
    return numbers


def check_outputs(*, folders: tuple[Path | None, ...] = (), files: tuple[Path | None, ...] = ()) -> None:
    """Raise InputError if an output cannot be written. Creates nothing."""
    kinds = {True: "a folder", False: "a file"}
    for path, folder in (*((p, True) for p in folders if p), *((p, False) for p in files if p)):
        if any("\ud800" <= c <= "\udfff" for c in str(path)):  # bytes that are no text
            raise InputError("the name of an output", "UTF-8", ascii(str(path)))
        if path.exists():
            if path.is_dir() != folder:
                raise InputError(path, f"{kinds[folder]} to write", kinds[not folder])
            above = path
        else:
            above = next(p for p in path.absolute().parents if p.exists())
            if not above.is_dir():
                raise InputError(path, "a writable path", f"{above}, which is a file")
        if not os.access(above, os.W_OK):
            raise InputError(path, "a writable path", "one without write permission")
