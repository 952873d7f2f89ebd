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
from scipy.optimize import least_squares

from raytwin.calib.photos import lens_model
from raytwin.calib.photos.uncertainty import UNDONE_PX, cell_middles, deviations
from raytwin.errors import InputError

SETTLED = 1e-12
"""The fit has converged once a step changes neither turn and shift nor the sum of squares by more than this share."""


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

    def off(x: np.ndarray) -> np.ndarray:
        """(n, 2) pixels, by a turn and a shift (none at infinity) in distances: the rays end at a distance of 1."""
        points = rays @ cv2.Rodrigues(x[:3])[0].T + np.append(x[3:], np.zeros(6 - len(x)))
        with np.errstate(all="ignore"):
            residuals, _, _ = lens_model.linearise(points, pixels, other.K, other.dist, ())
        residuals[~(seen & lens_model.grows(points, other.dist))] = math.nan
        return residuals

    start = np.zeros(3 if math.isinf(away) else 6)
    best = least_squares(lambda x: np.nan_to_num(off(x) * weight).ravel(), start, xtol=SETTLED, ftol=SETTLED).x
    found = np.linalg.norm(off(best), axis=1)
    if not np.isfinite(found).any():
        raise InputError("--against", "a camera that sees some of what this one sees", "none of it")
    median, p95, worst = (float(np.nanquantile(found, q)) for q in (0.5, 0.95, 1.0))
    turned, shift = math.degrees(float(np.linalg.norm(best[:3]))), float(np.linalg.norm(best[3:]))
    return ProjectionDifference(found.reshape(shape), median, p95, worst, away, turned, away * shift if shift else 0.0)
