"""The whole comparison in one small picture, for a README or a message."""

from typing import TYPE_CHECKING

import numpy as np

from raytwin.compare.heatmap import signed_error
from raytwin.image import Image
from raytwin.report import data_urls

if TYPE_CHECKING:
    from raytwin.workflows.compare_scene import Result

PANEL = 400
"""Width of a panel in pixels."""
TALLEST = 4 * PANEL
"""Height of a panel at most: those of taller frames are narrower."""
GAP = 8
"""Pixels between the pictures."""


def overview(result: "Result") -> np.ndarray:
    """uint8 sRGB: photo, augmented photo (where there are any), tracer, twin and signed error, side by side."""
    gain = data_urls.exposure(result.reference)
    error = signed_error(result.test, result.reference, "absolute")
    scale = data_urls.choose_scale(result.test, result.reference, error, result.tolerance.p999_abs)
    photos = [p for p in (result.photo, result.augmented) if p is not None and p.shape == result.reference.shape]
    small = [_shrunk(photo) for photo in photos]
    small += [_seen(image, gain) for image in (result.test, result.reference)]
    worst = data_urls.worst_of_blocks(error, max(1, error.shape[1] // PANEL))
    small.append(_shrunk(data_urls.palette()[data_urls.error_indices(worst, scale)], small[0].shape))
    gap = np.full((small[0].shape[0], GAP, 3), 255, np.uint8)
    strip = [part for p in small for part in (p, gap)][:-1]
    return np.concatenate(strip, axis=1)


def panel_size(height: int, width: int) -> tuple[int, int]:
    """(height, width) of a frame's panel, in pixels."""
    scale = min(PANEL / width, TALLEST / height)
    return max(1, round(height * scale)), max(1, round(width * scale))


def _shrunk(pixels: np.ndarray, like: tuple[int, ...] | None = None) -> np.ndarray:
    """uint8 (H, W, 3), or one channel of floats, at the panel's size."""
    from PIL import Image as Pillow

    height, width = like[:2] if like else panel_size(*pixels.shape[:2])
    return np.asarray(Pillow.fromarray(pixels).resize((width, height), Pillow.Resampling.BOX))


def _seen(image: Image, gain: float) -> np.ndarray:
    """The mean of each panel's pixel, exposed: as an eye sees it that stands far off."""
    planes = [_shrunk(np.ascontiguousarray(image.mean[..., c], np.float32)) for c in range(3)]
    return data_urls.exposed(Image(np.stack(planes, axis=-1)), gain)
