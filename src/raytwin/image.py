"""What every renderer returns and every comparison takes: linear Rec. 709 radiance, with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from raytwin.array_types import Bool, Float, Float32, Int32

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
class Image:
    """Linear radiance `mean` (H, W, 3) float32, row 0 on top.

    `variance` (H, W, 3) float32 is the variance *of the mean*. `samples` is the number of rays per pixel, 0 if unknown.
    Without a variance, an image of one sample counts as noise-free; any other may have noise. `batches` is the number
    of independent renders behind the variance (None: every sample is one); 1 without a variance means that there is
    noise of unknown variance. `surface` is what each pixel's centre shows, if the renderer knows.
    """

    mean: Float[np.ndarray, "h w 3"]
    variance: Float[np.ndarray, "h w 3"] | None = None
    samples: int = 1
    surface: Surface | None = None
    batches: int | None = None

    def blacken(self, lost: Bool[np.ndarray, "h w"] | None) -> "Image":
        """Itself, with the pixels `lost`, that no ray belongs to, black and without doubt: they meet nothing."""
        if lost is not None:
            self.mean[lost] = 0
            if self.variance is not None:
                self.variance[lost] = 0
            if self.surface is not None:
                self.surface.ids[lost], self.surface.depth[lost], self.surface.normal[lost] = BACKGROUND, 0, 0
        return self

    @property
    def shape(self) -> tuple[int, ...]:
        return self.mean.shape
