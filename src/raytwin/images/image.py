"""What every renderer returns and every comparison takes: linear Rec. 709 radiance, with its uncertainty."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from raytwin.array_types import Bool, Float, Float32, Int32
from raytwin.errors import InputError
from raytwin.notebook import InNotebook

BACKGROUND = -1
"""The id of a pixel that shows no object."""


@dataclass(frozen=True, eq=False)
class Surface:
    """What the ray through each pixel's centre meets first.

    `ids` (H, W) int32: index into `scene.objects`, -1 where nothing is met. `depth` (H, W) float32: distance from the
    eye along the unit ray, metres, 0 at the background. `normal` (H, W, 3) float32: unit, board frame, facing the
    eye, 0 at the background.
    """

    ids: Int32[np.ndarray, "h w"]
    depth: Float32[np.ndarray, "h w"]
    normal: Float32[np.ndarray, "h w 3"]

    @classmethod
    def empty(cls, width: int, height: int) -> "Surface":
        """Return the surface of an image that sees no object."""
        depth, normal = np.zeros((height, width), np.float32), np.zeros((height, width, 3), np.float32)
        return cls(np.full((height, width), BACKGROUND, np.int32), depth, normal)

    @property
    def mask(self) -> Bool[np.ndarray, "h w"]:
        """(H, W) bool: an object is seen here."""
        return np.asarray(self.ids != BACKGROUND)


@dataclass(frozen=True, eq=False)
class Image(InNotebook):
    """Linear radiance `mean` (H, W, 3) float32, row 0 on top.

    `variance` (H, W, 3) float32 is the variance *of the mean*. `samples` is the number of rays per pixel, 0 if unknown.
    Without a variance, an image of one sample counts as noise-free; any other may have noise. `batches` is the number
    of independent renders behind the variance (None: every sample is one); 1 without a variance means that there is
    noise of unknown variance. `surface` is what each pixel's centre shows, if the renderer knows. `alpha` (H, W) is the
    share of each pixel that is covered, None if unknown. `format` is the file's ("EXR", "PNG"), which may have
    rounded the values; `begins` is the pixel (x, y) of the display at which the image begins. `third` (H, W, 3) float32
    is the third central moment of the mean, from the same renders as its variance: how skewed the noise is.

    `np.asarray(image)` is `mean`. A notebook shows the picture, exposed so that little of it is white.
    """

    mean: Float[np.ndarray, "h w 3"]
    variance: Float[np.ndarray, "h w 3"] | None = None
    samples: int = 1
    surface: Surface | None = None
    batches: int | None = None
    alpha: Float[np.ndarray, "h w"] | None = None
    format: str = ""
    begins: tuple[int, int] = (0, 0)
    third: Float[np.ndarray, "h w 3"] | None = None

    def __post_init__(self) -> None:
        if self.samples < 0:
            raise InputError("samples", "a number of rays per pixel, or 0 if unknown", self.samples)

    def blacken(self, lost: Bool[np.ndarray, "h w"] | None) -> "Image":
        """Make the pixels `lost`, which no ray belongs to, black, noise-free and empty of objects; return the image."""
        if lost is not None:
            self.mean[lost] = 0
            if self.variance is not None:
                self.variance[lost] = 0
            if self.third is not None:
                self.third[lost] = 0
            if self.surface is not None:
                self.surface.ids[lost], self.surface.depth[lost], self.surface.normal[lost] = BACKGROUND, 0, 0
        return self

    @property
    def shape(self) -> tuple[int, ...]:
        return self.mean.shape

    @classmethod
    def from_array(cls, pixels: ArrayLike, variance: ArrayLike | None = None, samples: int = 0) -> "Image":
        """Return the image of linear radiance `pixels` (H, W, 3), with the `variance` of its mean where it is known.

        Anything that NumPy reads will do: lists, torch, jax, Dr.Jit. `samples` are rays per pixel, 0 if unknown.

        >>> Image.from_array(np.zeros((2, 3, 3)))
        <raytwin.Image 3 x 2, samples unknown, mean 0>
        """
        spread = None if variance is None else np.asarray(variance, np.float32)
        return cls(np.asarray(pixels, np.float32), spread, samples)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.mean, dtype, copy=copy)

    def __array_function__(self, function: Callable[..., Any], types: Any, args: Any, options: Any) -> Any:
        """Let NumPy's functions take `mean`, which `np.mean(image)` would otherwise call."""
        return function(*_arrays(args), **_arrays(options))

    def __repr__(self) -> str:
        size = " x ".join(map(str, reversed(self.shape[:2])))
        known = f"{self.samples} sample{'s' * (self.samples != 1)}" if self.samples else "samples unknown"
        noise = "" if self.variance is None else f", noise {np.sqrt(np.mean(self.variance, dtype=float)):.2g}"
        return f"<raytwin.Image {size}, {known}, mean {np.mean(self.mean, dtype=float):.4g}{noise}>"


def _arrays(value: Any) -> Any:
    """The same with each Image's `mean` in its place, also within lists and tables."""
    if isinstance(value, list | tuple):
        return [*map(_arrays, value)] if isinstance(value, list) else tuple(map(_arrays, value))
    if isinstance(value, dict):
        return {key: _arrays(one) for key, one in value.items()}
    return value.mean if isinstance(value, Image) else value
