"""What wrong numbers look like, in sixteen numbers: two submissions that make the same mistake have the same ones.

The errors of all values, relative to the largest that is expected, are projected onto sixteen fixed patterns of signs,
which keeps the distances between them (Johnson and Lindenstrauss). Functions and drawn pictures are asked for the cases
of one seed, the same in every class and every year, for this alone.

Naming one wrong result names all that equal it: Nguyen, Piech, Huang and Guibas, Codewebs (2014); Glassman et al.,
OverCode (2015).
"""

from collections.abc import Sequence

import numpy as np

PROBE_SEED = 1_618_033
"""Draws the cases that fingerprints are taken of; no points depend on them, so anyone may know it."""
NUMBERS = 16
"""Projections of the errors that make a fingerprint: more tell more mistakes apart."""
SAME_MISTAKE_WITHIN = 2e-3
"""Share of the largest number: fingerprints that differ by less everywhere are of the same mistake."""
LARGEST_ERROR = 10.0
"""Relative error from which on it makes no difference how wrong a value is; half of it: finite where it should not be,
or the reverse."""
ROUNDING_ERROR = 1e-9
"""Relative errors up to this are none: what is correct but for rounding would be taken for one mistake of many."""


def fingerprint(expected: Sequence[np.ndarray], got: Sequence[np.ndarray]) -> str:
    """Return the numbers as text; empty where the shapes differ or nothing is wrong."""
    if [a.shape for a in expected] != [a.shape for a in got]:
        return ""
    errors = np.concatenate([_errors(a, b).ravel() for a, b in zip(expected, got, strict=True)])
    if not (np.abs(errors) > ROUNDING_ERROR).any():
        return ""
    signs = np.random.default_rng(0).integers(0, 2, (NUMBERS, errors.size), dtype=np.int8) * 2 - 1
    return " ".join(f"{x:.4g}" for x in signs @ errors / np.sqrt(errors.size))


def _errors(expected: np.ndarray, got: np.ndarray) -> np.ndarray:
    """By the largest finite value that is expected."""
    there = np.isfinite(expected)
    scale = np.abs(expected[there]).max(initial=0.0) or 1.0
    with np.errstate(all="ignore"):
        errors = np.clip((got - expected) / scale, -LARGEST_ERROR, LARGEST_ERROR)
    seen = np.isfinite(got)
    errors = np.where(there & ~seen, LARGEST_ERROR / 2, np.where(~there & seen, -LARGEST_ERROR / 2, errors))
    return np.where(there | seen, errors, 0.0)


def is_fingerprint(text: str) -> bool:
    """Whether the text holds as many finite numbers as a fingerprint has."""
    try:
        return len(text.split()) == NUMBERS and bool(np.isfinite(numbers(text)).all())
    except ValueError:
        return False


def numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])


def same(one: str, other: str) -> bool:
    """
    >>> same("1 2 " * 8, "1.001 2 " * 8), same("1 2 " * 8, "1.1 2 " * 8), same("", "")
    (True, False, False)
    """
    if not (one and other):
        return False
    x, y = numbers(one), numbers(other)
    return bool(np.abs(x - y).max() <= SAME_MISTAKE_WITHIN * min(np.abs(x).max(), np.abs(y).max()))
