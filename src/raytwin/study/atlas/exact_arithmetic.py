"""The truth about rays and spheres, to 60 digits: Python's own decimal numbers hold every float exactly."""

from collections.abc import Iterable
from decimal import Context, Decimal, localcontext
from math import inf

import numpy as np

DIGITS = Context(prec=60, Emin=-(10**6), Emax=10**6)
"""The range of exponents is wide enough for the squares of the largest and the smallest floats."""


def hit(origin: Iterable[float], d: Iterable[float], center: Iterable[float], radius: float) -> float:
    """The least t > 0 with |origin + t d - center| = radius, d of any length; infinity for a miss."""
    with localcontext(DIGITS):
        along = [Decimal(float(v)) for v in d]
        f = [Decimal(float(o)) - Decimal(float(c)) for o, c in zip(origin, center, strict=True)]
        a, b, c = (dot(*pair) for pair in ((along, along), (f, along), (f, f)))
        c -= Decimal(float(radius)) ** 2
        disc = b * b - a * c
        if disc < 0:
            return inf
        near, far = (-b - disc.sqrt()) / a, (-b + disc.sqrt()) / a
        return float(near if near > 0 else far) if far > 0 else inf


def dot(a: Iterable[Decimal], b: Iterable[Decimal]) -> Decimal:
    return sum((v * w for v, w in zip(a, b, strict=True)), Decimal(0))


def hits(origin: np.ndarray, d: np.ndarray, center: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(n,): `hit` of each row of origin, d, center (n, 3) and radius (n,)."""
    return np.array([hit(*row) for row in zip(origin, d, center, radius, strict=True)])
