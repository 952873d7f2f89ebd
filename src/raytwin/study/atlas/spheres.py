"""Where a ray meets a sphere: four ways to solve the quadratic, in float32 and float64, until digits are lost.

The truth is solved to 60 digits: Python's own decimal numbers hold every float exactly.
"""

from collections.abc import Callable, Iterable
from decimal import Context, Decimal, localcontext
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np

from raytwin.scene import Sphere
from raytwin.study.atlas.experiment import U32, U64, Error, Experiment, Law, spaced
from raytwin.tracer import SOLVERS, intersect_sphere

HAINES = (
    "Haines, Günther and Akenine-Möller, Precision Improvements for Ray/Sphere Intersection (Ray Tracing Gems, 2019)"
)
INPUTS = "exact, from float32 inputs"
"""The error that no float32 solver can avoid: rays and sphere are rounded, then solved to 60 digits."""

DIGITS = Context(prec=60, Emin=-(10**6), Emax=10**6)
"""The range of exponents is wide enough for the squares of the largest and the smallest floats."""


def hit(origin: Iterable[float], d: Iterable[float], center: Iterable[float], radius: float) -> float:
    """The least t > 0 with |origin + t d - center| = radius, d of any length; infinity for a miss."""
    with localcontext(DIGITS):
        along = [Decimal(float(v)) for v in d]
        f = [Decimal(float(o)) - Decimal(float(c)) for o, c in zip(origin, center, strict=True)]
        a, b, c = (dot(*pair) for pair in ((along, along), (f, along), (f, f)))
        c -= Decimal(float(radius)) ** 2
        disc = b * b - a * c
        if disc < 0:
            return inf
        near, far = (-b - disc.sqrt()) / a, (-b + disc.sqrt()) / a
        return float(near if near > 0 else far) if far > 0 else inf


def dot(a: Iterable[Decimal], b: Iterable[Decimal]) -> Decimal:
    return sum((v * w for v, w in zip(a, b, strict=True)), Decimal(0))


def hits(origin: np.ndarray, d: np.ndarray, center: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(n,): `hit` of each row of origin, d, center (n, 3) and radius (n,)."""
    return np.array([hit(*row) for row in zip(origin, d, center, radius, strict=True)])


class Rays(NamedTuple):
    """n rays at a sphere each: `origin`, `d` (unit), `center` (n, 3), `radius` (n,); `unit` is the length that errors
    are divided by (n,)."""

    origin: np.ndarray
    d: np.ndarray
    center: np.ndarray
    radius: np.ndarray
    unit: np.ndarray


def errors(rays: Rays, solvers: Iterable[str] = ("textbook", "robust")) -> dict[str, Error]:
    """The worst error of t over the rays, in their units; all of it, 1, where a hit is missed or made up."""
    truth = hits(*rays[:4])
    found: dict[str, Error] = {}
    for solver in solvers:
        for kind in (np.float32, np.float64):
            given: list[Any] = [np.asarray(a, kind) for a in rays[:4]]
            o, d, c, r = given
            t = intersect_sphere(tuple(o.T), tuple(d.T), Sphere(tuple(c.T), r), solver)
            found[f"{solver}, {np.dtype(kind)}"] = worst(np.asarray(t, float), truth, rays.unit)
    rounded = [np.asarray(a, np.float32).astype(float) for a in rays[:4]]
    # As every tracer makes its rays unit again in its own floats: an error of their length is not the solver's.
    length = np.linalg.norm(rounded[1], axis=1)
    return found | {INPUTS: worst(hits(*rounded) * length, truth, rays.unit)}


def worst(t: np.ndarray, truth: np.ndarray, unit: np.ndarray) -> float:
    missed = np.isfinite(truth) != np.isfinite(t)
    off = np.abs(np.where(np.isfinite(t) & np.isfinite(truth), t - truth, 0)) / unit
    return float(np.minimum(np.where(missed | np.isnan(t), 1.0, off), 1.0).max())


def directions(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors w (n, 3), and p perpendicular to them."""
    w, p = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, n, 3)))
    p -= (p * w).sum(axis=1, keepdims=True) * w
    return w, p / np.linalg.norm(p, axis=1, keepdims=True)


def seen_at(distance: float, off: np.ndarray, rng: np.random.Generator) -> Rays:
    """Rays from 0 that pass the centre of a unit sphere at `distance` by `off` (n,) radii."""
    w, p = directions(rng, len(off))
    d = (np.sqrt(distance**2 - off**2)[:, None] * w + off[:, None] * p) / distance
    one = np.ones(len(off))
    return Rays(0 * w, d, distance * w, one, one)


