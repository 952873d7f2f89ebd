"""Mistakes where rays meet spheres and rectangles, and in which of them is seen."""

from collections.abc import Callable
from itertools import product

from raytwin.diagnose.changes import (
    ALONG_Z,
    IN_U,
    IN_V,
    MET,
    NU,
    NV,
    POINT,
    UNIT,
    T,
    Thing,
    Ways,
    before_shading,
    by_key,
    chain,
    gone,
    in_shadow_test,
    inside,
    is_ball,
    only_seen,
    order,
    other,
    others_hide,
    plane,
    reaching,
    resized,
    shading_normals,
    shadow,
    sphere,
    unit,
)
from raytwin.diagnose.predict import Array, Pipeline, SceneDict, replaced, slip, slips

ROOT, CHOICE, HIT = "np.sqrt(disc)", "t = np.where(near > 0, near, far)", "(disc >= 0) & (t > 0)"
A, B, OVER = "a = np.sum(directions * directions, axis=-1)", "b = 2 * np.sum", "/ (2 * a)"
SQUARE, LENGTH = "np.sum(f * f, axis=-1)", "np.linalg.norm(f, axis=-1)"
HALF = f"{B} => b = np.sum ;; b * b - 4 * a * c => b * b - a * c"
BY_Q = """q = -(b + np.sign(b) * np.sqrt(disc)) / 2
    near, far = np.minimum(q / a, c / q), np.maximum(q / a, c / q)
    near, far = np.where(q == 0, np.nan, near), np.where(q == 0, np.nan, far)
    t = np.where(near > 0, near, far)"""
ALONG = "(q @ half_u) / (half_u @ half_u)", "(q @ half_v) / (half_v @ half_v)"
AHEAD = "where((disc >= 0) & (t > 0), t"


def _edges(f: Callable[[Array, SceneDict], Array], *names: str) -> Pipeline:
    """Other edges of rectangles, those of these names."""
    return other(lambda x, scene: x | {name: f(x[name], scene) for name in names if name in x})


def _also(*tests: str) -> tuple[Pipeline, ...]:
    """Rectangles that end here, too."""
    return plane(*(f"{MET} => inside & ({test}) & (t > 0)" for test in tests))


def _between(*least_most: tuple[str, str]) -> str:
    """(-1, 1) for each axis is right."""
    return " & ".join(f"({a} >= {lo}) & ({a} <= {hi})" for a, (lo, hi) in zip(ALONG, least_most, strict=True))


BY_RAY = slip("radiance", (
    "normals_at(points, which, eye, things)",
    'normals_at(points, which, np.where(((points - eye) @ scene["R_cam_board"][2] < 0)[:, None], '
    "2 * points - eye, eye), things)",
))  # fmt: skip
"""Planes behind the eye turn to it by n·d, where d is the ray's direction."""
PLANES_BEHIND = (*plane(f"{MET} => inside"), BY_RAY)
(long,) = slips("through", f"{UNIT} => rays")

