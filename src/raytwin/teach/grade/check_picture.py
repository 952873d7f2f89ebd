"""One picture compared with what it should be: passed or not, its error, and how a page shows it if it is wrong."""

import msgspec
import numpy as np

from raytwin.compare import Comparison, compare, error_map, error_scale
from raytwin.compare.exact import scale_of
from raytwin.explain.pixel_sample import SubmittedImage
from raytwin.explain.tolerance_mask import forgiven
from raytwin.images.image import Image
from raytwin.images.image_formats import kind_of
from raytwin.images.packing import pack
from raytwin.images.photo_files import data_url, to_bytes
from raytwin.images.stored_precision import rounding_of
from raytwin.scene import Tolerance
from raytwin.teach.grade.questions import CheckedPicture, Question
from raytwin.teach.grade.result import MarkedPart, Picture
from raytwin.teach.sandbox.sandbox import Answer

MOST_PIXELS = 40_000
"""Pixels per picture on a student's page: larger ones are reduced."""


def check_picture(asked: Question) -> CheckedPicture:
    """Compare a picture with what it should be: numbers decide, never a claim of the submission's own."""
    exercise, case, answer = asked.exercise, asked.case, asked.answer
    (right,), shows = case.expected, case.shows
    if answer.problem:
        return CheckedPicture(MarkedPart(shows, False, seconds=answer.seconds, problem=answer.problem))
    got, half, clipped = _radiance_of(answer)
    if got.shape != right.shape:
        problem = f"it returned an array {got.shape}, where {right.shape} is wanted"
        return CheckedPicture(MarkedPart(shows, False, seconds=answer.seconds, problem=problem))
    if asked.verdict is not None:
        return _by_verdict(asked.verdict, got, shows, answer.seconds, scale_of(Image(right.astype(np.float32))))
    points = exercise.stage == "hit_points"
    assert asked.scene is not None
    if not points:
        got = forgiven(got, np.clip(right, 0, 1) if clipped else right, asked.scene, exercise.rung)
    scale = 1.0 if points else scale_of(Image(right.astype(np.float32)))
    if points:
        passed, error, wrong = _compare_points(right, got, asked.tolerance)
    else:
        passed, error, wrong = _compare_radiance(right, got, asked, half, clipped, scale)
    part = MarkedPart(shows, passed, error=error, wrong=wrong, seconds=answer.seconds)
    if not points and (bad := ~np.isfinite(got).all(axis=-1)).any():
        (y, x), count = np.argwhere(bad)[0], int(bad.sum())
        problem = f"{count} pixel{'s are' if count > 1 else ' is'} NaN or infinite, the first at (x={x}, y={y})"
        part = msgspec.structs.replace(part, problem=problem)
        return CheckedPicture(part, None, got, scale)
    view = SubmittedImage(asked.scene, got, right, exercise.rung, points, half, clipped, composed=bool(asked.made_of))
    return CheckedPicture(part, view, None if passed else got, scale)


def _by_verdict(made: Comparison, got: np.ndarray, shows: str, seconds: float, scale: float) -> CheckedPicture:
    """A sampled picture as the verdict has it: its error is that of its mean, and no cause is looked for in noise."""
    ratio, wrong = made.radiance.mean_ratio, made.statistics.pixel_fail_fraction
    error = None if ratio is None or made.verdict == "undecided" else abs(ratio - 1)
    problem = "" if made.passed else made.reasons[0]
    part = MarkedPart(
        shows, made.passed, error=error, wrong=1.0 if wrong is None else wrong, seconds=seconds, problem=problem
    )
    return CheckedPicture(part, None, None if made.passed else got, scale)


def _radiance_of(answer: Answer) -> tuple[np.ndarray, np.ndarray | None, bool]:
    """Radiance; of an image file what its format rounds off: half a step of each value, and whether it is clipped."""
    got = np.asarray(answer.arrays[0], np.float64)
    if len(answer.arrays) != 2 or answer.arrays[1].dtype != np.uint8:
        return got, None, False
    kind = kind_of(answer.arrays[1].tobytes()) or ""
    rounding = rounding_of(Image(got.astype(np.float32), format=kind))
    return got, rounding.half, rounding.clipped


def _compare_radiance(
    right: np.ndarray, got: np.ndarray, asked: Question, half: np.ndarray | None, clipped: bool, scale: float
) -> tuple[bool, float | None, float]:
    """(passed, error by its scale, share of pixels that are off)."""
    should = np.clip(right, 0, 1) if clipped else right
    with np.errstate(over="ignore"):
        test, reference = (Image(x.astype(np.float32)) for x in (got, should))
    made = compare(test, reference, tolerance=asked.tolerance, noise="none", half_steps=(half, None))
    error = made.radiance.p999_abs
    finite = error is not None and bool(np.isfinite(got).all())
    with np.errstate(invalid="ignore"):
        slack = asked.tolerance.p999_abs * np.maximum(scale, np.abs(should)) + (0 if half is None else half)
        off = float((~(np.abs(got - should) <= slack)).any(axis=-1).mean())
    return made.passed, error / scale if finite and error is not None else None, off


def _compare_points(right: np.ndarray, got: np.ndarray, tolerance: Tolerance) -> tuple[bool, float | None, float]:
    """Compare points, NaN for none: return the 99.9 % quantile of the distances, and the share that is off."""
    seen, there = (~np.isnan(x).any(axis=-1) for x in (right, got))
    with np.errstate(over="ignore"):
        apart = np.linalg.norm(np.where((seen & there)[..., None], got - right, 0.0), axis=-1)
    allowed_distance = max(tolerance.p999_abs, 1e-6) * max(1.0, float(np.abs(right[seen]).max(initial=0.0)))
    wrong = (apart > allowed_distance) | (seen != there)
    finite = apart[seen & there & np.isfinite(apart)]
    error = float(np.quantile(finite, 0.999)) if finite.size else None
    allowed = max(tolerance.mask_pixels, int(1e-3 * wrong.size))
    return int(wrong.sum()) <= allowed and bool((seen & there).any()), error, float(wrong.mean())


# ------------------------------------------------------------------------------------------ on a page


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
