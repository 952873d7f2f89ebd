"""Faults of single functions, as slips in the textbook's text: what a function that is graded alone is compared with.

A row is a fault's name, then its ways: each one or more replacements (old, new) in `textbook.TEXT`. The sentence is the
catalogue's, so that a student reads one wording of one mistake whether a function or a picture shows it; faults that no
picture shows have theirs here.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from raytwin.diagnose.textbook import Changes, tracer_with

Ways = dict[str, tuple[Changes, ...]]
"""Fault -> how it is made."""

GRID, COUNT = "np.arange(width), np.arange(height)", "return u, v"
DIST, UNDO = "    k1, k2, p1, p2, k3 = dist\n", "undistort((u - cx) / fx, (v - cy) / fy, dist)"
STEP, STEPS = "x, y = (xd - dx) / radial, (yd - dy) / radial", "range(60)"
AGAIN, TAKEN_OFF = (
    "x, y = (x - dx) / radial, (y - dy) / radial",
    "x, y = x - (x * radial + dx - xd), y - (y * radial + dy - yd)",
)
TAKEN_OFF_AGAIN = "x, y = x - (x * radial + dx - x), y - (y * radial + dy - y)"
FORWARD = "return x * radial + dx, y * radial + dy"
R2, SQUARED, CUBED = "r2 = x * x + y * y", "r2**2", "r2**3"
XY1, XX = "2 * p1 * x * y", "p2 * (r2 + 2 * x * x)"
YY, XY2 = "p1 * (r2 + 2 * y * y)", "2 * p2 * x * y"
TIMES_RADIAL: Changes = ((STEP, "x, y = (xd - dx) * radial, (yd - dy) * radial"),)
ONE_CROSS: Changes = ((XY1, "p1 * x * y"),)
ONE_SQUARE: Changes = ((XX, "p2 * (r2 + x * x)"),)
LENS = "    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]\n"
RAY, UNIT = "np.stack([x, y, np.ones_like(x)], axis=-1)", "return rays / np.linalg.norm(rays, axis=-1, keepdims=True)"


def _dist(line: str) -> Changes:
    """The coefficients, changed after they are read."""
    return ((DIST, f"{DIST}    {line}\n"),)


def _other(term: str) -> tuple[str, str]:
    """The term with the other coefficient."""
    return term, term.replace("p1", "p").replace("p2", "p1").replace("p ", "p2 ")


def _lens(line: str) -> Changes:
    return ((LENS, f"{LENS}    {line}\n"),)


BACK_PROJECT: Ways = {
    "half-pixel": (((COUNT, "return u + 0.5, v + 0.5"),), ((COUNT, "return u - 0.5, v - 0.5"),)),
    "count-from-one": (((COUNT, "return u + 1, v + 1"),), ((COUNT, "return u - 1, v - 1"),)),
    "linspace": (
        ((GRID, "np.linspace(0, width, width), np.linspace(0, height, height)"),),
        ((GRID, "np.linspace(-0.5, width - 0.5, width), np.linspace(-0.5, height - 0.5, height)"),),
    ),
    "distortion-kept": (((UNDO, "((u - cx) / fx, (v - cy) / fy)"),),),
    "distortion-forward": (((STEP, FORWARD),),),
    "distortion-sign": (
        _dist("k1, k2, p1, p2, k3 = -k1, -k2, -p1, -p2, -k3"),
        (*_dist("k1, k2, p1, p2, k3 = -k1, -k2, -p1, -p2, -k3"), (STEP, FORWARD)),
        TIMES_RADIAL,
    ),
    "distortion-few-steps": (
        *(((STEPS, f"range({n})"),) for n in (1, 2, 3, 4, 5, 6, 8)),
        *(((STEPS, f"range({n})"), (STEP, TAKEN_OFF)) for n in (2, 3, 4, 5, 6, 8)),
    ),
    "distortion-cumulative": (
        *(((STEPS, f"range({n})"), (STEP, AGAIN)) for n in (2, 3, 4, 5, 6, 8, 10, 20, 30, 50)),
        *(((STEPS, f"range({n})"), (STEP, AGAIN), *_dist("p1 = p2 = 0")) for n in (5, 10)),
        *(((STEPS, f"range({n})"), (STEP, TAKEN_OFF_AGAIN)) for n in (2, 3, 4, 5, 10)),
    ),
    "k3-left-out": (_dist("k3 = 0"),),
    "k2-left-out": (_dist("k2 = 0"), _dist("k2 = k3 = 0"), _dist("k2 = p1 = p2 = k3 = 0")),
    "tangential-left-out": (
        _dist("p1 = p2 = 0"),
        _dist("p1 = p2 = k3 = 0"),
        *(((one, "0 * x"),) for one in (XY1, XX, YY, XY2)),
        *(((one, "0 * x"), (other, "0 * y")) for one, other in ((XY1, XX), (YY, XY2))),
    ),
    "tangential-swapped": (
        _dist("p1, p2 = p2, p1"),
        *((_other(one),) for one in (XY1, XX, YY, XY2)),
        *((_other(one), _other(other)) for one, other in ((XY1, XX), (YY, XY2))),
    ),
    "coefficients-order": (_dist("p1, p2, k3 = p2, k3, p1"),),
    "tangential-factor": (
        (*ONE_CROSS, (XY2, "p2 * x * y")),
        (*ONE_SQUARE, (YY, "p1 * (r2 + y * y)")),
        (*ONE_CROSS, (XY2, "p2 * x * y"), *ONE_SQUARE, (YY, "p1 * (r2 + y * y)")),
        ((XX, "p2 * r2"), (YY, "p1 * r2")),
        ONE_CROSS,
        ((XY2, "p2 * x * y"),),
        ONE_SQUARE,
        ((YY, "p1 * (r2 + y * y)"),),
    ),
    "tangential-after": (((STEP, "x, y = xd / radial - dx, yd / radial - dy"),),),
    "tangential-of-bent": (
        (
            (XY1, "2 * p1 * x * y * radial**2"),
            (XY2, "2 * p2 * x * y * radial**2"),
            (XX, "p2 * (r2 + 2 * (x * radial) ** 2)"),
            (YY, "p1 * (r2 + 2 * (y * radial) ** 2)"),
        ),
    ),
    "powers-of-r": (
        ((SQUARED, "r2"), (CUBED, "r2")),
        ((CUBED, "r2**2"),),
        ((CUBED, "r2**4"),),
        (("k1 * r2 + k2 * r2**2 + k3 * r2**3", "k1 * r2**2 + k2 * r2**4 + k3 * r2**6"),),
        ((SQUARED, "r2"),),
        ((CUBED, "r2"),),
    ),
    "radius-for-its-square": (
        ((R2, "r2 = np.sqrt(x * x + y * y)"), *_dist("p1 = p2 = 0")),
        ((R2, "r2 = np.sqrt(x * x + y * y)"),),
        (("k1 * r2 + k2 * r2**2 + k3 * r2**3", "k1 * r2**0.5 + k2 * r2 + k3 * r2**1.5"),),
    ),
    "swapped-focal": (_lens("fx, fy = fy, fx"),),
    "one-focal": (_lens("fy = fx"), _lens("fx = fy")),
    "swapped-centre": (_lens("cx, cy = cy, cx"), _lens("cy = cx"), _lens("cx = cy")),
    "centre-of-image": (
        _lens("cx, cy = np.max(u) / 2, np.max(v) / 2"),
        _lens("cx, cy = (np.max(u) + 1) / 2, (np.max(v) + 1) / 2"),
    ),
    "centre-left-out": (_lens("cx, cy = 0, 0"),),
    "x-for-y": (((RAY, "np.stack([y, x, np.ones_like(x)], axis=-1)"),),),
    "y-up": (((RAY, "np.stack([x, -y, np.ones_like(x)], axis=-1)"),),),
    "x-left": (((RAY, "np.stack([-x, y, np.ones_like(x)], axis=-1)"),),),
    "z-backwards": (
        ((RAY, "np.stack([x, -y, -np.ones_like(x)], axis=-1)"),),
        ((RAY, "-np.stack([x, y, np.ones_like(x)], axis=-1)"),),
        ((RAY, "np.stack([x, y, -np.ones_like(x)], axis=-1)"),),
    ),
    "upside-down": (((COUNT, "return u, height - 1 - v"),),),
    "mirrored": (((COUNT, "return width - 1 - u, v"),),),
    "rays-long": (((UNIT, "return rays"),),),
    "rays-by-norm-of-many": (
        ((UNIT, "return rays / np.linalg.norm(rays)"),),
        *(((UNIT, f"return rays / np.linalg.norm(rays, axis={axis}, keepdims=True)"),) for axis in (0, 1, (0, 1))),
    ),
}

CENTER, SQUARE = "f = origins - center", "np.sum(f * f, axis=-1) - radius**2"
A, B, DISC, OVER = "a = np.sum(directions * directions, axis=-1)", "b = 2 * np.sum", "b * b - 4 * a * c", "/ (2 * a)"
CHOICE, HIT = "t = np.where(near > 0, near, far)", "return np.where((disc >= 0) & (t > 0), t, np.inf)"
ANY = "return np.where(disc >= 0, t, np.inf)"
HALF: Changes = ((B, "b = np.sum"), (DISC, "b * b - a * c"), (OVER, "/ a"))
"""A right form: b without its 2."""
BY_Q = """q = -(b + np.sign(b) * np.sqrt(disc)) / 2
    near, far = np.minimum(q / a, c / q), np.maximum(q / a, c / q)
    near, far = np.where(q == 0, np.nan, near), np.where(q == 0, np.nan, far)
    t = np.where(near > 0, near, far)"""

INTERSECT_SPHERE: Ways = {
    "far-root": (((CHOICE, "t = far"),), ((CHOICE, "t = far"), (HIT, ANY))),
    "behind-the-eye": (
        ((CHOICE, "t = np.where(np.abs(near) < np.abs(far), near, far)"), (HIT, ANY)),
        ((CHOICE, "t = np.where(np.abs(near) < np.abs(far), near, far)"),),
        ((CHOICE, "t = near"), (HIT, ANY)),
        ((HIT, ANY),),
        ((CHOICE, "t = np.abs(near)"),),
        (("far = (-b + np.sqrt(disc))", "far = (b + np.sqrt(disc))"),),
    ),
    "inside-missed": (((CHOICE, "t = near"),),),
    "misses-not-infinite": tuple(((HIT, HIT.replace("np.inf", miss)),) for miss in ("np.nan", "0.0", "-1.0")),
    "disc-not-tested": (((DISC, f"np.maximum({DISC}, 0)"),), (("disc = ", "disc = np.abs("), (DISC, DISC + ")"))),
    "rays-not-unit": (((A, "a = 1.0"),), (("4 * a * c", "4 * c"),)),
    "t-of-unit-rays": (
        ((CENTER, CENTER + "\n    directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)"),),
    ),
    "radius-squared-twice": ((("radius**2", "radius**4"),),),
    "radius-not-squared": ((("radius**2", "radius"),),),
    "half-radius": ((("radius**2", "(radius / 2) ** 2"),),),
    "diameter": ((("radius**2", "(2 * radius) ** 2"),),),
    "center-left-out": (((CENTER, "f = origins"),),),
    "origin-left-out": (((CENTER, "f = 0 * origins - center"),),),
    "b-sign": (((CENTER, "f = center - origins"),), ((CENTER, "f = origins + center"),)),
    "factor-in-quadratic": (
        ((B, "b = np.sum"),),
        ((DISC, "b * b - a * c"),),
        ((OVER, "/ a"),),
        ((DISC, "b * b - a * c"), (OVER, "/ a")),
        ((B, "b = np.sum"), (DISC, "b * b - a * c")),
        ((B, "b = np.sum"), (OVER, "/ a")),
    ),
    "divided-by-half-a": (((OVER, "/ 2 * a"),), (*HALF[:2], (OVER, "* a"))),
    "root-missing": ((("np.sqrt(disc)", "disc"),),),
    "length-not-squared": (((SQUARE, "np.linalg.norm(f, axis=-1) - radius**2"),),),
    "disc-above": ((("disc >= 0", "disc < 0"),), (("np.sqrt(disc)", "np.sqrt(-disc)"), ("disc >= 0", "disc <= 0"))),
    "sum-of-all": (((A, "a = np.sum(directions * directions)"),), ((SQUARE, "np.sum(f * f) - radius**2"),)),
    "sign-of-zero": (((CHOICE, BY_Q),),),
}

COSINE = "np.sum(normals * to_light, axis=-1, keepdims=True)"
CLAMPED, SUM = f"np.maximum(0, {COSINE})", "albedo / np.pi * irradiance * cosine + albedo * sky"
SUN = "albedo / np.pi * irradiance * cosine"


def _sum(*sums: str) -> tuple[Changes, ...]:
    return tuple(((SUM, one),) for one in sums)


def _cosine(*cosines: str) -> tuple[Changes, ...]:
    return tuple(((CLAMPED, one),) for one in cosines)


SHADE: Ways = {
    "no-clamp": _cosine(COSINE),
    "abs-cosine": _cosine(f"np.abs({COSINE})"),
    "half-lambert": _cosine(f"({COSINE} + 1) / 2"),
    "squared-cosine": _cosine(f"{CLAMPED} ** 2"),
    "sky-before-clamp": (((CLAMPED, COSINE), (SUM, f"np.maximum(0, {SUM})")),),
    "no-cosine": _cosine(f"({COSINE} > 0)"),
    "angle-for-cosine": _cosine(f"np.arccos(np.clip({COSINE}, 0, 1))", f"np.maximum(0, np.arccos({COSINE}))"),
    "light-reversed-in-shading": _cosine(f"np.maximum(0, -{COSINE})", f"np.minimum(0, {COSINE})"),
    "light-as-place": _cosine(
        "np.maximum(0, np.sum(normals * (to_light - points) / np.linalg.norm(to_light - points, axis=-1, "
        "keepdims=True), axis=-1, keepdims=True))"
    ),
    "albedo-missing-sun": _sum(SUM.replace("albedo / np.pi", "1 / np.pi")),
    "sky-without-albedo": _sum(f"{SUN} + sky"),
    "albedo-missing": _sum("irradiance / np.pi * cosine + sky"),
    "albedo-squared": _sum("albedo**2 / np.pi * irradiance * cosine + albedo**2 * sky"),
    "pi-missing": _sum(SUM.replace(" / np.pi", "")),
    "pi-multiplied": _sum(SUM.replace("/ np.pi", "* np.pi")),
    "pi-twice": _sum(SUM.replace("/ np.pi", "/ np.pi**2")),
    "sun-half": _sum(SUM.replace("np.pi", "(2 * np.pi)")),
    "sun-twice": _sum(SUM.replace("albedo / np.pi", "2 * albedo / np.pi")),
    "sky-by-pi": _sum(f"{SUN} + albedo / np.pi * sky"),
    "sky-times-pi": _sum(f"{SUN} + albedo * np.pi * sky"),
    "pi-missing-everywhere": _sum(f"np.pi * ({SUM})"),
    "image-by-pi": _sum(f"({SUM}) / np.pi"),
    "sky-missing": _sum(SUN),
    "sun-missing": _sum("albedo * sky + 0 * cosine"),
    "sky-twice": _sum(f"{SUN} + 2 * albedo * sky"),
    "sky-half": _sum(f"{SUN} + albedo * sky / 2"),
    "sky-only-in-shadow": _sum(f"np.where(cosine > 0, {SUN}, albedo * sky)"),
    "sky-times-sun": _sum("cosine * (albedo / np.pi * irradiance + albedo * sky)", f"(cosine > 0) * ({SUM})"),
    "sky-on-all": _sum(f"{SUN} + albedo * sky + sky"),
    "irradiance-missing": _sum("albedo / np.pi * cosine * (np.max(irradiance) > 0) + albedo * sky"),
    "irradiance-squared": _sum(SUM.replace("irradiance", "irradiance**2")),
    "light-colour": _sum(SUM.replace("irradiance", "np.mean(irradiance)")),
    "sky-without-colour": _sum(SUM.replace("sky", "np.mean(sky)")),
    "clamped": _sum(f"np.clip({SUM}, 0, 1)"),
    "gamma-once": _sum(f"({SUM}) ** (1 / 2.2)"),
    "bgr": _sum(f"({SUM})[:, ::-1]"),
}

OWN_WORDS = {
    "rays-long": "the rays are not unit: divide (x, y, 1) by its length",
    "inside-missed": "rays that start inside the sphere miss it: where the near root is negative, the far one may be "
    "positive",
    "misses-not-infinite": "a miss has to be np.inf: where the discriminant is negative, and where t is not positive",
    "t-of-unit-rays": "t is that of unit directions: the directions are made unit inside, and t is not divided by "
    "their length afterwards",
    "sum-of-all": "one sum is over all rays and components: sum over the last axis alone (axis=-1)",
}
"""Faults that a picture does not show, or not alone."""


FAULTS_OF: dict[str, Ways] = {"back_project": BACK_PROJECT, "intersect_sphere": INTERSECT_SPHERE, "shade": SHADE}
"""function -> its faults, in the order in which they are named where several give the same."""


@lru_cache(maxsize=512)
def wrong(function: str, changes: Changes) -> Callable[..., Any]:
    """The textbook's function with these slips in it."""
    made: Callable[..., Any] = getattr(tracer_with(changes=changes), function)
    return made
