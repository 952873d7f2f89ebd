"""Noise as renderers make it, made up where the truth is known: pairs of correct images, and the same with a fault.

`KINDS` is the table: a name to a function (rng, truth, fault) -> (test, reference). `fault` is multiplied into the
test's truth; 1 makes a correct pair, which must not fail.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from raytwin.images.image import Image

Pair = tuple[Image, Image]
Maker = Callable[..., tuple[Image, Image]]


def picture(height: int = 40, width: int = 56) -> np.ndarray:
    """A disc on a ramp, (H, W, 3) float64: an edge, a slope and three colours."""
    y, x = np.mgrid[:height, :width]
    disc = np.hypot(x - 0.45 * width, y - 0.45 * height) < 0.33 * height
    return (0.3 + 0.5 * disc + 0.2 * y / height)[..., None] * np.array([1, 0.8, 0.6])


def render(
    rng: np.random.Generator,
    truth: np.ndarray,
    samples: int = 16,
    batches: int = 16,
    kind: str = "gauss",
    sd: float = 0.3,
    p: float = 0.0,
    size: float = 0.0,
    proportional: bool = False,
    places: float = 1.0,
) -> Image:
    """Batches of `samples` in all: relative noise `sd`, and an event `size` with probability `p` a sample.

    Events add radiance `size`, or `size` times the pixel's where `proportional`; the mean contains them. Only this
    share of the pixels has any: `places`, always the same ones.
    """
    m = samples // batches
    total = np.zeros(truth.shape)
    squares = np.zeros(truth.shape)
    lit = event(truth, size, proportional, places)
    for _ in range(batches):
        if kind == "gauss":
            noise = rng.normal(scale=1 / math.sqrt(m), size=truth.shape)
        else:
            noise = rng.gamma(m, 1 / m, truth.shape) - 1
        x = truth + sd * truth * noise
        if p:
            x = x + rng.poisson(p * m, (*truth.shape[:2], 1)) * (lit / m)
        total += x
        squares += x * x
    mean = total / batches
    variance = np.maximum(squares / batches - mean * mean, 0) / (batches - 1)
    if p == 0:
        mean = np.maximum(mean, 0)
    return Image(mean.astype(np.float32), variance.astype(np.float32), samples, None, batches)


def event(truth: np.ndarray, size: float, proportional: bool, places: float) -> np.ndarray:
    """What one event adds to a sample of each pixel, (H, W, 3)."""
    there = np.random.default_rng(5).random((*truth.shape[:2], 1)) < places
    return size * (truth if proportional else np.ones_like(truth)) * there


def exact(
    truth: np.ndarray, p: float = 0.0, size: float = 0.0, proportional: bool = False, places: float = 1.0
) -> Image:
    """The truth itself, events included."""
    return Image((truth + p * event(truth, size, proportional, places)).astype(np.float32))


FILTERS: dict[str, tuple[float, Callable[[np.ndarray], np.ndarray]]] = {
    "box": (0.5, lambda x: (np.abs(x) <= 0.5) * 1.0),
    "tent": (1.0, lambda x: np.maximum(1 - np.abs(x), 0)),
    # Mitsuba's default: standard deviation 0.5, cut at four of them.
    "Mitsuba's Gaussian": (2.0, lambda x: np.maximum(np.exp(-2 * x * x) - math.exp(-8), 0)),
    "Gaussian, 1 pixel": (4.0, lambda x: np.maximum(np.exp(-x * x / 2) - math.exp(-8), 0)),
}
"""Reconstruction filters: radius in pixels, and the weight at a distance along one axis."""


def filtered(
    rng: np.random.Generator, truth: np.ndarray, name: str, samples: int = 16, batches: int = 16, sd: float = 1.0
) -> Image:
    """Samples anywhere in each pixel, each splatted over all pixels that the filter reaches: neighbours share noise."""
    radius, weight = FILTERS[name]
    reach = math.ceil(radius + 0.5)
    h, w, _ = truth.shape
    pad = ((reach, reach), (reach, reach), (0, 0))
    wide = np.pad(truth, pad, mode="edge")
    made = []
    for _ in range(batches):
        total = np.zeros((4, h, w))  # light, and the weight that it came with
        for _ in range(samples // batches):
            light = wide * rng.gamma(1 / sd**2, sd**2, wide.shape)
            value = np.stack([*np.moveaxis(light, -1, 0), np.ones(wide.shape[:2])])
            u, v = rng.uniform(-0.5, 0.5, (2, *wide.shape[:2]))
            across = [weight(dx + u) for dx in range(-reach, reach + 1)]
            for dy in range(2 * reach + 1):
                row = (weight(dy - reach + v) * value)[:, dy : dy + h]
                for dx, share in enumerate(across):
                    total += share[dy : dy + h, dx : dx + w] * row[..., dx : dx + w]
        total, below = np.moveaxis(total[:3], 0, -1), total[3][..., None]
        # An empty pixel of a narrow filter keeps its truth: no renderer leaves one here.
        made.append(np.where(below > 0, total / np.maximum(below, 1e-12), truth))
    stack = np.array(made)
    variance = stack.var(axis=0, ddof=1) / batches
    return Image(stack.mean(axis=0).astype(np.float32), variance.astype(np.float32), samples, None, batches)


def quantised(image: Image) -> Image:
    """As 8-bit sRGB keeps it."""
    from raytwin.images.photo_files import from_bytes, to_bytes

    return replace(image, mean=from_bytes(to_bytes(np.clip(image.mean, 0, 1))))


def half_steps(name: str, test: Image, reference: Image) -> tuple[np.ndarray | None, np.ndarray | None]:
    """What a kind's formats round off, as `diff` finds it out of the files."""
    from raytwin.images.stored_precision import half_code

    sides = EIGHT_BITS.get(name, (False, False))
    test_half, reference_half = (
        half_code(i.mean) if coded else None for i, coded in zip((test, reference), sides, strict=True)
    )
    return test_half, reference_half


