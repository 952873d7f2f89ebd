"""The four sphere solvers against 60-digit arithmetic, and the failures that they are kept to show."""

import mpmath
import numpy as np
import pytest

from raytwin.scene import Sphere
from raytwin.tracer import SOLVERS, intersect_sphere

RIGHT = [name for name in SOLVERS if name != "paper"]


def exact_roots(f, d, r) -> tuple[float, float]:
    """Both roots of |f + t d/|d|| = r to 60 digits."""
    with mpmath.workdps(60):
        f, d = [mpmath.mpf(float(c)) for c in f], [mpmath.mpf(float(c)) for c in d]
        length = mpmath.sqrt(sum(c * c for c in d))
        b = sum(a * c for a, c in zip(f, d, strict=True)) / length
        root = mpmath.sqrt(b * b - sum(c * c for c in f) + mpmath.mpf(float(r)) ** 2)
        return float(-b - root), float(-b + root)


def rays_at(distance: float, dtype: type, rng: np.random.Generator, n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """f (n, 3) and d (n, 3): rays from `distance` away from a unit sphere, aimed within 0.9 of its radius."""
    away = rng.normal(size=(n, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    f = (distance * away).astype(dtype)
    side = np.cross(away, rng.normal(size=(n, 3)))
    side *= 0.9 * rng.random((n, 1)) / np.linalg.norm(side, axis=1, keepdims=True)
    d = side - f.astype(np.float64)
    return f, (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(dtype)


def solve(solver: str, f, d, r) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(is there a root, near, far)"""
    disc, roots = SOLVERS[solver](f, d, r)
    return disc >= 0, *roots()


def worst_error(solver: str, distance: float, dtype: type, rng: np.random.Generator) -> float:
    """The largest |error of t| / radius over rays at a unit sphere; a missed hit counts as 1."""
    f, d = rays_at(distance, dtype, rng)
    hit, near, _ = solve(solver, tuple(f.T), tuple(d.T), dtype(1))
    assert near.dtype == dtype
    exact = np.array([exact_roots(a, b, 1)[0] for a, b in zip(f, d, strict=True)])
    return float(np.max(np.where(hit, np.abs(near.astype(np.float64) - exact), 1.0)))


@pytest.mark.parametrize("distance", [2, 10, 100, 1e3, 1e4])
def test_the_robust_solver_loses_only_what_the_rays_own_rounding_loses(distance, rng):
    # Rounding turns a ray by half an ulp, which at distance D moves its hit by about D eps, more where it grazes.
    assert worst_error("robust", distance, np.float32, rng) < 4 * distance * np.finfo(np.float32).eps
    assert worst_error("robust", distance, np.float64, rng) < 4 * distance * np.finfo(np.float64).eps


@pytest.mark.parametrize("solver", ["textbook", "paper", "stable"])
def test_a_difference_of_large_squares_loses_a_far_sphere_in_float32(solver, rng):
    # The discriminant's digits: b² is about 4 D², so its rounding is about D² eps, against r² = 1.
    assert worst_error(solver, 10, np.float32, rng) < 3e-4
    assert worst_error(solver, 1e3, np.float32, rng) > 0.03
    assert worst_error(solver, 1e3, np.float64, rng) < 1e-9


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_is_right_where_the_sphere_is_near_and_numbers_are_long(solver, rng):
    for distance in (1.5, 3.0, 10.0):
        f, d = rays_at(distance, np.float64, rng, 50)
        hit, near, far = solve(solver, tuple(f.T), tuple(d.T), 1.0)
        assert hit.all()
        roots = np.array([exact_roots(a, b, 1) for a, b in zip(f, d, strict=True)])
        np.testing.assert_allclose(near, roots[:, 0], rtol=0, atol=2e-12)
        np.testing.assert_allclose(far, roots[:, 1], rtol=0, atol=2e-12)
        _, near, far = solve(solver, tuple(f.T), tuple(-d.T), 1.0)  # away from it: both lie behind
        np.testing.assert_allclose(near, -roots[:, 1], rtol=0, atol=2e-12)
        np.testing.assert_allclose(far, -roots[:, 0], rtol=0, atol=2e-12)


@pytest.mark.parametrize("solver", RIGHT)
def test_from_inside_the_far_side_is_met(solver, rng):
    f = rng.uniform(-0.5, 0.5, size=(50, 3))
    d = rng.normal(size=(50, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    f[0], d[0] = (0, 0.5, 0), (1, 0, 0)  # b = 0
    f[1] = 0  # the very centre
    t = intersect_sphere(tuple(f.T), tuple(d.T), Sphere((0.0, 0.0, 0.0), 1.0), solver)
    expected = [exact_roots(a, b, 1)[1] for a, b in zip(f, d, strict=True)]
    np.testing.assert_allclose(t, expected, rtol=1e-14)


def test_the_papers_sign_of_zero_misses_the_sphere_that_it_stands_level_with():
    # b = 0: the correct answer is √(1 - 1/4); q = 0 gives the root 0, which is not in front.
    inside = (np.zeros(1), np.full(1, 0.5), np.zeros(1))
    ahead = (np.ones(1), np.zeros(1), np.zeros(1))
    sphere = Sphere((0.0, 0.0, 0.0), 1.0)
    assert intersect_sphere(inside, ahead, sphere, "paper")[0] == np.inf
    assert intersect_sphere(inside, ahead, sphere, "stable")[0] == pytest.approx(0.75**0.5, rel=1e-15)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_tangent_ray_touches_where_it_passes_the_centre(solver):
    heights = np.array([1, 1 - 1e-9, 1 + 1e-9])
    origin = (np.full(3, -5.0), heights, np.zeros(3))
    t = intersect_sphere(origin, (1.0, 0.0, 0.0), Sphere((0.0,) * 3, 1.0), solver)
    assert t[0] == pytest.approx(5, rel=1e-15)
    assert t[1] == pytest.approx(5 - (1 - heights[1] ** 2) ** 0.5, rel=1e-9)
    assert t[2] == np.inf
