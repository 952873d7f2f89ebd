"""A wrong picture as pages show it: a small one beside the correct one, and for the worst every value."""

import msgspec
import numpy as np

from raytwin.compare import error_map, error_scale
from raytwin.images.image import Image
from raytwin.images.packing import pack
from raytwin.images.photo_files import data_url, to_bytes
from raytwin.teach.grade.questions import Question
from raytwin.teach.grade.result import Picture

MOST_PIXELS = 40_000
"""Pixels per picture on a student's page: larger ones are reduced."""


def wrong_picture(asked: Question, got: np.ndarray, scale: float, whole: bool) -> Picture:
    """A wrong picture beside the correct one; `whole`: with every value, for the viewer."""
    (right,), points = asked.case.expected, asked.exercise.stage == "hit_points"
    if points:  # x, y, z as red, green, blue, from the least to the largest that there is
        seen = np.isfinite(right).all(axis=-1)
        low, high = (f(right[seen], axis=0, initial=0.0) for f in (np.min, np.max))
        right, got = (np.where(np.isfinite(x), (x - low) / np.maximum(high - low, 1e-9), 0.0) for x in (right, got))
    with np.errstate(over="ignore", invalid="ignore"):
        test, reference = (Image(np.nan_to_num(x, nan=np.nan, posinf=np.inf).astype(np.float32)) for x in (got, right))
    brightest = np.quantile(reference.mean.max(axis=-1), 0.995)
    return Picture(
        exercise=asked.exercise.name,
        shows=asked.case.shows,
        thumb=_thumb(test, reference),
        planes=_planes(test, reference) if whole else "",
        stops=round(-float(np.log2(brightest)), 2) if brightest > 0 else 0.0,
        share=asked.tolerance.p999_abs,
        scale=scale,
        full=0.0 if points else error_scale(test, reference),
    )


def _planes(test: Image, reference: Image) -> str:
    packed = pack(test, reference, surfaces=False, most_pixels=MOST_PIXELS)
    return msgspec.json.encode(packed.for_page()).decode()


def _thumb(test: Image, reference: Image) -> str:
    """Expected, got, error, side by side, in 64 colours: some 5 kB."""
    from PIL import Image as Pillow

    step = max(1, reference.shape[1] // 160)
    gain = np.float32(1 / max(1e-9, float(np.quantile(reference.mean, 0.995))))
    shown = [to_bytes(np.nan_to_num(i.mean[::step, ::step]) * gain) for i in (reference, test)]
    shown.append(to_bytes(error_map(test, reference)[::step, ::step]))
    gap = np.full((shown[0].shape[0], 4, 3), 255, np.uint8)
    row = np.concatenate([shown[0], gap, shown[1], gap, shown[2]], axis=1)
    return data_url(Pillow.fromarray(row).quantize(64), "png", optimize=True)