def untold(image: Image, samples: int = 0) -> Image:
    """Without its variance, and with another count of samples (0: not told)."""
    return replace(image, variance=None, samples=samples, batches=None)


def times(image: Image, factor: float | np.ndarray) -> Image:
    f = np.asarray(factor, np.float32)
    variance = None if image.variance is None else image.variance * f * f
    return replace(image, mean=image.mean * f, variance=variance)


def pair(test: dict, reference: dict | None, both: dict | None = None) -> Maker:
    """A render of `test`'s settings against one of `reference`'s (None: the truth)."""
    shared = both or {}

    def make(rng, truth, fault=1.0):
        a = render(rng, truth * fault, **shared, **test)
        events = {k: shared[k] for k in ("p", "size", "proportional", "places") if k in shared}
        b = exact(truth, **events) if reference is None else render(rng, truth, **shared, **reference)
        return a, b

    return make


def events(p: float, size: float, samples: int, **more) -> Maker:
    """Little noise, and events in units of the light, against the exact image."""
    return pair(
        {"samples": samples}, None, {"kind": "exp", "sd": 0.03, "p": p, "size": size, "proportional": True} | more
    )


def changed(make: Maker, test: Callable[[Image], Image], reference: Callable[[Image], Image] = lambda i: i) -> Maker:
    def remade(rng, truth, fault=1.0):
        a, b = make(rng, truth, fault)
        return test(a), reference(b)

    return remade


def same_numbers(rng: np.random.Generator, truth: np.ndarray, fault=1.0) -> Pair:
    """Every pixel of the test draws the same random numbers."""
    factors = rng.gamma(1.0, 1.0, 16)
    variance = np.square(truth * fault) * factors.var(ddof=1) / 16
    a = Image((truth * fault * factors.mean()).astype(np.float32), variance.astype(np.float32), 16, None, 16)
    return a, render(rng, truth, samples=4096, kind="exp", sd=1.0)


