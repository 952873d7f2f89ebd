"""The whole comparison in one small picture, for a README or a message."""

from typing import TYPE_CHECKING

import numpy as np

from raytwin.report import pictures

if TYPE_CHECKING:
    from raytwin.jobs.compare import Result

PANEL = 400
"""Width of a panel in pixels."""
GAP = 8


def overview(result: "Result") -> np.ndarray:
    """uint8 sRGB: photo, augmented photo (where there are any), tracer, twin and signed error, side by side."""
    gain = pictures.exposure(result.twin)
    error = result.subject.mean - result.twin.mean
    worst = np.take_along_axis(error, np.abs(error).argmax(axis=-1)[..., None], axis=-1)[..., 0]
    scale = pictures.choose_scale(result.subject, result.twin, error, result.tolerance.p999_abs)
    panels = [p for p in (result.photo, result.augmented) if p is not None and p.shape == result.twin.shape]
    panels += [pictures.exposed(image, gain) for image in (result.subject, result.twin)]
    panels.append(pictures.palette()[pictures.error_indices(worst, scale)])
    small = [_shrunk(p) for p in panels]
    gap = np.full((small[0].shape[0], GAP, 3), 255, np.uint8)
    strip = [part for p in small for part in (p, gap)][:-1]
    return np.concatenate(strip, axis=1)


def _shrunk(pixels: np.ndarray) -> np.ndarray:
    from PIL import Image as Pillow

    height, width = pixels.shape[:2]
    size = (PANEL, max(1, round(PANEL * height / width)))
    return np.asarray(Pillow.fromarray(np.ascontiguousarray(pixels)).resize(size, Pillow.Resampling.BOX))
