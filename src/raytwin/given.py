"""What a test hands over, as an Image: arrays, files, repeated renders, or a function that renders from a seed."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from raytwin import files
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import Tolerance

RENDERS = 8
"""How often a function is called: so many renders tell their variance to within a factor of two or so."""
FEWEST = 4
"""Fewer renders know too little of their variance: with 2, a third of all correct images would fail."""
HALF_STEP_SRGB8 = 1.055 * 2.4 / 255 / 2 * 1.0001
"""Half of the widest step between two 8-bit codes, at white, as linear radiance: d/dx ((x + 0.055) / 1.055)^2.4."""
HALF_STEP_FLOAT16 = 2.0**-11
"""Half of the widest step between two half floats, relative to the larger."""


class Given(NamedTuple):
    """The image; `step`: what its format may have rounded off, radiance; `clipped`: it cannot hold more than 1."""

    image: Image
    step: float = 0.0
    clipped: bool = False
    notes: tuple[str, ...] = ()

    def fitted(self, reference: Image, tolerance: Tolerance) -> tuple[Image, Tolerance]:
        """The reference as this image's format could have shown it, and the tolerance that the format's steps ask."""
        if self.clipped:
            reference = replace(reference, mean=np.clip(reference.mean, 0, 1))
        if self.step > tolerance.p999_abs:
            tolerance = Tolerance(tolerance.mask_pixels, self.step, tolerance.outlier_fraction)
        return reference, tolerance


def take(thing: Any, variance: Any = None, renders: int = RENDERS) -> Given:
    """`thing` as an Image: see the module's first line.

    An Image; a path (EXR, PFM, HDR, PNG, JPEG); a function `render(seed)` that returns any of these, called with the
    seeds 0, 1, ... `renders` - 1 (twice, where the two are equal); an array (H, W, 3), with `variance` *of its mean*;
    a list of these or an array (k, H, W, 3): k >= 4 independent renders, whose spread gives their mean's variance.
    """
    if variance is not None:
        found = _single(thing)
        return found._replace(image=replace(found.image, variance=_array(variance)))
    if callable(thing) and not isinstance(thing, Image):
        return _called(thing, renders)
    if _is_many(thing):
        return _repeated([_single(one) for one in thing])
    return _single(thing)


def _is_many(thing: Any) -> bool:
    if isinstance(thing, list | tuple):
        return len(thing) > 0 and (isinstance(thing[0], Image | str | os.PathLike) or np.ndim(thing[0]) == 3)
    return getattr(thing, "ndim", 0) == 4


def _called(render: Callable[[int], Any], renders: int) -> Given:
    if renders < FEWEST:
        raise InputError("renders", f"at least {FEWEST}", renders)
    made = [_single(render(seed)) for seed in range(2)]
    if np.array_equal(made[0].image.mean, made[1].image.mean, equal_nan=made[0].image.mean.dtype.kind == "f"):
        note = "the renders of seeds 0 and 1 are equal: taken as free of noise"
        return made[0]._replace(notes=(*made[0].notes, note))
    return _repeated([*made, *(_single(render(seed)) for seed in range(2, renders))])


def _repeated(made: list[Given]) -> Given:
    """The mean of independent renders, and its variance s² / k."""
    if len(made) < FEWEST:
        raise InputError("repeated renders", f"at least {FEWEST}", len(made))
    first = made[0].image
    if len(shapes := {g.image.mean.shape for g in made}) > 1:
        raise InputError("renders", "images of one shape", ", ".join(map(str, sorted(shapes))))
    stack = np.array([g.image.mean for g in made], np.float64)
    k = len(stack)
    with np.errstate(invalid="ignore"):  # NaN and infinity: compare finds them in the mean
        mean, variance = stack.mean(axis=0), stack.var(axis=0, ddof=1) / k
    samples = sum(g.image.samples for g in made)
    image = Image(mean.astype(np.float32), variance.astype(np.float32), samples, first.surface, k)
    return Given(image, max(g.step for g in made), any(g.clipped for g in made), made[0].notes)


def _single(thing: Any) -> Given:
    if isinstance(thing, Image):
        return Given(thing)
    if isinstance(thing, str | os.PathLike):
        return _read(Path(thing))
    pixels = _array(thing)
    if pixels.dtype == np.float16:
        return _half(Image(pixels.astype(np.float32)))
    return Given(Image(pixels))


def _array(thing: Any) -> np.ndarray:
    """Whatever NumPy can read (torch, jax, Dr.Jit, lists): what it cannot is the caller's mistake."""
    try:
        return np.asarray(thing)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError("image", "an array, a path, an Image or a function of a seed", error) from None


def _read(path: Path) -> Given:
    image = files.read_image(path)
    with path.open("rb") as file:
        start = file.read(26)
    if start.startswith(b"\xff\xd8") or (start.startswith(b"\x89PNG") and start[24] <= 8):
        return Given(image, HALF_STEP_SRGB8, True, ("8 bits a channel: held to half a step, and to white",))
    if start.startswith(b"\x89PNG"):
        return Given(image, HALF_STEP_SRGB8 / 257, True, ("16 bits a channel: held to white",))
    if start.startswith(b"#?"):
        # A byte of mantissa for the brightest channel, shared exponent: rounded down or to nearest, as writers like.
        return Given(image, float(np.max(image.mean, initial=0)) / 128, False, ("HDR keeps 8 bits: held to a step",))
    with np.errstate(over="ignore", invalid="ignore"):
        is_half = np.array_equal(image.mean.astype(np.float16).astype(np.float32), image.mean, equal_nan=True)
    return _half(image) if is_half else Given(image)


def _half(image: Image) -> Given:
    finite = image.mean[np.isfinite(image.mean)]
    step = HALF_STEP_FLOAT16 * float(finite.max(initial=0))
    return Given(image, step, False, ("half floats: held to half a step of the brightest",))