SOLVERS: Ways = {
    "far-root": sphere(f"{CHOICE} => t = far", f"{CHOICE} => t = far ;; {HIT} => disc >= 0"),
    "closest-approach": sphere("(-b - np.sqrt(disc)) => -b"),
    "behind-the-eye": (*(chain(*one, *other) for other in ((), PLANES_BEHIND) for one in (
        sphere(f"{CHOICE} => t = near ;; {HIT} => disc >= 0"),
        sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far) ;; {HIT} => disc >= 0"),
        (*sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far) ;; {HIT} => disc >= 0"),
        *order("np.argmin(t, axis=0) => np.argmin(np.abs(t), axis=0)")))),
        *sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far)", f"{HIT} => disc >= 0",
        f"{CHOICE} => t = np.abs(near)", f"{CHOICE} => t = np.minimum(np.abs(near), np.abs(far))",
        "far = (-b + np.sqrt(disc)) => far = (b + np.sqrt(disc))")),
    "sign-of-zero": sphere(f"{CHOICE} => {BY_Q}"),
    "t-along-z": (*slips("met", f"{POINT} => {POINT} / {ALONG_Z}[:, None]"),
        chain(long, *sphere(f"{AHEAD} => {AHEAD} * np.linalg.norm(directions, axis=-1)"))),
    "rays-not-unit": (*(chain(long, way) for way in sphere(f"{A} => a = 1.0", f"{OVER} => / 2", "4 * a * c => 4 * c")),
        *sphere(f"{A} => a = 1.0", "4 * a * c => 4 * c")),
    "hit-point": tuple(chain(slip("met", (POINT, new)), BY_RAY) for new in (
        "t[:, None] * directions", "origins - t[:, None] * directions", "origins + directions",
        "(origins + directions) * t[:, None]")),
    "t-of-moved-ray": sphere(f"{AHEAD} => {AHEAD} / radius", f"{AHEAD} => {AHEAD} * radius",
        f"{AHEAD}, => {AHEAD[:-1]}np.linalg.norm(origins + t[:, None] * directions - f / radius, axis=-1),"),
    "radius-not-squared": sphere("radius**2 => radius"),
    "length-not-squared": sphere(f"{SQUARE} => {LENGTH}", f"{SQUARE} - radius**2 => {LENGTH} - radius",
        f"{SQUARE} - radius**2 => ({LENGTH} - radius) ** 2"),
    "diameter": (*sphere("radius**2 => (2 * radius) ** 2"), resized(2)),
    "factor-in-quadratic":
        sphere(f"{B} => b = np.sum", f"{B} => b = np.sum ;; {OVER} => / a", "4 * a * c => a * c", f"{OVER} => / a",
        HALF, "4 * a * c => 2 * a * c", f"4 * a * c => a * c ;; {OVER} => / a", f"{OVER} => / (4 * a)",
        "- 4 * a * c => + 4 * a * c", f"{B} => b = 4 * np.sum", f"{B} => b = 0.5 * np.sum"),
    "root-missing": tuple(chain(*rays, way) for rays in ((), (long,))
        for way in sphere(f"{ROOT} => disc", f"{HALF} ;; {OVER} => / a ;; {ROOT} => disc")),
    "divided-by-half-a": tuple(chain(*rays, way) for rays in ((long,), ())
        for way in sphere(f"{OVER} => / 2 * a", f"{HALF} ;; {OVER} => * a")),
    "b-sign": sphere("origins - center => center - origins"),
    "disc-not-tested": sphere("b * b - 4 * a * c => np.maximum(b * b - 4 * a * c, 0)",
        "b * b - 4 * a * c => np.abs(b * b - 4 * a * c)"),
    "origin-left-out": sphere("origins - center => 0 * origins - center"),
    "center-left-out": sphere("origins - center => origins", "origins - center => origins + center"),
    "no-spheres": tuple(of(way) for way in sphere(f"{HIT} => disc < -np.inf") for of in (chain, only_seen)),
    "no-planes": tuple(of(way) for way in plane(f"{MET} => t < -np.inf") for of in (chain, only_seen)),
    "endless-planes": inside("np.isfinite(t)", IN_U, IN_V),
    "abs-missing": inside(*(_between(*way) for way in (
        (("-np.inf", "1"),) * 2, (("-1", "np.inf"),) * 2, (("-np.inf", "1"), ("-1", "1")),
        (("-1", "np.inf"), ("-1", "1")), (("-1", "1"), ("-np.inf", "1")), (("-1", "1"), ("-1", "np.inf"))))),
    "or-for-and": inside(f"({IN_U}) | ({IN_V})"),
    "extent-not-unit": inside(reaching(NU, NV), reaching("1", "1"), reaching(f"{NU}**3", f"{NV}**3"),
        *(reaching(u, "half_v @ half_v") for u in ("1", NU)), *(reaching("half_u @ half_u", v) for v in ("1", NV))),
    "extent-from-elsewhere": plane("directions - center => directions", "q = origins + t => q = t",
        "q = origins + t[:, None] * directions - center => q = t[:, None] * directions"),
    "corner": inside(*(_between(*way) for k in ("1", "2") for way in (
        (("0", k),) * 2, (("0", k), ("-1", "1")), (("-1", "1"), ("0", k))))),
    "edges-swapped": inside(reaching(f"{NU} * {NV}", f"{NU} * {NV}"), *(way for k in (1, 2) for way in (
        reaching("half_u @ half_u", f"{NV}**2 * ({NU} / {NV}) ** {k}"),
        reaching(f"{NU}**2 * ({NV} / {NU}) ** {k}", "half_v @ half_v")))),
    "disc-for-rectangle": inside(*(f"np.linalg.norm(q, axis=-1) <= {r}" for r in (
        f"max({NU}, {NV})", f"min({NU}, {NV})", f"np.hypot({NU}, {NV})", NU, NV)),
        f"np.hypot({ALONG[0]}, {ALONG[1]}) <= 1", f"np.abs({ALONG[0]}) + np.abs({ALONG[1]}) <= 1"),
    "plane-through-origin":
        plane("center - origins => -origins ;; directions - center => directions", "center - origins => -origins"),
    "plane-t": plane("center - origins => origins - center", f"{T} => {T} * np.linalg.norm(n)",
        f"{T} => {T} / np.linalg.norm(n)", f"{T} => (directions @ n) / ((center - origins) @ n)"),
    "one-sided": tuple(of(way) for of in (chain, only_seen, in_shadow_test)
        for way in _also("directions @ n < 0", "directions @ n > 0")),
    "edges-not-turned": (_edges(lambda x, c: c["R_cam_board"].T @ x, "half_u", "half_v"),
        _edges(lambda x, c: c["R_cam_board"] @ x, "half_u", "half_v"),
        _edges(lambda x, c: c["R_cam_board"].T @ c["R_cam_board"].T @ x, "half_u", "half_v"),
        *(_edges(lambda x, c: c["R_cam_board"].T @ x, name) for name in ("half_u", "half_v"))),
    "edges-moved": (_edges(lambda x, c: x + c["R_cam_board"].T @ c["t_cam_board"], "half_u", "half_v"),),
    "half-edges": inside(*(reaching(f"{k} * (half_u @ half_u)", f"{k} * (half_v @ half_v)") for k in (0.5, 2.0))),
    "planes-behind": (chain(*PLANES_BEHIND), *plane(f"{MET} => inside", f"{T} => np.abs({T})"),
        chain(*PLANES_BEHIND, *shadow('(own | => ((own & ("radius" in thing)) |'))),
}  # fmt: skip

