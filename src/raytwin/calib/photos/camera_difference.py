"""How differently two cameras project: mrcal's projection difference.

A pixel q of the first camera sees p, on its ray, `distance` metres away; the second camera projects R p + t to q'. Two
calibrations never agree on where a camera looks and stands, so R and t are those that make the differences smallest,
weighted by how well the first camera is known at q; what is left, |q' - q|, is where the lenses differ. At infinity t
makes no difference and R alone is fitted. After mrcal-show-projection-diff (Kogan, mrcal.secretsauce.net).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from raytwin.calib.photos import lens_model
from raytwin.calib.photos.uncertainty import UNDONE_PX, cell_middles, deviations
from raytwin.errors import InputError

STEPS, SETTLED = 30, 1e-12
"""Gauss-Newton steps at most, and the turn or shift, radians or distances, at which they stop."""


@dataclass(frozen=True, eq=False)
class ProjectionDifference:
    """`px` (h, w): |q' - q| in cells of CELL pixels, NaN where a camera has no ray; its median, 95th percentile and
    worst, pixels; at which `distance`, metres; `turn_degrees`, `shift_metres`: sizes of the fitted R and t."""

    px: np.ndarray
    median: float
    p95: float
    worst: float
    distance: float
    turn_degrees: float
    shift_metres: float


def projection_difference(calibration, other, distance: float | None = None) -> ProjectionDifference:
    """Compare a calibration made here with `other`, anything with image_size, K and dist.

    `distance`: metres, by default the median distance of the boards; math.inf fits a rotation alone.
    """
    if tuple(other.image_size) != tuple(calibration.image_size):
        (w, h), (a, b) = calibration.image_size, other.image_size
        raise InputError("--against", f"a camera of {w} x {h} pixels", f"{a} x {b}")
    away = calibration.basis.distance if distance is None else distance
    pixels, shape = cell_middles(calibration.image_size)
    sigma = deviations(calibration, pixels, away)
    rays = lens_model.unit_rays(pixels, calibration.K, calibration.dist)
    seen = np.isfinite(sigma)
    weight = np.where(seen, 1 / np.maximum(np.nan_to_num(sigma, nan=1.0), UNDONE_PX), 0.0)[:, None]
    unknowns = 3 if math.isinf(away) else 6
    R, t = np.eye(3), np.zeros(3)  # t in distances: the rays end at a distance of 1
    with np.errstate(all="ignore"):  # a ray without a pixel has no weight
        for _ in range(STEPS):
            points = rays @ R.T + t
            off, _, of_point = lens_model.linearise(points, pixels, other.K, other.dist, ())
            inside = lens_model.grows(points, other.dist) & seen
            w = np.where(inside[:, None], weight, 0.0)
            J = (lens_model.of_pose(points, of_point)[..., :unknowns] * w[..., None])[inside].reshape(-1, unknowns)
            step = np.linalg.lstsq(J, -(off * w)[inside].ravel(), rcond=None)[0]
            turn = cv2.Rodrigues(step[:3])[0]
            R, t = turn @ R, turn @ t + np.append(step[3:], np.zeros(6 - unknowns))[:3]
            if np.abs(step).max() < SETTLED:
                break
        points = rays @ R.T + t
        off, _, _ = lens_model.linearise(points, pixels, other.K, other.dist, ())
    found = np.where(seen & lens_model.grows(points, other.dist), np.linalg.norm(off, axis=1), math.nan)
    if not np.isfinite(found).any():
        raise InputError("--against", "a camera that sees some of what this one sees", "none of it")
    median, p95, worst = (float(np.nanquantile(found, q)) for q in (0.5, 0.95, 1.0))
    turned = math.degrees(float(np.linalg.norm(cv2.Rodrigues(R)[0])))
    shift = 0.0 if math.isinf(away) else away * float(np.linalg.norm(t))
    return ProjectionDifference(found.reshape(shape), median, p95, worst, away, turned, shift)
