"""Float images for the browser's pixel inspector: a few bytes a pixel, deflated, decoded by report.js.

A plane (H, W) becomes 16-bit words, one of

    half    float16 of value * 2^-shift: 11 significant bits over nine decades below the largest value; the power of two
            keeps tiny errors off float16's coarse subnormals and bright pixels below its infinity
    even    round(value / step): equal steps over the plane's range, for depth
    whole   the integer itself

Each row then holds the differences (mod 2^16) from its left neighbour where that is smaller, and all high bytes stand
before all low bytes: smooth images shrink to about a byte a value. The test image is not stored: it is reference +
error, and that sum is exact to the error's digits.
"""

import base64
import math
import zlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from raytwin.image import Image

MOST_PIXELS = 4_200_000
"""Above this the browser would hold more than 80 MB of values: the planes are thinned."""

BUDGET = 6_000_000
"""Deflated bytes of all planes. Noise does not shrink; where it exceeds this, the planes are thinned."""


@dataclass(frozen=True)
class PackedPlane:
    """How report.js reads one plane: `value = word * step` or `half(word) * 2^shift`; `data` is base64 of deflate."""

    name: str
    kind: str
    differences: bool
    shift: int
    step: float
    data: str


@dataclass(frozen=True)
class Values:
    """Planes of ceil(H / thin) rows and ceil(W / thin) columns: every `thin`-th pixel, from pixel (0, 0) on."""

    width: int
    height: int
    thin: int
    planes: tuple[PackedPlane, ...]


def pack_values(
    test: Image, reference: Image, budget: int = BUDGET, most_pixels: int = MOST_PIXELS, surfaces: bool = True
) -> Values:
    """Reference and error (R, G, B), and ids and depths where both renderers tell them (and `surfaces` is set)."""
    planes = _planes(test, reference, surfaces)
    height, width = test.shape[:2]
    thin = max(1, math.ceil(math.sqrt(height * width / most_pixels)))
    # A sixteenth of the rows, in bands, tells what the whole will take.
    bands = np.arange(height).reshape(-1, 1) // 8 % 16 == 0
    sample = {n: (kind, p[bands[:, 0]]) for n, (kind, p) in planes.items()}
    estimate = sum(len(p.data) for p in _packed(sample)) * 0.75 * height / max(int(bands.sum()), 1)
    thin = max(thin, math.ceil(math.sqrt(estimate / budget)))
    packed = _packed({n: (kind, p[::thin, ::thin]) for n, (kind, p) in planes.items()})
    return Values(math.ceil(width / thin), math.ceil(height / thin), thin, packed)


def _planes(test: Image, reference: Image, surfaces: bool) -> dict[str, tuple[str, np.ndarray]]:
    planes = {}
    with np.errstate(invalid="ignore", over="ignore"):
        for c, name in enumerate("RGB"):
            planes[name] = "half", reference.mean[..., c]
            planes["d" + name] = "half error", test.mean[..., c] - reference.mean[..., c]
        a, b = test.surface, reference.surface
        if surfaces and a is not None and b is not None:
            planes |= {"id": ("whole", a.ids), "id_reference": ("whole", b.ids)}
            planes |= {"depth": ("even", b.depth), "ddepth": ("half error", a.depth - b.depth)}
    return planes


def _packed(planes: Mapping[str, tuple[str, np.ndarray]]) -> tuple[PackedPlane, ...]:
    with ThreadPoolExecutor() as pool:
        return tuple(pool.map(lambda item: _pack(item[0], *item[1]), planes.items()))


def _pack(name: str, kind: str, plane: np.ndarray) -> PackedPlane:
    shift, step, differences = 0, 1.0, kind != "half error"
    top = float(np.max(np.abs(plane), where=np.isfinite(plane), initial=0.0))
    if kind == "whole":
        words = plane.astype(np.int16).view(np.uint16)
    elif kind == "even":
        step = top / 65535 or 1.0
        plane = np.nan_to_num(plane, posinf=top, neginf=0.0) / np.float32(step)
        words = np.rint(plane).clip(0, 65535).astype(np.uint16)
    else:
        shift = math.frexp(top)[1] - 15 if top > 0 else 0
        with np.errstate(over="ignore"):
            words = np.ldexp(np.asarray(plane, np.float32), -shift).astype(np.float16).view(np.uint16)
    if differences:
        words = np.diff(words, axis=1, prepend=np.uint16(0))  # unsigned: wraps, and so does the sum that undoes it
    pair = np.stack([words >> 8, words & 255]).astype(np.uint8)
    data = base64.b64encode(zlib.compress(pair.tobytes(), 1)).decode("ascii")
    return PackedPlane(name, kind.split()[0], differences, shift, step, data)
