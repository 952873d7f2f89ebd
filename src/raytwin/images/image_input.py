"""What a user hands over, as an Image: arrays, files, repeated renders, or a function that renders from a seed."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import InputError
from raytwin.images.exr import split_layer
from raytwin.images.image import Image
from raytwin.images.image_formats import read_image
from raytwin.images.image_pool import ImagePool
from raytwin.images.stored_precision import DITHERED, Rounding, rounding_of

TAKEN = "an array, a path, an Image or a function of a seed"
RENDERS = 8
"""Calls of a function of a seed: 8 renders give their variance to within a factor of about two."""
ENDINGS = (
    ".exr", ".pfm", ".hdr", ".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".pnm", ".tif", ".tiff", ".bmp", ".webp",
)  # fmt: skip
"""Name endings of the images in a folder. `.hdr` is here to be refused with a message instead of skipped."""
FEWEST_RENDERS = 4
"""Renders that a variance is estimated from, at least: from 2, a third of all correct images would fail."""


class LoadedImage(NamedTuple):
    """The image, and what its format rounds off; `measured`: its variance is the spread of renders, not a claim."""

    image: Image
    rounding: Rounding = Rounding()
    notes: tuple[str, ...] = ()
    measured: bool = False

    def fitted(self, reference: Image) -> Image:
        """The reference as this image's format could have shown it."""
        return self.rounding.shown(reference)


def as_image(thing: Any, variance: Any = None, renders: int = RENDERS) -> LoadedImage:
    """Return what a user hands over, with its noise.

    An Image; a path (EXR, PFM, picture of 8 bits); a function `render(seed)` that returns any of these, called with the
    seeds 0, 1, ... `renders` - 1 (four times, where these are equal); an array (H, W, 3), or (H, W, 4) with alpha, or a
    Mitsuba Bitmap, with `variance` *of its mean*, an array or a file;
    a list of these or an array (k, H, W, 3): k >= 4 independent renders, whose spread gives their mean's variance.
    """
    if variance is not None:
        taken = _single(thing)
        return taken._replace(image=replace(taken.image, variance=_variance(variance)))
    if callable(thing) and not isinstance(thing, Image):
        if renders < FEWEST_RENDERS:
            raise InputError("renders", f"at least {FEWEST_RENDERS}", renders)
        return _repeated((_single(thing(seed)) for seed in range(renders)), all_equal=FEWEST_RENDERS)
    if _is_many(thing):
        return _repeated(_single(one) for one in thing)
    return _single(thing)


def read_side(where: Path, layer: str | None = None, variance: Any = None, samples: int = 0) -> LoadedImage:
    """A file, or several renders: a folder of images, or a pattern such as `render_*.exr`.

    `variance` is an image file or an array that holds the variance of the mean, `samples` the samples per pixel of each
    file, where the file has none.
    """
    where, named = split_layer(where)
    layer, paths = named or layer, renders_at(where)
    if len(paths) > 1 or where.is_dir():
        if variance is not None:
            raise InputError(where, "one image, where its variance is given", f"{len(paths)} renders")
        return _repeated((_read(path, layer) for path in paths), samples)
    taken = _read(paths[0], layer)
    image = replace(taken.image, samples=taken.image.samples or samples)
    if variance is not None:
        image = replace(image, variance=_variance(variance))
    return taken._replace(image=image)


def renders_at(where: Path) -> list[Path]:
    """The image files of a folder, or those that fit a pattern, by name; else the path itself."""
    try:
        if where.is_dir():
            found = sorted(p for p in where.iterdir() if p.suffix.lower() in ENDINGS)
        elif where.exists() or not any(c in where.name for c in "*?["):
            return [where]
        else:
            found = sorted(where.parent.glob(where.name))
    except OSError as error:  # a name too long, a folder that may not be read
        raise InputError(where, "an image or a folder of images", error.strerror) from None
    if not found:
        raise InputError(where, f"images ({', '.join(ENDINGS)})", "none")
    return found


def _is_many(thing: Any) -> bool:
    if isinstance(thing, list | tuple):
        return len(thing) > 0 and (isinstance(thing[0], Image | str | os.PathLike | None) or np.ndim(thing[0]) == 3)
    return getattr(thing, "ndim", 0) == 4


