"""Random numbers by counting: the same pixel, batch, place, bounce and seed draw the same numbers on every engine.

No state is carried from one number to the next, so that neither the order of the pixels nor their tiling matters.
The samples of a batch lie on a lattice, which fills a pixel's integral more evenly than chance does; a shift at random
makes each sample uniform, and batches are independent, so that their spread tells the error of their mean (Cranley and
Patterson, SIAM J. Numer. Anal. 13(6), 1976).
"""

from math import isqrt
from typing import Any

from raytwin.tracer.arrays import floats, look_up, unsigned

PRIMES = [n for n in range(2, 312) if all(n % k for k in range(2, isqrt(n) + 1))]
STEPS = [isqrt(p << 64) & 0xFFFFFFFF for p in PRIMES]
"""The lattice's step in each dimension, in parts of 2³²: the fraction of a prime's square root (Richtmyer, 1951)."""


BATCHES = 16
"""Independent means of a pixel's samples, whose spread tells the variance: as many as the twin's."""


def places(samples: int) -> list[tuple[int, int]]:
    """(batch, place) of each of a pixel's samples; the first batches have one more where they do not share evenly."""
    number = min(BATCHES, samples)
    return [(b, i) for b in range(number) for i in range(samples // number + (b < samples % number))]


def draw(like: Any, pixel: Any, batch: Any, place: Any, seed: Any, bounce: Any) -> tuple[Any, Any]:
    """Two numbers in [0, 1), multiples of 2⁻²⁴, in floats as `like`, whose shape `pixel` has.

    The hash is pcg4d: Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
    """
    keys = (pixel, batch, bounce, seed)
    x, y, z, w = (unsigned(like, key) * 1664525 + 1013904223 for key in keys)
    for _ in range(2):
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
        x, y, z, w = (n ^ (n >> 16) for n in (x, y, z, w))
    row = unsigned(like, bounce) % (len(STEPS) // 2) * 2
    a, b = (shift + unsigned(like, place) * look_up(STEPS, row + k) for k, shift in enumerate((x, y)))
    return floats(like, a >> 8) * 2.0**-24, floats(like, b >> 8) * 2.0**-24
