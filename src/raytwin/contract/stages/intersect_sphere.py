"""Rays against a sphere: |o + t d - c|² = r², so a t² + 2 b t + c = 0: a = d·d, b = f·d, c = f·f - r², f = o - c."""

from collections.abc import Callable
from typing import Any

import numpy as np

from raytwin.contract.stage import Arrays, Case, Function, Stage, Variant, before, unit
from raytwin.scene import Sphere
from raytwin.tracer import intersect_sphere as tracers


def intersect_sphere(origins: Any, directions: Any, center: Any, radius: float) -> Any:
    """The smallest t > 0 where each ray, origin + t direction, meets the sphere: (N,); np.inf for a miss.

    Directions need not be unit, and t counts in their lengths. A ray that starts inside meets the sphere once.

    origins, directions: (N, 3); center: (3,); radius: metres.
    """
    length = np.linalg.norm(directions, axis=-1)
    x, y, z = (float(c) for c in center)
    sphere = Sphere((x, y, z), float(radius))
    unit = np.asarray(directions, float) / length[:, None]
    with np.errstate(all="ignore"):
        return np.asarray(tracers(tuple(np.asarray(origins, float).T), tuple(unit.T), sphere) / length)


def cases(seed: int) -> list[Case]:
    """32 rays of each kind, none of them near the outline, where rounding decides."""
    rng = np.random.default_rng(seed)
    center, radius = rng.uniform([-0.1, -0.4, 0.6], [0.5, 0.2, 1.2]), float(rng.uniform(0.15, 0.3))
    out = unit(rng.normal(size=(32, 3)))
    outside = center + radius * rng.uniform(1.5, 4, (32, 1)) * out
    inside = center + radius * rng.uniform(0.1, 0.8, (32, 1)) * out
    aim = center + 0.8 * radius * unit(rng.normal(size=(32, 3))) * rng.uniform(0, 1, (32, 1))
    towards = unit(aim - outside)
    side = unit(np.cross(out, rng.normal(size=(32, 3))))
    sine = radius * rng.uniform(1.1, 1.4, (32, 1)) / np.linalg.norm(outside - center, axis=-1, keepdims=True)
    past = sine * side - np.sqrt(1 - sine**2) * out
    lengths = np.concatenate([rng.uniform(0.3, 0.8, (16, 1)), rng.uniform(1.3, 4, (16, 1))])
    anywhere = unit(rng.normal(size=(32, 3)))
    axes = np.eye(3)[[0, 1, 2]]
    drawn = (
        ("rays that meet it from outside", outside, towards),
        ("directions that are not unit", outside, towards * lengths),
        ("rays that start inside", inside, anywhere),
        ("rays that start inside, with directions that are not unit", inside, anywhere * lengths),
        ("a sphere behind the ray", outside, -towards),
        ("rays that miss", outside, past * lengths),
        ("rays that start inside, level with the centre", center + 0.5 * radius * axes, axes[[1, 2, 0]]),
        ("a ray alone", outside[:1], towards[:1] * 2),
    )
    made = []
    for shows, o, d in drawn:
        args = (o, d, center, radius)
        made.append(Case(shows, args, (intersect_sphere(*args),)))
    return made


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """|t - t₀| / t₀; 1 where a hit is missed or made up, infinity for NaN."""
    right, t = expected[0], got[0]
    with np.errstate(all="ignore"):
        off = np.abs(t - right) / right
    off = np.where(np.isinf(right) & np.isinf(t), np.where(t > 0, 0.0, 1.0), off)
    return np.where(np.isnan(t), np.inf, np.where(np.isinf(right) != np.isinf(t), 1.0, off))


