"""Mistakes where rays meet spheres and rectangles."""

from collections.abc import Callable, Sequence
from typing import Any

from raytwin.diagnose.changes import (
    ALONG_Z,
    CROSS,
    CROSS_AT,
    IN_U,
    IN_V,
    MET,
    NU,
    NV,
    POINT,
    SOLVER,
    UNIT,
    T,
    Thing,
    chain,
    in_shadow_test,
    inside,
    is_ball,
    normals_at,
    only_seen,
    order,
    other,
    plane,
    reaching,
    resized,
    row,
    shadow,
    sphere,
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
D2 = "np.sum(f * f, axis=-1) - b * b / (4 * a)"
ALONG = "(q @ half_u) / (half_u @ half_u)", "(q @ half_v) / (half_v @ half_v)"
GRAZING = "np.abs(directions @ n) / np.linalg.norm(n) / np.linalg.norm(directions, axis=-1)"
AHEAD = "where((disc >= 0) & (t > 0), t"


def reradiused(f: Any, own: bool = False) -> Pipeline:
    """Spheres of other radii, (the sphere, all spheres) -> r; `own`: normals are divided by the right ones."""

    def changed(things: Sequence[Thing]) -> list[Thing]:
        balls = [x for x in things if is_ball(x)]
        return [x | {"radius": max(f(x, balls), 1e-9)} if is_ball(x) else x for x in things]

    if own:
        return replaced(intersect_all=lambda right: lambda o, d, things: right(o, d, changed(things)))
    return replaced(things=lambda scene: scene | {"things": changed(scene["things"])})


def _edges(f: Callable[[Array, SceneDict], Array], *names: str) -> Pipeline:
    """Other edges of rectangles, those of these names."""
    return other(lambda x, scene: x | {name: f(x[name], scene) for name in names if name in x})


def _also(*tests: str) -> tuple[Pipeline, ...]:
    """Rectangles that end here, too."""
    return plane(*(f"{MET} => inside & ({test}) & (t > 0)" for test in tests))


def _between(*least_most: tuple[str, str]) -> str:
    """(-1, 1) for each axis is right."""
    return " & ".join(f"({a} >= {lo}) & ({a} <= {hi})" for a, (lo, hi) in zip(ALONG, least_most, strict=True))


def _crossed(*lines: str) -> tuple[Pipeline, ...]:
    """Planes whose normal is another: what rays meet, and what is lit."""
    return tuple(
        chain(*plane(f"{CROSS} => {CROSS}\n    {line}"),
             *normals_at(f"{CROSS_AT} => {CROSS_AT}\n            {line.replace('half_', 'thing_')}"
                         .replace("thing_u", 'thing["half_u"]').replace("thing_v", 'thing["half_v"]')))
        for line in lines
    )  # fmt: skip


BY_RAY = slip("radiance", (
    "normals_at(points, which, eye, things)",
    'normals_at(points, which, np.where(((points - eye) @ scene["R_cam_board"][2] < 0)[:, None], '
    "2 * points - eye, eye), things)",
))  # fmt: skip
"""Planes behind the eye turn to it by n·d, where d is the ray's direction."""
PLANES_BEHIND = (*plane(f"{MET} => inside"), BY_RAY)
(long,) = slips("through", f"{UNIT} => rays")

SOLVERS = (
    row("far-root", SOLVER,
        "you take the far root, where the ray leaves the sphere: take the smallest t > 0",
        *sphere(f"{CHOICE} => t = far", f"{CHOICE} => t = far ;; {HIT} => disc >= 0")),
    row("closest-approach", SOLVER,
        "the ray's point that is nearest to the centre is taken for the hit: half the chord has to be subtracted, "
        "t = -f·d - √(...)",
        *sphere("(-b - np.sqrt(disc)) => -b")),
    row("behind-the-eye", SOLVER,
        "hits behind the ray's start count too: take the smallest positive t, not the smallest |t|, and none where "
        "both are negative",
        *(chain(*one, *other) for other in ((), PLANES_BEHIND) for one in (
            sphere(f"{CHOICE} => t = near ;; {HIT} => disc >= 0"),
            sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far) ;; {HIT} => disc >= 0"),
            (*sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far) ;; {HIT} => disc >= 0"),
             *order("np.argmin(t, axis=0) => np.argmin(np.abs(t), axis=0)")))),
        *sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far)", f"{HIT} => disc >= 0",
                f"{CHOICE} => t = np.abs(near)", f"{CHOICE} => t = np.minimum(np.abs(near), np.abs(far))",
                "far = (-b + np.sqrt(disc)) => far = (b + np.sqrt(disc))")),
    row("inside-missed", SOLVER,
        "rays that start inside the sphere miss it: where the near root is negative, the far one may be positive",
        alone=sphere(f"{CHOICE} => t = near")),
    row("misses-not-infinite", SOLVER,
        "a miss has to be np.inf: where the discriminant is negative, and where t is not positive",
        alone=sphere(*(f"t, np.inf) => t, {miss})" for miss in ("np.nan", "0.0", "-1.0")))),
    row("sign-of-zero", SOLVER,
        "sign(0) is 0: where b = 0 your q is 0 and the root is lost; let the sign be 1 there",
        *sphere(f"{CHOICE} => {BY_Q}")),
    row("t-along-z", SOLVER,
        "t was found for unit rays, but is applied to (x, y, 1): use one and the same vector for both",
        *slips("met", f"{POINT} => {POINT} / {ALONG_Z}[:, None]"),
        chain(long, *sphere(f"{AHEAD} => {AHEAD} * np.linalg.norm(directions, axis=-1)"))),
    row("t-of-unit-rays", SOLVER,
        "t is that of unit directions: the directions are made unit inside, and t is not divided by their length "
        "afterwards",
        alone=sphere(f"{AHEAD} => {AHEAD} * np.linalg.norm(directions, axis=-1)")),
    row("rays-not-unit", SOLVER,
        "your rays are not unit, but the quadratic leaves out a = d·d: make them unit, or keep a",
        *(chain(long, way) for way in sphere(f"{A} => a = 1.0", f"{OVER} => / 2", "4 * a * c => 4 * c")),
        *sphere(f"{A} => a = 1.0", "4 * a * c => 4 * c")),
    row("hit-point", SOLVER,
        "the hit point is wrong: it is the ray's origin plus t times its direction, o + t d",
        *(chain(slip("met", (POINT, new)), BY_RAY) for new in (
            "t[:, None] * directions", "origins - t[:, None] * directions", "origins + directions",
            "(origins + directions) * t[:, None]"))),
    row("t-of-moved-ray", SOLVER,
        "t is measured in the sphere's own frame, where the ray is moved and scaled: t counts along the ray as it was "
        "given, so scale its direction as its origin, do not make it unit there, and apply t to the first one",
        *sphere(f"{AHEAD} => {AHEAD} / radius", f"{AHEAD} => {AHEAD} * radius",
                f"{AHEAD}, => {AHEAD[:-1]}np.linalg.norm(origins + t[:, None] * directions - f / radius, axis=-1),")),
    row("radius-not-squared", SOLVER, "the radius is not squared: c = f·f - r²", *sphere("radius**2 => radius")),
    row("miss-by-radius", SOLVER,
        "a distance is held against a square: a ray misses the sphere where its distance from the centre, squared, "
        "is above r² (both squared, or neither)",
        *(chain(slip("met"), way) for r in ("radius", "radius**4")
          for way in sphere(f"{HIT} => ({D2} <= {r}) & (t > 0) ;; {ROOT} => np.sqrt(np.maximum(disc, 0))"))),
    row("length-not-squared", SOLVER, "the length of f is not squared: c = f·f - r², where f·f = |f|²",
        *sphere(f"{SQUARE} => {LENGTH}", f"{SQUARE} - radius**2 => {LENGTH} - radius",
                f"{SQUARE} - radius**2 => ({LENGTH} - radius) ** 2")),
    row("radius-squared-twice", SOLVER, "the radius is squared twice: c = f·f - r²", *sphere("radius**2 => radius**4")),
    row("diameter", SOLVER, "your spheres are twice as large: the scene gives the radius, not the diameter",
        *sphere("radius**2 => (2 * radius) ** 2"), resized(2)),
    row("half-radius", SOLVER, "your spheres are half as large: the scene gives the radius, not the diameter",
        *sphere("radius**2 => (radius / 2) ** 2"), resized(0.5)),
    row("radius-of-another", SOLVER,
        "spheres have a radius that is not theirs, the one of another sphere or a coordinate of the centre: each has "
        "its own",
        *(reradiused(lambda x, balls, k=k: balls[k]["radius"], own) for k in (0, -1) for own in (False, True)),
        reradiused(lambda x, balls: abs(x["center"][2]))),
    row("factor-in-quadratic", SOLVER,
        "a factor is wrong in the quadratic: with b = 2 f·d, t = (-b - √(b² - 4c)) / 2; with b = f·d, "
        "t = -b - √(b² - c)",
        *sphere(f"{B} => b = np.sum", f"{B} => b = np.sum ;; {OVER} => / a", "4 * a * c => a * c", f"{OVER} => / a",
                HALF, "4 * a * c => 2 * a * c", f"4 * a * c => a * c ;; {OVER} => / a", f"{OVER} => / (4 * a)",
                "- 4 * a * c => + 4 * a * c", f"{B} => b = 4 * np.sum", f"{B} => b = 0.5 * np.sum")),
    row("root-missing", SOLVER, "the discriminant's square root is missing: t = (-b ± √disc) / (2a)",
        *(chain(*rays, way) for rays in ((), (long,))
          for way in sphere(f"{ROOT} => disc", f"{HALF} ;; {OVER} => / a ;; {ROOT} => disc"))),
    row("divided-by-half-a", SOLVER,
        "`/ 2 * a` multiplies by a: write / (2 * a), or make the rays unit",
        *(chain(*rays, way) for rays in ((long,), ())
          for way in sphere(f"{OVER} => / 2 * a", f"{HALF} ;; {OVER} => * a"))),
    row("disc-above", SOLVER,
        "the discriminant is held against a number above 0, so that spheres are too small, small ones most: a ray "
        "meets the sphere wherever it is not negative",
        *sphere(*(f"disc >= 0 => disc >= {k}" for k in (4e-2, 1e-2, 4e-3, 1e-3, 4e-4, 1e-4)),
                f"{ROOT} => np.sqrt(-disc) ;; disc >= 0 => disc <= 0")),
    row("b-sign", SOLVER,
        "f points the wrong way in the quadratic: f goes from the sphere's centre to the ray's origin (o - c)",
        *sphere("origins - center => center - origins")),
    row("disc-not-tested", SOLVER,
        "the discriminant is not tested: where it is negative the ray misses the sphere",
        *sphere("b * b - 4 * a * c => np.maximum(b * b - 4 * a * c, 0)",
                "b * b - 4 * a * c => np.abs(b * b - 4 * a * c)")),
    row("sum-of-all", SOLVER, "one sum is over all rays and components: sum over the last axis alone (axis=-1)",
        alone=sphere(f"{A} => a = np.sum(directions * directions)", f"{SQUARE} => np.sum(f * f)")),
    row("origin-left-out", SOLVER, "the rays' origin is left out of the quadratic: f = o - c",
        *sphere("origins - center => 0 * origins - center")),
    row("center-left-out", SOLVER, "the spheres' centres are left out of the quadratic: f = o - c",
        *sphere("origins - center => origins", "origins - center => origins + center")),
    row("t-too-near", SOLVER,
        "hits are thrown away unless t is large: the smallest t > 0 counts, however small",
        *(chain(*way) for k in (0.1, 0.5, 1.0) for way in (
            (*sphere(f"(t > 0) => (t > {k})"), *plane(f"(t > 0) => (t > {k})")), sphere(f"(t > 0) => (t > {k})")))),
    row("t-too-far", SOLVER,
        "hits that are far away are thrown away: the first t to beat is infinity (np.inf)",
        *(only_seen(chain(*sphere(f"(t > 0) => (t > 0) & (t < {k})"), *plane(f"(t > 0) => (t > 0) & (t < {k})")))
          for k in (1.0, 2.0, 3.0, 5.0, 10.0))),
    row("no-spheres", SOLVER, "no sphere is hit at all: the discriminant or the test t > 0 throws every hit away",
        *(of(way) for way in sphere(f"{HIT} => disc < -np.inf") for of in (chain, only_seen))),
    row("no-planes", SOLVER, "the planes are missing: scene['planes'] holds rectangles, which rays meet too",
        *(of(way) for way in plane(f"{MET} => t < -np.inf") for of in (chain, only_seen))),
    row("endless-planes", SOLVER, "your planes have no end: a rectangle ends at center ± half_u ± half_v",
        *inside("np.isfinite(t)", IN_U, IN_V)),
    row("abs-missing", SOLVER,
        "your rectangles end on one side only: a point may lie on either side of the centre, |q·u| <= u·u, "
        "|q·v| <= v·v",
        *inside(*(_between(*way) for way in (
            (("-np.inf", "1"),) * 2, (("-1", "np.inf"),) * 2, (("-np.inf", "1"), ("-1", "1")),
            (("-1", "np.inf"), ("-1", "1")), (("-1", "1"), ("-np.inf", "1")), (("-1", "1"), ("-1", "np.inf")))))),
    row("half-a-rectangle", SOLVER,
        "only a triangle of each rectangle is there: a rectangle is two of them, or |q·u| <= u·u and |q·v| <= v·v",
        *_also(f"{ALONG[0]} + {ALONG[1]} <= 0", f"{ALONG[0]} + {ALONG[1]} >= 0"),
        *inside(f"({ALONG[0]} >= 0) & ({ALONG[1]} >= 0) & ({ALONG[0]} + {ALONG[1]} <= 1)")),
    row("grazing-plane-lost", SOLVER,
        "planes that are seen at a grazing angle are lost: only n·d = 0 itself, or less than 1e-9, is a miss",
        *_also(*(f"{GRAZING} > {k}" for k in (0.5, 0.3, 0.1, 0.05)))),
    row("or-for-and", SOLVER,
        "a point counts as inside a rectangle where one of the two bounds holds: both have to, |q·u| <= u·u and "
        "|q·v| <= v·v",
        *inside(f"({IN_U}) | ({IN_V})")),
    row("extent-not-unit", SOLVER,
        "the extent of your rectangles is measured along half_u and half_v without dividing by their lengths: "
        "|q·u| <= u·u, or |q·u| / |u| <= |u|",
        *inside(reaching(NU, NV), reaching("1", "1"), reaching(f"{NU}**3", f"{NV}**3"),
                *(reaching(u, "half_v @ half_v") for u in ("1", NU)),
                *(reaching("half_u @ half_u", v) for v in ("1", NV)))),
    row("extent-from-elsewhere", SOLVER,
        "a rectangle's extent is measured from the wrong point: q = p - center, where p = origin + t direction",
        *plane("directions - center => directions", "q = origins + t => q = t",
               "q = origins + t[:, None] * directions - center => q = t[:, None] * directions")),
    row("box-for-rectangle", SOLVER,
        "a rectangle's extent is tested along the axes of the board, so that turned ones have another shape: test "
        "along its own edges, |q·u| <= u·u, |q·v| <= v·v",
        *inside(*(f"(np.abs(q[:, :{n}]) <= {size} + 1e-6).all(axis=-1)" for n, size in (
            (3, "np.abs(half_u) + np.abs(half_v)"), (2, "(np.abs(half_u) + np.abs(half_v))[:2]"),
            (2, f"np.array([{NU}, {NV}])"), (2, "np.abs([half_u[0], half_v[1]])"))))),
    row("corner", SOLVER,
        "your rectangles begin at their centre: a plane's center is its middle, and it reaches from -half_u to half_u",
        *inside(*(_between(*way) for k in ("1", "2") for way in (
            (("0", k),) * 2, (("0", k), ("-1", "1")), (("-1", "1"), ("0", k)))))),
    row("edges-swapped", SOLVER, "half_u and half_v are mixed up in a rectangle's test: |q·u| <= u·u, |q·v| <= v·v",
        *inside(reaching(f"{NU} * {NV}", f"{NU} * {NV}"), *(way for k in (1, 2) for way in (
            reaching("half_u @ half_u", f"{NV}**2 * ({NU} / {NV}) ** {k}"),
            reaching(f"{NU}**2 * ({NV} / {NU}) ** {k}", "half_v @ half_v"))))),
    row("disc-for-rectangle", SOLVER,
        "your planes have another shape: a rectangle ends at center ± half_u ± half_v, |a| <= 1 and |b| <= 1 each by "
        "itself",
        *inside(*(f"np.linalg.norm(q, axis=-1) <= {r}" for r in (
            f"max({NU}, {NV})", f"min({NU}, {NV})", f"np.hypot({NU}, {NV})", NU, NV)),
            f"np.hypot({ALONG[0]}, {ALONG[1]}) <= 1", f"np.abs({ALONG[0]}) + np.abs({ALONG[1]}) <= 1")),
    row("plane-through-origin", SOLVER, "your planes go through the origin: (p - center)·n = 0",
        *plane("center - origins => -origins ;; directions - center => directions", "center - origins => -origins")),
    row("plane-t", SOLVER,
        "the planes' t is wrong: t = (center - origin)·n / d·n, with these signs, and the same n above and below",
        *plane("center - origins => origins - center", f"{T} => {T} * np.linalg.norm(n)",
               f"{T} => {T} / np.linalg.norm(n)", f"{T} => (directions @ n) / ((center - origins) @ n)")),
    row("one-sided", SOLVER,
        "planes are met from one side only: they are rectangles that are seen, lit and cast shadows from both sides",
        *(of(way) for of in (chain, only_seen, in_shadow_test)
          for way in _also("directions @ n < 0", "directions @ n > 0"))),
    row("edges-not-turned", SOLVER,
        "the planes' centres are in one frame and their edges in another: half_u and half_v are turned by R, too",
        _edges(lambda x, c: c["R_cam_board"].T @ x, "half_u", "half_v"),
        _edges(lambda x, c: c["R_cam_board"] @ x, "half_u", "half_v"),
        _edges(lambda x, c: c["R_cam_board"].T @ c["R_cam_board"].T @ x, "half_u", "half_v"),
        *(_edges(lambda x, c: c["R_cam_board"].T @ x, name) for name in ("half_u", "half_v"))),
    row("edges-moved", SOLVER,
        "t is added to the planes' edges: half_u and half_v are directions, which are turned only",
        _edges(lambda x, c: x + c["R_cam_board"].T @ c["t_cam_board"], "half_u", "half_v")),
    row("half-edges", SOLVER,
        "your rectangles have the wrong size: half_u and half_v are half-edges, from the centre to the rim",
        *inside(*(reaching(f"{k} * (half_u @ half_u)", f"{k} * (half_v @ half_v)") for k in (0.5, 2.0)))),
    row("cross-product", SOLVER,
        "your planes are tilted, half_u × half_v goes wrong: it is (u_y v_z - u_z v_y, u_z v_x - u_x v_z, "
        "u_x v_y - u_y v_x), divided by its length in all three components",
        *_crossed(*(f"n[{k}] = {wrong.format(i=(k + 1) % 3, j=(k + 2) % 3, k=k)}" for wrong in (
            "-n[{k}]", "half_u[{i}] * half_v[{j}] + half_u[{j}] * half_v[{i}]",
            "half_u[{i}] * half_v[{j}] - half_u[{j}] * half_v[{k}]",
            "half_u[{i}] * half_v[{j}] - half_u[{j}] * half_v[{j}]") for k in (1, 2, 0))),
        *(chain(*plane(f"{CROSS} => {CROSS}\n    n[{k}] = n[{k}] * np.linalg.norm(n)"), *normals_at(
            f"np.tile(n / np.linalg.norm(n) => np.tile(np.where(np.arange(3) == {k}, n, n / np.linalg.norm(n))"))
          for k in range(3))),
    row("planes-behind", SOLVER, "planes behind the ray's start count too: keep t > 0 alone",
        chain(*PLANES_BEHIND), *plane(f"{MET} => inside", f"{T} => np.abs({T})"),
        chain(*PLANES_BEHIND, *shadow('(own | => ((own & ("radius" in thing)) |'))),
)  # fmt: skip