# ---------------------------------------------------------------------------------- which is seen

AWAY = 'np.linalg.norm([x["center"] - eye for x in things], axis=-1)[:, None]'
RADII = 'np.array([[x.get("radius", 0.0)] for x in things])'
HEIGHTS = 'np.array([[x["center"][2]] for x in things])'
FIRST, LAST = "one = met.argmax(axis=0)", "one = len(met) - 1 - met[::-1].argmax(axis=0)"


def _one_of_kind(kind: str, which: str) -> Pipeline:
    """See the last or the first hit of one kind, or something of the other kind before it."""
    first = f"met = np.isfinite(every_t) & {kind}\n    {which}"
    return by_key(f"np.where({kind} & (number != one), np.inf, every_t)", first=first)[0]


def _all_written(kind: str, albedo: bool, normal: bool, there: bool = True) -> Pipeline:
    """Write the albedo or normal of the last object of this kind that the eye's ray meets.

    `there`: the normal where it is met itself, not at the point that is seen.
    """
    lines = [
        f"d = {unit('points - eye')}",
        "every_t = intersect_all(np.tile(eye, (len(points), 1)), d, things)",
        "ball = np.array([['radius' in x] for x in things])",
        f"there = np.isfinite(every_t) & ({kind})",
        "last = np.where(there.any(axis=0), len(there) - 1 - there[::-1].argmax(axis=0), which)",
    ]
    where = "eye + every_t[last, np.arange(len(last))][:, None] * d" if there else "points"
    paint = ["albedo = np.array([x['albedo'] for x in things])[last]"] if albedo else []
    if not normal:
        return before_shading(*lines, *paint)
    return shading_normals(f"normals_at({where}, last, eye, things)", *lines, *paint)


