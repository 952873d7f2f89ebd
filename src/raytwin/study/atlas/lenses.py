"""Undoing a lens: OpenCV's fixed-point iteration, stopped early or late; Newton's method; and the check for folds."""

from math import asin, hypot, inf, sin, sqrt

import numpy as np

from raytwin.scene.lens import distort, undone
from raytwin.study.atlas.experiment import Error, Experiment, Law, spaced
from raytwin.tracer import undistort

SIZE, FOCAL = (4032, 3024), 3000.0
"""A phone's photo."""
MIDDLE = 2015.5, 1511.5
CORNER = hypot(2016, 1512) / FOCAL
"""The distorted radius of its corner, focal lengths."""

OPENCV = "Brown, Close-Range Camera Calibration (1971); OpenCV's undistortPoints: 5 steps unless told otherwise"
HUNDREDTH = 0.01 / FOCAL
"""A hundredth of a pixel, focal lengths."""

EVERY = "raytwin: Newton's, or refused"


def fixed_point(xd: np.ndarray, yd: np.ndarray, dist: tuple[float, ...], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """x <- (xd - tangential(x)) / radial(x), as OpenCV does it: back to (xd, yd) where a radial is negative."""
    import cv2

    points, none, until = np.stack([xd, yd], axis=-1).reshape(-1, 1, 2), np.eye(3), (cv2.TERM_CRITERIA_COUNT, steps, 0)
    undistort_points = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # OpenCV 4 has two
    undone = undistort_points(points, none, np.array(dist), R=none, P=none, criteria=until)
    return undone[:, 0, 0], undone[:, 0, 1]


def ideal_radius(k1: float, distorted: float) -> float:
    """The r with r (1 + k1 r²) = distorted, by Viète's formula; infinity beyond the fold. k1 < 0."""
    s = sqrt(-3 * k1)
    return 2 / s * sin(asin(1.5 * s * distorted) / 3) if 1.5 * s * distorted <= 1 else inf


def barrel(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The corner of the frame under k1 = -x: distance from the true ideal point, focal lengths."""
    dist, r = (-x, 0.0, 0.0, 0.0, 0.0), ideal_radius(-x, CORNER)
    turn = 2 * np.pi * rng.random(n)
    xd, yd = CORNER * np.cos(turn), CORNER * np.sin(turn)

    def off(x: np.ndarray, y: np.ndarray) -> float:
        return float(np.minimum(np.hypot(x - r * np.cos(turn), y - r * np.sin(turn)), 1.0).max())

    return {
        **{f"OpenCV, {k} steps": off(*fixed_point(xd, yd, dist, k)) for k in (5, 20, 200)},
        EVERY: None if refused(dist) else off(*undistort(xd, yd, dist)),
    }


def refused(dist: tuple[float, ...]) -> bool:
    return bool(undone(((FOCAL, 0, MIDDLE[0]), (0, FOCAL, MIDDLE[1]), (0, 0, 1)), dist, SIZE).fault)


def contracted(steps: int) -> Law:
    """|k1| r³ ρ^steps, ρ = |2 k1 r² / (1 + k1 r²)|: what is left of the first error; all, where there is no r."""

    def law(x: float) -> float:
        r = ideal_radius(-x, CORNER)
        if r == inf:
            return 1.0
        return float(x * r**3 * (2 * x * r * r / (1 - x * r * r)) ** steps)

    return law


def silently_wrong(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The share of a frame's pixels that come back more than a hundredth of a pixel off, and nobody says so."""
    dist = (-x, 0.0, 0.0, 0.0, 0.0)
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, SIZE[0] - 1, 64), np.linspace(0, SIZE[1] - 1, 48)))
    xd, yd = (u - MIDDLE[0]) / FOCAL, (v - MIDDLE[1]) / FOCAL

    def wrong(x: np.ndarray, y: np.ndarray) -> float:
        back = distort(x, y, dist)
        return float((~(np.hypot(back[0] - xd, back[1] - yd) <= HUNDREDTH)).mean())

    return {
        **{f"OpenCV, {k} steps": wrong(*fixed_point(xd, yd, dist, k)) for k in (5, 200)},
        "Newton's, unchecked": wrong(*undistort(xd, yd, dist)),
        EVERY: None if refused(dist) else wrong(*undistort(xd, yd, dist)),
    }


def beyond_fold(x: float) -> float:
    """The share of the frame farther out than 2 / (3 √(3 |k1|)), where x' (r) turns back."""
    fold = 2 / (3 * sqrt(3 * x))
    u, v = np.meshgrid(np.linspace(-2016, 2016, 257) / FOCAL, np.linspace(-1512, 1512, 193) / FOCAL)
    return float((np.hypot(u, v) > fold).mean())


EXPERIMENTS = (
    Experiment(
        "lens-barrel", "Undoing a barrel lens at the frame's corner", "|k1|, k1 < 0",
        "distance from the true point, focal lengths", HUNDREDTH, spaced(1e-3, 1, 19),
        barrel, (EVERY,),
        "The fixed-point iteration takes off the factor ρ = 2 k1 r² / (1 + k1 r²) of the error a step, so that five "
        "steps are enough for weak lenses alone, and none for one whose ρ nears 1, at the fold. Newton's method "
        "doubles the digits with each step; where two directions share a pixel there is nothing to find, and raytwin "
        "says so.",
        OPENCV, {f"OpenCV, {k} steps": contracted(k) for k in (5, 20, 200)}, slack=1.5, trials=8,
    ),
    Experiment(
        "lens-fold", "A lens that folds within the frame", "|k1|, k1 < 0", "share of the frame that is silently wrong",
        1e-3, spaced(0.05, 2, 17), silently_wrong, (EVERY,),
        "Beyond the radius 2 / (3 √(3 |k1|)) the polynomial turns back: no direction belongs to such a pixel, but "
        "every iteration returns one. raytwin follows the way from the principal point to the border, finds the fold, "
        "and refuses the camera with the pixel's name.",
        "Leotta, Russell and Matrai, On the maximum radius of polynomial lens distortion (2022)",
        dict.fromkeys(("OpenCV, 200 steps", "Newton's, unchecked"), beyond_fold), slack=1.4, trials=1,
    ),
)  # fmt: skip