_USUAL = pair({}, {"samples": 4096})
_EXPONENTIAL = {"kind": "exp", "sd": 1.0}
_RARE = {"p": 1e-4, "size": 1000.0, "proportional": True}

EIGHT_BITS = {"8 bits on both sides": (True, True), "8 bits of 1024 samples": (True, False)}
"""Which sides of a kind are kept in bytes."""

UNSEEN = "bright events in one pixel of ten"
"""A kind that fails: most of those pixels see no event, where others, of which nothing tells them, have none."""

KINDS: dict[str, Maker] = {
    "Gaussian against a reference": _USUAL,
    "Gaussian, both alike": pair({"samples": 64}, {"samples": 64}),
    "Gaussian, four batches, against the exact image": pair({"batches": 4}, None),
    "exponential against a reference": pair({}, {"samples": 4096}, _EXPONENTIAL),
    "exponential against the exact image": pair({}, None, _EXPONENTIAL),
    "exponential, 1024 samples against 4096": pair({"samples": 1024}, {"samples": 4096}, _EXPONENTIAL),
    "exponential, four samples each": pair({"samples": 4, "batches": 4}, {"samples": 4, "batches": 4}, {"kind": "exp"}),
    "fireflies that the test hardly catches": pair({}, {"samples": 4096}, {"p": 3e-5, "size": 1e3}),
    "fireflies that the test catches seldom": pair({}, {"samples": 4096}, {"p": 1e-4, "size": 1e2}),
    "many fireflies in both": pair({"samples": 64}, {"samples": 64}, {"p": 1e-3, "size": 30.0}),
    "fireflies without other noise": pair({}, {"samples": 4096}, {"p": 1e-3, "size": 300.0, "sd": 0.0}),
    "rare events that the reference knows": pair({}, {"samples": 65536}, _RARE),
    "rare events, both at 1024 samples": pair({"samples": 1024}, {"samples": 1024}, _RARE),
    "rare events against the exact image": pair({}, None, _RARE),
    "bright events, 2 in a tile": events(1e-3, 5.0, 32),
    "bright events, 3 in a tile": events(3e-3, 2.0, 16),
    "small bright events, 4 in a tile": events(1e-3, 4.0, 64),
    "bright events, 5 in a tile": events(1.5e-3, 6.0, 48),
    "small bright events, 10 in a tile": events(1e-2, 1.0, 16),
    "bright events, 12 in a tile": events(3e-3, 3.0, 64),
    "dark events, 5 in a tile": events(3e-3, -0.9, 24),
    "bright events that are added, 3 in a tile": events(2e-3, 0.5, 24, proportional=False),
    UNSEEN: events(1e-2, 4.0, 32, places=0.1),
    "noise of half the tolerance": pair({}, {}, {"sd": 2e-5}),
    "noise of nine tenths of it": pair({}, None, {"sd": 4e-5}),
    "the test has no variance, but states its samples": changed(_USUAL, lambda i: untold(i, 16)),
    "the reference has no variance, but states its samples": changed(
        pair({"samples": 64}, {"samples": 64}), lambda i: i, lambda i: untold(i, 64)
    ),
    "the test states nothing": changed(_USUAL, untold),
    "the reference states nothing": changed(pair({"samples": 64}, {"samples": 64}), lambda i: i, untold),
    "neither states anything": changed(pair({"samples": 64}, {"samples": 64}, {"kind": "exp"}), untold, untold),
    "8 bits on both sides": changed(pair({"samples": 64}, {"samples": 4096}), quantised, quantised),
    "8 bits of 1024 samples": changed(pair({"samples": 1024}, {"samples": 4096}), quantised),
    "a ten-thousandth of the radiance": changed(_USUAL, lambda i: times(i, 1e-4), lambda i: times(i, 1e-4)),
    "a sun of 1e5": changed(_USUAL, lambda i: times(i, 1e5), lambda i: times(i, 1e5)),
    "the same numbers in every pixel": same_numbers,
}
