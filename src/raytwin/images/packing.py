"""Two images as the viewer's planes: a few bytes a pixel, deflated, decoded by values.js.

A plane (H, W) becomes 16-bit words, one of

    half    float16 of value * 2^-shift: 11 significant bits over nine decades below the largest value; the power of two
            keeps tiny errors off float16's coarse subnormals and bright pixels below its infinity
    steps   round(value / step), of which whole numbers (step 1) are a case

Where `left`, each row holds the differences (mod 2^16) from the left neighbour; all high bytes stand before all low
bytes: smooth images shrink to a fraction of a byte a value. The test image is stored as its error, t - r, which keeps
11 bits of its own, however small; t is r + error. Where there is noise, digits below it are noise, too: both are
rounded to the power of two between σ/16 and σ/8, with σ as the page knows it (6 bits).

Beyond a budget, only one pixel of each block of n x n is kept: the one that errs most, so that none falls between; of
noise, which would be the noisiest, the block's mean with its variance.
"""

import base64
import math
import zlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from raytwin.images.image import Image, Surface

MOST_PIXELS = 4_000_000
"""Above this the browser would hold more than 100 MB of values: planes are thinned, and photos are made smaller."""

BUDGET = 4_500_000
"""Deflated bytes of all planes. Noise hardly compresses: where the planes exceed this, they are thinned."""

MAX_PART_PIXELS = 1 << 16
"""Pixels of one part of the error, at most."""

DEPTH_STEPS = 4095
"""Steps from 0 to the largest depth, which keep three digits near it."""

DEFLATE_LEVEL = 4
"""A fifth smaller than level 1, in 1.5 times its time."""


@dataclass(frozen=True)
class Plane:
    """How values.js reads one plane: `value = word * step` or `half(word) * 2^shift`; `data` is base64 of deflate."""

    name: str
    kind: str
    left: bool
    shift: int
    step: float
    data: str


@dataclass(frozen=True)
class Packed:
    """Planes of `lines` rows and `columns` columns: of each block of `thin` x `thin` a pixel; if `binned`, its mean."""

    width: int
    height: int
    thin: int
    columns: int
    lines: int
    planes: tuple[Plane, ...]
    binned: bool = False

    def for_page(self) -> dict[str, Any]:
        """As the viewer takes it."""
        return asdict(self)


class _Raw(NamedTuple):
    """A plane before it is deflated: `words` (H, W) are float16 or int16."""

    kind: str
    words: np.ndarray
    left: bool = False
    shift: int = 0
    step: float = 1.0


def pack(
    test: Image,
    reference: Image,
    *,
    surfaces: bool = True,
    means: bool = False,
    budget: int = BUDGET,
    most_pixels: int = MOST_PIXELS,
) -> Packed:
    """Reference and error (R, G, B); σ where there is noise; ids and depths where both tell them.

    `means`: thinned as noise is, though no variance says so.
    """
    height, width = test.shape[:2]
    means = means or test.variance is not None or reference.variance is not None
    thin = max(1, math.ceil(math.sqrt(height * width / most_pixels)))
    while True:
        planes = _thinned(test, reference, surfaces, thin, means)
        packed = _deflated(planes)
        size = sum(len(plane.data) for plane in packed) * 0.75  # of base64's four characters three are bytes
        if size <= budget:
            break
        thin = max(thin + 1, math.ceil(thin * math.sqrt(size / budget)))
    lines, columns = next(iter(planes.values())).words.shape
    return Packed(width, height, thin, columns, lines, packed, means and thin > 1)


def binned(image: Image, n: int) -> Image:
    """Means over blocks of n x n, with their variance; the surface of each block's first pixel."""
    rows, columns = (np.arange(0, side, n) for side in image.mean.shape[:2])
    pixels = np.outer(
        *(np.diff(at, append=side) for at, side in zip((rows, columns), image.mean.shape[:2], strict=True))
    )

    def sums(x: np.ndarray) -> np.ndarray:
        return np.add.reduceat(np.add.reduceat(x, rows, axis=0), columns, axis=1)

    s = image.surface
    return Image(
        (sums(image.mean) / pixels[..., None]).astype(np.float32),
        None if image.variance is None else (sums(image.variance) / pixels[..., None] ** 2).astype(np.float32),
        image.samples,
        None if s is None else Surface(*(np.ascontiguousarray(x[::n, ::n]) for x in (s.ids, s.depth, s.normal))),
    )