def far(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    return errors(seen_at(max(x, 1.5), 0.9 * rng.random(n), rng), ("textbook", "stable", "robust"))


def tangent(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Ten radii away, passing the centre by 1 - x radii."""
    return errors(seen_at(10.0, (1 - x) * np.ones(n), rng))


def ground(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """A height of 1 above a sphere of radius x, looking down by 20 to 90 degrees; errors as shares of t."""
    up, p = directions(rng, n)
    angle = np.radians(rng.uniform(20, 90, n))[:, None]
    d = np.cos(angle) * p - np.sin(angle) * up
    rays = Rays(0 * up, d / np.linalg.norm(d, axis=1, keepdims=True), -(1 + x) * up, np.full(n, x), np.ones(n))
    return errors(rays._replace(unit=hits(*rays[:4])))


def level(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """From within, along the x axis, the centre x radii ahead: what is left of b when the origin is level with it."""
    y, z = 0.3 * rng.random((2, n))
    rays = Rays(np.stack([np.full(n, -x), y, z], axis=1), np.tile([1.0, 0, 0], (n, 1)), np.zeros((n, 3)), np.ones(n),
                np.ones(n))  # fmt: skip
    return errors(rays, SOLVERS)


OURS = ("robust, float64",)
HALF_LEAST = 2.0**-150
"""Half of the smallest positive float32: anything smaller is rounded to 0."""


Rounded = Callable[[float, float], float]
"""(u, x) -> error, u being the unit roundoff."""


def laws(weak: Rounded, good: Rounded, exact: Rounded, others: Iterable[str] = ("textbook",)) -> dict[str, Law]:
    """The error of `others`, which take a difference of squares, of the robust solver, and of the inputs' rounding."""

    def at(law: Rounded, u: float) -> Law:
        return lambda x: law(u, x)

    made: dict[str, Law] = {}
    for kind, u in (("float32", U32), ("float64", U64)):
        made |= {f"{solver}, {kind}": at(weak, u) for solver in others}
        made[f"robust, {kind}"] = at(good, u)
    return made | {INPUTS: at(exact, U32)}


def grazing(k: float) -> Rounded:
    """k u / √disc, half of k u being what the discriminant is off by."""
    return lambda u, x: k * u / sqrt(2 * x)


EXPERIMENTS = (
    Experiment(
        "sphere-far", "A sphere far away", "distance / radius", "error of the hit, radii", 1e-3, spaced(1, 1e8, 17),
        far, OURS,
        "The discriminant is a difference of two squares of the distance D, and rounding either moves it by u D²: "
        "where that reaches r², at 2^12 radii in float32 and 2^26.5 in float64, nothing of the sphere is left. The "
        "perpendicular distance from ray to centre loses u D only, which is what rounding the ray itself costs.",
        HAINES, laws(lambda u, x: 2 * u * x * x, lambda u, x: 2 * u * x, lambda u, x: u * x, ("textbook", "stable")),
    ),
    Experiment(
        "sphere-ground", "A ground that is a large sphere", "radius / height of the eye",
        "error of the hit, of its distance", 1e-3, spaced(1, 1e8, 9), ground, OURS,
        "How far the eye stands above the surface is the small difference of two large lengths, so u R of it is lost, "
        "in every solver and already in the numbers of the centre. Only more digits help: float64 keeps eight for a "
        "planet seen from six centimetres.",
        HAINES, laws(lambda u, x: u * x, lambda u, x: u * x, lambda u, x: u * x / 2),
    ),
    Experiment(
        "sphere-tangent", "Rays that graze a sphere ten radii away", "share of the radius left to the outline",
        "error of the hit, radii", 1e-3, spaced(1e-1, 1e-12, 12), tangent, OURS,
        "At the outline the hit moves by the square root of what moves the ray: an error δ of the discriminant moves "
        "it by δ / 2√disc. The robust solver's δ is u D, the others' u D², and where δ is all of the discriminant, "
        "hits become misses.",
        HAINES,
        laws(grazing(100), grazing(10), grazing(10)),
    ),
    Experiment(
        "sphere-level", "A ray that starts level with the centre", "b = distance to the centre's level, radii",
        "error of the hit, radii", 1e-3, spaced(1, 1e-50, 11), level, OURS,
        "The numerically stable quadratic adds √disc to b with b's sign; written with a sign that is 0 at 0 it finds q "
        "= 0, which is no root, as soon as b is rounded to 0. A camera at a sphere's centre, or level with it, is "
        "enough.",
        "Press et al., Numerical Recipes (2007), section 5.6, with sgn(0) = 1",
        {"paper, float32": lambda x: float(x < HALF_LEAST)},
    ),
)  # fmt: skip
