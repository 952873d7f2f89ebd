"""How differently two cameras project: mrcal's projection difference.

A pixel q of the first camera sees p, on its ray, as far off as the boards were; the second camera projects R p + t to
q'. Two calibrations never agree on where a camera looks and stands, so R and t are those that make the differences
smallest, weighted by how well the first camera is known at q; what is left, |q' - q|, is where the lenses differ.
After mrcal-show-projection-diff (Kogan, mrcal.secretsauce.net).
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


@dataclass(frozen=True)
class ProjectionDifference:
    """|q' - q| over the frame: median, 95th percentile and worst, pixels; at which `distance`, metres; `turn_degrees`,
    `shift_metres`: sizes of the fitted R and t."""

    median: float
    p95: float
    worst: float
    distance: float
    turn_degrees: float
    shift_metres: float


def projection_difference(calibration, other) -> ProjectionDifference:
    """Compare a calibration made here with `other`, anything with image_size, K and dist."""
    if tuple(other.image_size) != tuple(calibration.image_size):
        (w, h), (a, b) = calibration.image_size, other.image_size
        raise InputError("--against", f"a camera of {w} x {h} pixels", f"{a} x {b}")
    away = calibration.basis.distance
    pixels, _ = cell_middles(calibration.image_size)
    sigma = deviations(calibration, pixels, away)
    rays = lens_model.unit_rays(pixels, calibration.K, calibration.dist)
    seen = np.isfinite(sigma)
    weight = np.where(seen, 1 / np.maximum(np.nan_to_num(sigma, nan=1.0), UNDONE_PX), 0.0)[:, None]

    def off(x: np.ndarray) -> np.ndarray:
        """(n, 2) pixels, by a turn and a shift in distances: the rays end at a distance of 1."""
        points = rays @ cv2.Rodrigues(x[:3])[0].T + x[3:]
        with np.errstate(all="ignore"):
            residuals = lens_model.project(points, np.eye(3), np.zeros(3), other.K, other.dist) - pixels
        residuals[~(seen & lens_model.grows(points, other.dist))] = math.nan
        return residuals

    best = least_squares(lambda x: np.nan_to_num(off(x) * weight).ravel(), np.zeros(6), xtol=SETTLED, ftol=SETTLED).x
    found = np.linalg.norm(off(best), axis=1)
    if not np.isfinite(found).any():
        raise InputError("--against", "a camera that sees some of what this one sees", "none of it")
    median, p95, worst = (float(np.nanquantile(found, q)) for q in (0.5, 0.95, 1.0))
    turned, shift = math.degrees(float(np.linalg.norm(best[:3]))), float(np.linalg.norm(best[3:]))
    return ProjectionDifference(median, p95, worst, away, turned, away * shift)
