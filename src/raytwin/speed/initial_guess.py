"""Undo a lens in one step or two: Newton's method from an initial guess that is fitted to the lens, once per camera."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from raytwin.arrays import library
from raytwin.scene import Camera
from raytwin.scene.lens import STEPS, check_lens, distort, has_no_ray
from raytwin.tracer.pixel_to_ray import undistort

TERMS = 8, 3
"""Terms of the radial and of the tangential series: with these, float32 needs one step for most lenses."""

ALIKE = 1e-4
"""Solutions farther apart than this, in normalised coordinates, are different roots; rounding moves them far less."""


Terms = tuple[Any, ...]


class Inverse(NamedTuple):
    """How to undo a camera's distortion: a start, then `steps` of Newton's.

    With r² = xd² + yd² and s = p2 xd + p1 yd, it starts at x = xd (1 + r² A(r²) + s B(r²)) + p2 r² C(r²), and y alike
    with p1: what the inverse of a lens is to first order in p1 and p2. A is `radial`; B, C are `along`, `across`.
    """

    steps: int
    radial: Terms = (0.0,)
    along: Terms = ()
    across: Terms = ()

    def start(self, xd: Any, yd: Any, dist: Any) -> tuple[Any, Any]:
        _, _, p1, p2, _ = dist
        rr = xd * xd + yd * yd
        scale = rr * _series(self.radial, rr)
        if self.along:
            scale = scale + (p2 * xd + p1 * yd) * _series(self.along, rr)
        x, y = xd + xd * scale, yd + yd * scale
        if self.across:
            shift = rr * _series(self.across, rr)
            x, y = x + p2 * shift, y + p1 * shift
        return x, y

    def undo(self, xd: Any, yd: Any, dist: Any) -> tuple[Any, Any]:
        """`undistort`, quickly."""
        if not self.radial:
            return xd, yd
        return undistort(xd, yd, dist, self.start(xd, yd, dist), self.steps)


def quick(undo: Callable[..., Any], inverse: Inverse) -> Callable[..., Any]:
    """The tracer's own `undo` by way of `inverse`; a student's, or a fault, unchanged."""
    return inverse.undo if undo is undistort else undo


def _series(c: Terms, rr: Any) -> Any:
    """c0 + c1 r² + c2 r⁴ + ..., by Estrin's scheme: pairs that do not wait for one another."""
    while len(c) > 1:
        c = tuple(_fma(c[i + 1], rr, c[i]) if i + 1 < len(c) else c[i] for i in range(0, len(c), 2))
        rr = rr * rr
    return c[0]


def _fma(a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once where the library can."""
    return a * b + c if (xp := library(a, b, c)) is np else xp.fma(a, b, c)


@lru_cache(maxsize=64)
def invert_lens(camera: Camera, precision: str = "float64", fitted: bool = True) -> Inverse:
    """The cheapest Inverse that undoes the camera's distortion to rounding wherever it can be; no step for a pinhole.

    The guess is `fitted` to the frame, so that one step serves in float32 for most lenses, and two in float64; for
    single numbers more steps from the distorted point itself are quicker. Raises InputError where `check_lens` does.
    """
    if not any(camera.dist):
        return Inverse(0, ())
    check_lens(camera)
    u = np.linspace(-0.5, camera.width - 0.5, 33)
    v = np.linspace(-0.5, camera.height - 0.5, 33)[:, None]
    xd, yd = np.broadcast_arrays((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    xd, yd = (a[~has_no_ray(camera, u, v)] for a in (xd, yd))
    with np.errstate(all="ignore"):
        x, y = Inverse(STEPS).undo(xd, yd, camera.coefficients)
        enough = 2e-14 if precision == "float64" else 2e-8
        guess = _fit(xd, yd, x, y, camera) if fitted else Inverse(0)
        for start in (guess, Inverse(0)):
            for steps in range(STEPS):
                inverse = start._replace(steps=steps)
                ended = inverse.undo(xd, yd, camera.coefficients)
                apart = np.hypot(ended[0] - x, ended[1] - y).max()  # large at a root beyond a fold
                if _error(*ended, xd, yd, camera) < enough and apart < ALIKE:
                    return inverse
    return Inverse(STEPS)


def _fit(xd: np.ndarray, yd: np.ndarray, x: np.ndarray, y: np.ndarray, camera: Camera) -> Inverse:
    """The start that takes (xd, yd) closest to (x, y), by least squares over both coordinates."""
    p1, p2 = camera.coefficients[2:4]
    rr, s = xd * xd + yd * yd, p2 * xd + p1 * yd
    radial, tangential = TERMS[0], TERMS[1] if p1 or p2 else 0
    columns = [(xd * rr**k, yd * rr**k) for k in range(1, radial + 1)]
    columns += [(xd * s * rr**k, yd * s * rr**k) for k in range(tangential)]
    columns += [(p2 * rr**k, p1 * rr**k) for k in range(1, tangential + 1)]
    a = np.array([np.concatenate(pair) for pair in columns]).T
    size = np.abs(a).max(axis=0)
    terms = (np.linalg.lstsq(a / size, np.concatenate([x - xd, y - yd]), rcond=None)[0] / size).tolist()
    ends = radial, radial + tangential
    return Inverse(0, tuple(terms[: ends[0]]), tuple(terms[ends[0] : ends[1]]), tuple(terms[ends[1] :]))


def _error(x: np.ndarray, y: np.ndarray, xd: np.ndarray, yd: np.ndarray, camera: Camera) -> float:
    bx, by = distort(x, y, camera.coefficients)
    return float(np.hypot(bx - xd, by - yd).max())