def less(kinds: tuple[bool, ...], lost: slice) -> tuple[Pipeline, Pipeline]:
    """Lose some spheres (True), planes (False) or both: out of reach, so that ids stay; or for the eye alone."""

    def which(things: list[Thing]) -> list[int]:
        return [k for k, x in enumerate(things) if is_ball(x) in kinds][lost]

    def all_but(scene: SceneDict) -> SceneDict:
        out = which(scene["things"])
        return scene | {"things": [gone(x) if k in out else x for k, x in enumerate(scene["things"])]}

    unseen = by_key("np.where(np.isin(number, lost(things)), np.inf, every_t)")[0]
    return (("things", all_but),), chain(unseen, replaced(lost=lambda _: which))


ORDERS: Ways = {
    "last-wins": by_key("-number + 0 * every_t", "ball * 1e6 * -1 - number + 0 * every_t"),
    "first-wins": (*by_key("number + 0 * every_t", "ball * 1e6 + number + 0 * every_t"),
        *(_one_of_kind(kind, FIRST) for kind in ("ball", "~ball"))),
    "painter":
        by_key(f"{AWAY} + 0 * every_t", f"np.where(ball, {AWAY}, 1e6 + every_t)", f"{AWAY} - {RADII} + 0 * every_t",
        f"np.where(ball, -{HEIGHTS}, 1e6 + every_t)"),
    "spheres-on-top": by_key("every_t + 1e6 * ~ball", "np.where(ball, -1e6 - number, every_t)"),
    "planes-on-top": by_key("every_t + 1e6 * ball", "np.where(~ball, -1e6 - number, every_t)"),
    "last-sphere-wins": (_one_of_kind("ball", LAST),),
    "last-plane-wins": (_one_of_kind("~ball", LAST),),
    "farthest-wins": by_key("-every_t"),
    "t-of-other-rays": by_key(f"every_t * np.where(ball, 1, {ALONG_Z})", f"every_t * np.where(ball, {ALONG_Z}, 1)"),
    "depth-from-elsewhere":
        by_key("np.linalg.norm(origins + np.nan_to_num(every_t, posinf=0)[..., None] * directions, axis=-1)"),
    "hidden-one-written": (
        *(_all_written(kind, albedo, normal) for albedo, normal in ((True, False), (False, True), (True, True))
        for kind in ("True", "~ball", "ball")),
        *(chain(*test, _all_written("True", True, True, there=False)) for test in ((), (others_hide,)))),
    "one-sphere": (*less((True,), slice(1, None)), *less((True,), slice(None, -1))),
    "object-missing":
        tuple(way for kind, one in product(((True,), (False,), (True, False)), (slice(1), slice(-1, None)))
        for way in less(kind, one)),
    "one-plane": (*less((False,), slice(1, None)), *less((False,), slice(None, -1))),
}  # fmt: skip

ALONE: Ways = {
    "inside-missed": sphere(f"{CHOICE} => t = near"),
    "misses-not-infinite": sphere(*(f"t, np.inf) => t, {miss})" for miss in ("np.nan", "0.0", "-1.0"))),
    "t-of-unit-rays": sphere(f"{AHEAD} => {AHEAD} * np.linalg.norm(directions, axis=-1)"),
    "sum-of-all": sphere(f"{A} => a = np.sum(directions * directions)", f"{SQUARE} => np.sum(f * f)"),
}  # fmt: skip
