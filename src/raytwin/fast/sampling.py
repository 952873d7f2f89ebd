"""Random numbers by counting: the same pixel, batch, index, bounce and seed give the same numbers on every engine.

No state is carried from one number to the next, so neither the order of the pixels nor their tiling matters. The
samples of a batch are, at each bounce, points of Sobol's (0, 2) sequence: the first 2ᵏ of them have one in each cell of
area 2⁻ᵏ, however long or wide. Owen's scrambling makes each uniform and independent of other batches, so that the
spread of the batches gives the error of their mean, and shuffles the points of each bounce differently (Burley,
"Practical Hash-based Owen Scrambling", JCGT 9(4), 2020). For a smooth integrand the error falls faster than by chance.
"""

from typing import Any

import numpy as np

from raytwin.tracer.arrays import library
from raytwin.tracer.lights.lookup import as_floats

BATCHES = 16
"""Independent means of a pixel's samples, whose spread gives the variance: as many as the twin's."""


def sobol_pair(like: Any, pixel: Any, batch: Any, index: Any, seed: Any, bounce: Any) -> tuple[Any, Any]:
    """Two numbers in [0, 1), multiples of 2⁻²⁴, in floats as `like`, whose shape `pixel` has.

    The hash is pcg4d: Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
    """
    keys = (pixel, batch, bounce, seed)
    x, y, z, w = (as_unsigned(like, key) * 1664525 + 1013904223 for key in keys)
    for _ in range(2):
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
        x, y, z, w = (n ^ (n >> 16) for n in (x, y, z, w))
    digits = scrambled(reverse_bits(as_unsigned(like, index)), z)
    a, b = scrambled(digits, x), scrambled(second_of_sobol(digits), y)
    return as_floats(like, a >> 8) * 2.0**-24, as_floats(like, b >> 8) * 2.0**-24


def second_of_sobol(index: Any) -> Any:
    """The binary digits of a point's second coordinate, lowest bit first; those of the first are `index` itself.

    Bit i is the sum of bits k >= i of `index` times (k over i), modulo 2: Pascal's triangle as a matrix, which takes
    one step for each doubling (Ahmed, "An Implementation Algorithm of 2D Sobol Sequence", 2024).
    """
    for step, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF)):
        index = index ^ ((index >> step) & mask)
    return index


def scrambled(digits: Any, seed: Any) -> Any:
    """Owen's scrambling of binary digits, lowest bit first; the result has its highest bit first.

    Each is flipped or not by a hash of `seed` and those before it (Laine and Karras 2011; constants: Vegdahl 2021).
    """
    n = digits ^ (digits * 0x3D20ADEA)
    n = (n + seed) * ((seed >> 16) | 1)
    n = n ^ (n * 0x05526C56)
    return reverse_bits(n ^ (n * 0x53A22864))


def as_unsigned(like: Any, value: Any) -> Any:
    """Integers modulo 2³², as many as `like` has numbers."""
    if (xp := library(like)) is np:
        return np.broadcast_to(np.asarray(value).astype(np.uint32), np.shape(like))
    return xp.uint32_array_t(type(like))(value)


def reverse_bits(x: Any) -> Any:
    """Integers modulo 2³² with their bits in reverse order."""
    if (xp := library(x)) is not np:
        return xp.brev(x)
    for step, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        x = ((x >> step) & mask) | ((x & mask) << step)
    return (x >> 16) | (x << 16)