def _repeated(renders: Iterable[LoadedImage], samples: int = 0, all_equal: int | None = None) -> LoadedImage:
    """Return the mean of independent renders, and its variance s² / k.

    `samples` per pixel count for renders that state none. No more are asked for once the first `all_equal` are equal.
    """
    pool, counts, first, last, steps = ImagePool(), list[int](), None, None, list[float]()
    for one in renders:
        if counts and one.image.shape != pool.shape:
            raise InputError("renders", "images of one shape", f"{pool.shape}, {one.image.shape}")
        pool.add(one_batch(one.image))
        counts.append(one.image.samples or samples)
        first = first or one
        if last is not None:
            steps.append(float(np.square(one.image.mean - last).mean(dtype=float)))
        last = one.image.mean
        if len(counts) == all_equal and pool.images == 1:
            break
    if first is None or len(counts) < FEWEST_RENDERS:
        raise InputError("repeated renders", f"at least {FEWEST_RENDERS}", len(counts))
    if _grow(steps):
        raise InputError(
            "repeated renders", "independent ones", "each the mean of all samples up to it (one growing render)"
        )
    notes = first.notes
    if pool.repeats:
        earlier, later = pool.repeats[0]
        others = f", and {len(pool.repeats) - 1} more repeat" if len(pool.repeats) > 1 else ""
        note = f"renders {earlier} and {later} (counted from 0, as seeds are) are equal{others}: is the seed used?"
        if pool.images > 1:
            raise InputError("repeated renders", "renders that all differ, or none", note)
        notes = (*notes, note)
    image = replace(pool.image, samples=sum(counts) if all(counts) and not pool.repeats else 0)
    return LoadedImage(image, first.rounding, notes, measured=True)


def _grow(steps: Sequence[float]) -> bool:
    """Whether renders are the means of one that grows: the mean squares of their `steps` are 2 to 1/2, 1/6, 1/12, ...

    The k-th and the (k + 1)-th mean of samples of variance 1 differ by 1 / (k (k + 1)) in the mean square.
    """
    as_first = [step * k * (k + 1) / 2 for k, step in enumerate(steps, 1)]
    return len(steps) >= 3 and steps[0] > 0 and all(0.7 < x / steps[0] < 1.4 for x in as_first)


def one_batch(image: Image) -> Image:
    """Return one of several renders without its own variance: the noise is measured by their scatter alone."""
    return replace(image, variance=None, samples=0, batches=None, third=None)


def _single(thing: Any) -> LoadedImage:
    if thing is None:
        raise InputError("render", "returned None: is there a return?")
    if isinstance(thing, Image):
        return _rounded(thing)
    if isinstance(thing, str | os.PathLike):
        return _read(Path(thing))
    pixels, alpha = _array(thing), None
    if pixels.ndim == 3 and pixels.shape[-1] == 4:
        pixels, alpha = pixels[..., :3], pixels[..., 3]
    form = ""
    if is_bitmap(thing) and thing.component_format() == type(thing.component_format()).UInt8:
        form = DITHERED
    elif pixels.dtype == np.float16:
        pixels, form = pixels.astype(np.float32), "EXR"  # whose values may be half floats, too
    return _rounded(Image(pixels, samples=0, alpha=alpha, format=form))


def is_bitmap(thing: Any) -> bool:
    return hasattr(thing, "srgb_gamma") and hasattr(thing, "component_format")


def _variance(thing: Any) -> np.ndarray:
    return read_image(thing).mean if isinstance(thing, str | os.PathLike) else _array(thing)


def _array(thing: Any) -> np.ndarray:
    """Whatever NumPy can read (torch, jax, Dr.Jit, lists): what it cannot is the caller's mistake.

    A Bitmap of Mitsuba's says itself whether its values are sRGB; it becomes linear RGB in float32.
    """
    try:
        if is_bitmap(thing):
            kind = thing.PixelFormat.RGBA if thing.has_alpha() else thing.PixelFormat.RGB
            thing = thing.convert(kind, type(thing.component_format()).Float32, srgb_gamma=False)
        made = np.asarray(thing)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError("image", TAKEN, error) from None
    if made.dtype.kind not in "fiu":
        kind = "text" if made.dtype.kind in "US" else f"{made.dtype} values"
        raise InputError("image", TAKEN if made.dtype.kind == "O" else "real numbers", kind)
    return made


def _read(path: Path, layer: str | None = None) -> LoadedImage:
    return _rounded(read_image(path, layer))


def _rounded(image: Image) -> LoadedImage:
    rounding = rounding_of(image)
    return LoadedImage(image, rounding, (rounding.note,) if rounding.note else ())