def raw(test: Image, reference: Image) -> list[tuple[dict[str, Any], bytes]]:
    """The planes as they are, for a page on this machine: `feed` of the viewer takes them with `words`."""
    planes = _planes(test, reference, True)
    return [(_described(name, p), p.words.tobytes()) for name, p in planes.items()]


def pack_one(image: Image) -> tuple[Plane, ...]:
    """Return planes R, G, B of a picture that may take another's place: `update(name, await decode(planes))`.

    Digits below its noise are left out.
    """
    mean = np.asarray(image.mean, np.float32)
    if image.variance is not None:
        mean = to_noise(mean, rounded_sigma(image.variance))
    return _deflated({name: _half(mean[..., c], left=True) for c, name in enumerate("RGB")})


def pack_parts(pictures: Mapping[str, np.ndarray], step: int, noise: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return parts of an error (h, w, 3), of every `step`-th pixel, as the viewer's `divide` takes them.

    A part that is 0 is left out. `noise`: one standard deviation of a part; digits below it are left out, and many
    pixels are averaged in blocks.
    """
    found = _parts(pictures, step, noise)
    return [about | {"planes": [asdict(plane) for plane in _deflated(planes)]} for about, planes in found]


def raw_parts(
    pictures: Mapping[str, np.ndarray], step: int, noise: Mapping[str, float]
) -> list[tuple[dict[str, Any], tuple[bytes, ...]]]:
    """Return the same for a page on this machine: each plane's `words` are the bytes beside it."""
    return [
        (about | {"planes": [_described(name, p) for name, p in planes.items()]},
         tuple(p.words.tobytes() for p in planes.values()))
        for about, planes in _parts(pictures, step, noise)
    ]  # fmt: skip


def _parts(
    pictures: Mapping[str, np.ndarray], step: int, noise: Mapping[str, float]
) -> Iterator[tuple[dict[str, Any], dict[str, _Raw]]]:
    for name, picture in pictures.items():
        if not picture.any():
            continue
        sigma, n = noise.get(name, 0.0), math.ceil(math.sqrt(picture.shape[0] * picture.shape[1] / MAX_PART_PIXELS))
        mean = np.asarray(binned(Image(picture), n).mean, np.float32)
        if sigma:
            mean = to_noise(mean, np.full_like(mean, sigma / n))
        about = {"name": name, "step": step * n, "columns": mean.shape[1], "lines": mean.shape[0]}
        yield about, {c: _half(mean[..., k]) for k, c in enumerate("RGB")}


def _described(name: str, plane: _Raw) -> dict[str, Any]:
    return {"name": name, "kind": plane.kind, "left": False, "shift": plane.shift, "step": plane.step}


# ------------------------------------------------------------------------------------------ values


def _planes(test: Image, reference: Image, surfaces: bool) -> dict[str, _Raw]:
    planes: dict[str, _Raw] = {}
    variances = [i.variance for i in (test, reference) if i.variance is not None]
    for c, name in enumerate("RGB"):
        value = np.asarray(reference.mean[..., c], np.float32)
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.asarray(test.mean[..., c], np.float32) - value
            if variances:
                sigma = rounded_sigma(np.sum([v[..., c] for v in variances], axis=0))
                planes["s" + name] = _half(sigma)
                value, error = (to_noise(x, sigma) for x in (value, error))
        planes |= {name: _half(value, left=True), "d" + name: _half(error)}
    mine, theirs = test.surface, reference.surface
    if surfaces and mine is not None and theirs is not None:
        ids, step = theirs.ids.astype(np.int16), _largest(theirs.depth) / DEPTH_STEPS or 1.0
        depth, other = (_steps(x, step) for x in (theirs.depth, mine.depth))
        planes |= {"id": _Raw("steps", ids), "did": _Raw("steps", (mine.ids - theirs.ids).astype(np.int16))}
        planes |= {"depth": _Raw("steps", depth, True, 0, step), "ddepth": _Raw("steps", other - depth, False, 0, step)}
    return planes


def _half(values: np.ndarray, left: bool = False) -> _Raw:
    shift = math.frexp(top)[1] - 15 if (top := _largest(values)) > 0 else 0
    with np.errstate(over="ignore"):
        return _Raw("half", np.ldexp(values, -shift).astype(np.float16), left, shift)


def _largest(values: np.ndarray) -> float:
    """The largest finite magnitude; 0 if there is none."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


def _steps(values: np.ndarray, step: float) -> np.ndarray:
    return np.rint(np.nan_to_num(values / np.float32(step), posinf=0, neginf=0).clip(0, 2**14)).astype(np.int16)


def rounded_sigma(variance: np.ndarray) -> np.ndarray:
    """sqrt(variance) to 6 significant bits, float32."""
    m, e = np.frexp(np.sqrt(np.asarray(variance, np.float32)))
    return np.asarray(np.ldexp(np.rint(m * 64) / 64, e), np.float32)


def to_noise(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """`values` to whole multiples of 2^(floor(log2 sigma) - 3); as they are where there is no noise."""
    there = (sigma > 0) & np.isfinite(sigma) & np.isfinite(values)
    e = np.where(there, np.frexp(sigma)[1] - 4, 0)
    return np.where(there, np.ldexp(np.rint(np.ldexp(values, -e)), e), values).astype(np.float32)


# ------------------------------------------------------------------------------------------ fewer, and deflated


def _thinned(test: Image, reference: Image, surfaces: bool, n: int, means: bool) -> dict[str, _Raw]:
    """Return planes of one value for each block of n x n: its mean, or that of its worst pixel, which `at` tells."""
    if n == 1:
        return _planes(test, reference, surfaces)
    if means:
        return _planes(binned(test, n), binned(reference, n), surfaces)
    at, chosen = _worst_of_blocks(test, reference, n)
    a, b = (replace(i, mean=chosen(i.mean), surface=_chosen_surface(i.surface, chosen)) for i in (test, reference))
    return _planes(a, b, surfaces) | {"at": _Raw("steps", at.astype(np.int16))}


def _worst_of_blocks(test: Image, reference: Image, n: int) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Return row * n + column of each block's pixel of the largest error (the first of equals), and what takes these
    pixels from an array (H, W, ...)."""
    with np.errstate(invalid="ignore", over="ignore"):
        r, g, b = (np.abs(np.asarray(test.mean[..., c], np.float32) - reference.mean[..., c]) for c in range(3))
        size = np.maximum(np.maximum(r, g), b)
    size[np.isnan(size)] = np.inf
    h, w = size.shape
    lines, columns = math.ceil(h / n), math.ceil(w / n)
    padded = np.full((lines * n, columns * n), -1, np.float32)
    padded[:h, :w] = size
    at = padded.reshape(lines, n, columns, n).transpose(0, 2, 1, 3).reshape(lines, columns, n * n).argmax(axis=-1)
    y, x = np.ogrid[:lines, :columns]
    rows, places = y * n + at // n, x * n + at % n
    return at, lambda values: values[rows, places]


def _chosen_surface(surface: Surface | None, chosen: Callable[[np.ndarray], np.ndarray]) -> Surface | None:
    return None if surface is None else Surface(*map(chosen, (surface.ids, surface.depth, surface.normal)))


def _deflated(planes: Mapping[str, _Raw]) -> tuple[Plane, ...]:
    with ThreadPoolExecutor() as pool:
        return tuple(pool.map(lambda item: _encoded(*item), planes.items()))


def _encoded(name: str, raw: _Raw) -> Plane:
    words = np.ascontiguousarray(raw.words).view(np.uint16)
    if raw.left:
        words = np.diff(words, axis=1, prepend=np.uint16(0))  # unsigned: wraps, and so does the sum that undoes it
    pair = np.empty((2, *words.shape), np.uint8)
    np.right_shift(words, 8, out=pair[0], casting="unsafe")
    np.bitwise_and(words, 255, out=pair[1], casting="unsafe")
    data = base64.b64encode(zlib.compress(pair.data, DEFLATE_LEVEL)).decode("ascii")
    return Plane(name, raw.kind, raw.left, raw.shift, raw.step, data)