def hint(expected: Arrays, got: Arrays) -> str:
    if len(got) == 2:
        return "both roots, or t and a mask, are returned: one array t is wanted, np.inf for a miss"
    n = len(expected[0])
    return {
        (n, 1): "one number a ray is wanted: take the last axis away ([:, 0])",
        (n, 3): "points, or components, are returned: t is wanted, one number a ray",
        (): "one number is returned for all rays: one a ray is wanted",
        (n, 2): "both roots are returned: the smallest that is > 0 is wanted",
    }.get(got[0].shape, "") if got else ""  # fmt: skip


# ------------------------------------------------------------------------------------------ typical mistakes


def _near_far(near: Any, far: Any) -> Any:
    return np.where(near > 0, near, np.where(far > 0, far, np.inf))


def _solved(
    choose: Callable[[Any, Any], Any] = _near_far,
    roots: Callable[[Any, Any, Any], tuple[Any, Any, Any]] | None = None,
    miss: float = np.inf,
) -> Callable[[Function], Function]:
    """The quadratic, parts exchanged: `roots(a, b, c)` gives (discriminant, near, far), `choose` one of these."""

    def right(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
        disc = b * b - a * c
        return disc, (-b - np.sqrt(disc)) / a, (-b + np.sqrt(disc)) / a

    def wrong(origins: Any, directions: Any, center: Any, radius: Any) -> Any:
        f = origins - center
        a, b, c = (directions**2).sum(-1), (f * directions).sum(-1), (f * f).sum(-1) - radius**2
        with np.errstate(all="ignore"):
            disc, near, far = (roots or right)(a, b, c)
            return np.where(disc >= 0, choose(near, far), miss)

    return lambda f: wrong


def _miss(value: float) -> Callable[[Function], Function]:
    return lambda f: lambda *args: (lambda t: np.where(np.isinf(t), value, t))(f(*args))


def _smallest(near: Any, far: Any) -> Any:
    return np.where(np.abs(near) < np.abs(far), near, far)


def _positive_or_miss(t: Any) -> Any:
    return np.where(t > 0, t, np.inf)


def _signless(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    """q = -(b + sign(b) √disc), whose sign(0) is 0."""
    disc = b * b - a * c
    q = -(b + np.sign(b) * np.sqrt(disc))
    s, t = q / a, np.where(q == 0, np.inf, c / q)
    return disc, np.minimum(s, t), np.maximum(s, t)


def _factors(disc_of: Callable[..., Any], root_of: Callable[..., Any]) -> Callable[[Function], Function]:
    """Discriminant `disc_of(a, b, c)`, roots `root_of(a, b, ±√disc)`."""

    def roots(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
        disc = disc_of(a, b, c)
        return disc, root_of(a, b, -np.sqrt(disc)), root_of(a, b, np.sqrt(disc))

    return _solved(roots=roots)


VARIANTS = (
    Variant("far root", "the far root is returned where the near one is wanted: (-b - √disc) comes first",
            _solved(lambda near, far: _positive_or_miss(far))),
    Variant("far root", "the far root is returned, behind the ray's origin too: the smallest t > 0 is wanted, "
            "(-b - √disc) if that is > 0", _solved(lambda near, far: far)),
    Variant("smallest |t|", "the root of smallest |t| is returned: the smallest t > 0 is wanted, so negative roots are "
            "out first", _solved(_smallest)),
    Variant("smallest |t|", "the root of smallest |t| is taken, and none where it is negative: the smallest t > 0 is "
            "wanted, so negative roots are out first", _solved(lambda n, f: _positive_or_miss(_smallest(n, f)))),
    Variant("t behind the origin", "t < 0 is returned: what lies behind the ray's origin is no hit",
            _solved(lambda near, far: near)),
    Variant("t behind the origin", "t < 0 is returned where the whole sphere is behind the ray's origin: that is a "
            "miss",
            _solved(lambda near, far: np.where(near > 0, near, far))),
    Variant("|t| of what is behind", "the sign of t is lost: what lies behind the ray's origin is no hit",
            _solved(lambda near, far: np.abs(near))),
    Variant("inside missed", "rays that start inside the sphere miss it: where the near root is negative, the far one "
            "may be positive", _solved(lambda near, far: _positive_or_miss(near))),
    Variant("misses are NaN", "a miss is NaN: np.inf is wanted (√ of a negative discriminant)", _miss(np.nan)),
    Variant("misses are 0", "a miss is 0: np.inf is wanted", _miss(0.0)),
    Variant("misses are -1", "a miss is -1: np.inf is wanted", _miss(-1.0)),
    Variant("no test of the discriminant", "a ray that misses gets a t, because a negative discriminant is made 0: "
            "where "
            "it is negative the ray misses", _factors(lambda a, b, c: np.maximum(b * b - a * c, 0),
                                                     lambda a, b, s: (-b + s) / a)),
    Variant("directions taken for unit", "the directions are taken to be unit (a = 1): divide by a = d·d",
            _factors(lambda a, b, c: b * b - c, lambda a, b, s: -b + s)),
    Variant("t of unit rays", "t is that of unit directions: the directions are made unit inside, and t is not divided "
            "by their length afterwards",
            before(lambda o, d, c, r: (o, d / np.linalg.norm(d, axis=-1, keepdims=True), c, r))),
    Variant("radius squared twice", "the radius is squared once too often", before(lambda o, d, c, r: (o, d, c,
            r * r))),
    Variant("radius not squared", "the radius is not squared: c = f·f - r²",
            before(lambda o, d, c, r: (o, d, c, np.sqrt(r)))),
    Variant("diameter", "the radius is halved: it is given as the radius, not as the diameter",
            before(lambda o, d, c, r: (o, d, c, r / 2))),
    Variant("diameter", "the radius is doubled: it is given as the radius, and used as it is",
            before(lambda o, d, c, r: (o, d, c, 2 * r))),
    Variant("centre left out", "the sphere's centre is left out: f = origin - center",
            before(lambda o, d, c, r: (o, d, 0 * c, r))),
    Variant("origin left out", "the rays' origin is left out: f = origin - center",
            before(lambda o, d, c, r: (0 * o, d, c, r))),
    Variant("f reversed", "f = center - origin in a formula that has f = origin - center: b has the wrong sign",
            before(lambda o, d, c, r: (2 * c - o, d, c, r))),
    Variant("a factor 2 in b", "a factor 2 is missing in b: with a t² + b t + c it is b = 2 f·d",
            _factors(lambda a, b, c: b * b - 4 * a * c, lambda a, b, s: (-b + s) / (2 * a))),
    Variant("a factor 2 in b", "b = 2 f·d belongs to disc = b² - 4ac and (-b ± √disc) / 2a: here a 2 too many is left",
            _factors(lambda a, b, c: 4 * b * b - a * c, lambda a, b, s: (-2 * b + s) / a)),
    Variant("a factor 4", "the 4 is missing in the discriminant: b² - 4ac",
            _factors(lambda a, b, c: 4 * b * b - a * c, lambda a, b, s: (-2 * b + s) / (2 * a))),
    Variant("a factor 2 below", "the roots are not divided by 2a: (-b ± √disc) / (2a)",
            _factors(lambda a, b, c: 4 * (b * b - a * c), lambda a, b, s: (-2 * b + s) / a)),
    Variant("a factor 2 below", "the roots are divided by 2a where the half of b is used: that is by a",
            _factors(lambda a, b, c: b * b - a * c, lambda a, b, s: (-b + s) / (2 * a))),
    Variant("/ 2 * a", "`/ 2 * a` multiplies by a: write / (2 * a)",
            _factors(lambda a, b, c: b * b - a * c, lambda a, b, s: (-b + s) * a)),
    Variant("sign of 0", "where b = 0, sign(b) is 0 and q = 0 is no root: take 1 for the sign of 0",
            _solved(roots=_signless)),
)  # fmt: skip

STAGE = Stage(intersect_sphere, ("t",), cases, errors, 1e-4, "of t", VARIANTS, hint=hint)
