"""Mistakes in normals, in how light is reflected, and in shadows."""

import numpy as np

from raytwin.diagnose.changes import (
    ASKED,
    BALLS,
    CLAMPED,
    COS,
    CROSS_AT,
    ON_PLANE,
    SUM,
    SUN,
    Ways,
    before_shading,
    behind,
    chain,
    given,
    half_lit,
    lit,
    mixed,
    normals_at,
    offset_by,
    others_hide,
    shade,
    shading_normals,
    shadow,
    towards,
    unit,
    where_cast,
    within,
)
from raytwin.diagnose.predict import Pipeline, slip
from raytwin.files import srgb_decode, srgb_encode

CASTS = '(scene["rung"] == "shadow")'
FACING = (
    'np.array([np.cross(x["half_u"], x["half_v"]) / np.linalg.norm(np.cross(x["half_u"], x["half_v"])) '
    'if "half_u" in x else np.zeros(3) for x in things])'
)
"""(K, 3): half_u × half_v of planes, made unit; 0 of spheres."""
BACKS_SHADED = mixed(
    f"back = np.sum({FACING}[which] * (eye - points), axis=-1) < 0", f"visible = visible & ~({CASTS} & back)"
)
"""Planes that are seen from behind meet themselves on the way to the sun."""
LIT_BEHIND = shading_normals(f"np.where({ON_PLANE} & ({COS} < 0), -normals, normals)")
INSIDE_DARK = mixed(f"visible = visible & ~({CASTS} & (np.sum(normals * right, axis=-1) < 0))")
"""Where normals for shading point inwards, shadow rays start inside."""


def of_other_center(k: int, made_unit: bool) -> Pipeline:
    """Take the normal of the first or last sphere."""
    n = '(points - one["center"]) / one["radius"]'
    one = f"one = ([x for x in things if 'radius' in x] or [dict(center=eye, radius=1.0)])[{k}]"
    return shading_normals(f"np.where({ON_PLANE}, normals, {unit(n) if made_unit else n})", one)


FACED = "n = np.where(towards, n, -n)"
FREE = f'{FACED} => n = n if "radius" in thing else np.where(towards, n, -n)'
BALL, UP = '(points - thing["center"]) / thing["radius"]', "np.tile([0.0, 0.0, 1.0], (len(points), 1))"
PAINT = 'np.tile(thing["albedo"], (len(points), 1))'


def _ball(*texts: str) -> tuple[Pipeline, ...]:
    """Other normals of spheres."""
    return normals_at(*(f"{FREE} ;; {BALL} => {text}" for text in texts))


def flat_normals(*texts: str) -> tuple[Pipeline, ...]:
    """Other normals of planes, once they are half_u × half_v made unit."""
    return normals_at(*(f'{FACED} => n = n if "radius" in thing else {text}' for text in texts))


NORMALS_: Ways = {
    "normal-inward": _ball('(thing["center"] - points) / thing["radius"]'),
    "all-normals-inward": normals_at("np.where(towards, n, -n) => np.where(towards, -n, n)"),
    "plane-normal-turned": flat_normals("np.where(towards, -n, n)"),
    "plane-normal-fixed": (
        *flat_normals("n", "-n"), chain(*flat_normals("n"), others_hide, BACKS_SHADED), BACKS_SHADED),
    "plane-faces-light": (chain(others_hide, LIT_BEHIND), LIT_BEHIND,
        *flat_normals("np.where(n[:, 2:] < 0, -n, n)")),
    "plane-normal-up": (*flat_normals(UP), *normals_at(f"{CROSS_AT} => n = np.array([0.0, 0.0, 1.0])")),
    "normal-not-unit": _ball('points - thing["center"]', '(points - thing["center"]) * thing["radius"]'),
    "normal-by-radius-twice": _ball(f'{BALL} / thing["radius"]'),
    "made-unit-by-square":
        normals_at(f'{FREE} ;; {BALL} => {BALL} / thing["radius"] ;; n / np.linalg.norm(n) => n / (n @ n)',
        "n / np.linalg.norm(n) => n / (n @ n)"),
    "normal-from-origin":
        _ball(*(f"({p}) / np.linalg.norm({p}, axis=-1, keepdims=True)" for p in ("points", "points - eye"))),
    "normal-of-another": tuple(chain(others_hide, of_other_center(k, unit_), *([INSIDE_DARK] if dark else []))
        for k in (-1, 0) for unit_, dark in ((True, False), (False, False), (False, True))),
    "plane-normal-not-unit": normals_at("np.tile(n / np.linalg.norm(n) => np.tile(n"),
    "one-array": (*normals_at(f"{FACED} => n = {PAINT}", f"towards = np => n = {PAINT}\n        towards = np",
        f"{FACED} => n = points"),
        before_shading("albedo = normals")),
    "normal-axis": _ball(*(f"{BALL} * {signs}" for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1]))),
}  # fmt: skip

# ------------------------------------------------------------------------------------------ light

AWAY = "np.linalg.norm(points - eye, axis=-1, keepdims=True)"
AT_PLACE, TO_PLACE = half_lit(unit("to_light - points")), towards("to_light - points")
FALLOFF = before_shading(
    "irradiance = irradiance / np.maximum(np.sum((to_light - points) ** 2, axis=-1, keepdims=True), 1e-12)"
)
"""1 / (distance to to_light, taken for a place)²."""


def turned(matrix: str) -> tuple[Pipeline, ...]:
    """The light's direction turned by a function of R: everywhere, or for shading alone."""
    return lit(f"{matrix} @ to_light"), half_lit(f"{matrix} @ to_light")


def painted(*tables: str) -> tuple[Pipeline, ...]:
    """Other albedos: tables made of the lists of those of `balls` and `flats`, to whose sum they belong in order."""
    return tuple(
        before_shading(
            'balls, flats = ([x["albedo"] for x in things if ("radius" in x) == ball] for ball in (True, False))',
            f'place = np.argsort(np.argsort(~{BALLS}[:, 0], kind="stable"))',
            f"albedo = np.array({table})[place[which]]",
        )
        for table in tables
    )


SUMMED, SUMMED_SKY = (f"np.repeat(albedo @ {light}[:, None], 3, axis=-1)" for light in ("irradiance", "sky"))

LIGHTS: Ways = {
    "light-reversed": (lit("-to_light"),),
    "light-reversed-in-shading": tuple(chain(half_lit("-to_light"), test) for test in (others_hide, offset_by(1e-6))),
    "light-in-camera-frame": turned("R.T"),
    "light-turned-needlessly": turned("R"),
    "light-moved":
        tuple(lit(one) for d in ("to_light + R.T @ t", "to_light - R.T @ t", "to_light + t") for one in (unit(d), d)),
    "light-axes": (*(lit(f"to_light[{order}] * {signs}") for order, signs in (
        ([0, 2, 1], 1), ([1, 0, 2], 1), ([2, 1, 0], 1), ([0, 2, 1], [1, 1, -1]), ([0, 1, 2], [1, -1, 1]),
        ([0, 1, 2], [-1, 1, 1]), ([0, 1, 2], [1, 1, -1]), ([0, 1, 2], [-1, -1, 1]), ([0, 2, 1], [1, -1, 1]))),
        *(half_lit(f"to_light * {signs}") for signs in ([1, 1, -1], [1, -1, 1], [-1, 1, 1])),
        *(half_lit(f"to_light[{order}]") for order in ([0, 2, 1], [1, 0, 2], [2, 1, 0]))),
    "light-as-place": (chain(AT_PLACE, TO_PLACE), chain(FALLOFF, AT_PLACE, TO_PLACE), AT_PLACE,
        chain(half_lit(unit("to_light + eye - points")), towards("to_light + eye - points")),
        half_lit(unit("points - to_light")), chain(half_lit(unit("points - to_light")), offset_by(1e-6)),
        chain(FALLOFF, AT_PLACE)),
    "light-at-eye": (half_lit(unit("eye - points")), half_lit(unit("points - eye"))),
    "dot-product":
        shade(*(f"{COS} => ({COS} - normals[:, {k}:{k + 1}] * to_light[{k}] + {term.format(k=k)})" for term in (
        "normals[:, {k}:{k}+1] ** 2", "to_light[{k}] ** 2", "0") for k in (2, 0, 1)),
        *(f"{COS} => 3 * normals[:, {k}:{k + 1}] * to_light[{k}]" for k in (2, 0, 1))),
    "no-clamp": shade(f"{CLAMPED} => {COS}"),
    "abs-cosine": tuple(chain(*test, *shade(f"{CLAMPED} => np.abs({COS})")) for test in ((), (others_hide,))),
    "squared-cosine": shade(f"{CLAMPED} => {CLAMPED} ** 2", f"{CLAMPED} => {COS} ** 2"),
    "angle-for-cosine": shade(*(f"{CLAMPED} => {f.format(c=f'np.clip({COS}, 0, 1)')}" for f in (
        "np.cos({c})", "np.arccos({c})", "np.sqrt(1 - {c} ** 2)", "np.cos(np.degrees(np.arccos({c})))")),
        f"{CLAMPED} => np.maximum(0, np.arccos({COS}))"),
    "distance-falloff": (*(before_shading(f"irradiance = irradiance / {AWAY}{power}") for power in (" ** 2", "")),
        before_shading(f"irradiance, sky = irradiance / {AWAY} ** 2, sky / {AWAY} ** 2")),
    "no-cosine": shade(f"{CLAMPED} => ({COS} > 0)", f"{CLAMPED} => np.ones_like({COS})"),
    "half-lambert": shade(f"{CLAMPED} => (1 + {COS}) / 2", f"{CLAMPED} => ((1 + {COS}) / 2) ** 2"),
    "albedo-missing-sun": shade("albedo / np.pi => 1 / np.pi"),
    "albedo-missing": shade(f"{SUM} => irradiance / np.pi * cosine + sky + 0 * albedo"),
    "albedo-squared": shade("albedo / np.pi => albedo**2 / np.pi ;; albedo * sky => albedo**2 * sky",
        "albedo / np.pi => albedo**2 / np.pi", "albedo * sky => albedo**2 * sky"),
    "albedo-decoded":
        tuple(given(albedo=f) for f in (srgb_decode, lambda a: a**2.2, srgb_encode, lambda a: a ** (1 / 2.2), np.sqrt)),
    "albedo-of-another": painted("balls[:1] * len(balls) + flats", "balls[:1] * len(things)",
        "(balls + flats)[-1:] * len(things)", "balls[1:] + balls[:1] + flats", "balls[-1:] + balls[:-1] + flats",
        "balls + balls[-1:] * len(flats)", "balls + balls[:1] * len(flats)", "balls[-1:] * len(balls) + flats",
        "balls + flats[-1:] * len(flats)", "balls + flats[:1] * len(flats)"),
    "albedo-order": painted("flats + balls", "(balls + flats)[::-1]", "balls + (balls * len(flats))[: len(flats)]",
        "(balls + flats)[1:] + (balls + flats)[:1]", "(balls + flats)[-1:] + (balls + flats)[:-1]"),
    "channels-summed": shade(f"{SUN} => {SUMMED} / np.pi * cosine", f"albedo * sky => {SUMMED_SKY}",
        f"{SUN} => {SUMMED} / np.pi * cosine ;; albedo * sky => {SUMMED_SKY}"),
    "light-colour": shade(*(f"* irradiance => * {one}" for one in (
        "np.mean(irradiance)", "irradiance[0]", "np.max(irradiance)", "np.linalg.norm(irradiance)",
        "np.sum(irradiance)", "irradiance[::-1]")), "albedo * sky => albedo * np.mean(sky)",
        "albedo * sky => albedo * sky[0]"),
    "irradiance-missing": shade(*(f"* irradiance => {new}" for new in (
        "* (irradiance > 0)", "* np.pi * (irradiance > 0)", "* irradiance / max(np.max(irradiance), 1e-300)",
        "* irradiance / max(np.linalg.norm(irradiance), 1e-300)"))),
    "pi-multiplied": shade("/ np.pi => * np.pi"),
    "pi-missing": shade(" / np.pi => "),
    "pi-twice": shade("/ np.pi => / np.pi**2"),
    "sun-twice": shade("albedo / np.pi => 2 * albedo / np.pi"),
    "sun-half": shade("np.pi => (2 * np.pi)"),
    "sun-missing": shade(f"{SUM} => albedo * sky + 0 * cosine"),
    "sky-twice": shade("albedo * sky => 2 * albedo * sky"),
    "sky-missing": shade(f"{SUM} => {SUN}"),
    "sky-by-pi": shade("albedo * sky => albedo * sky / np.pi"),
    "sky-times-pi": shade("albedo * sky => albedo * sky * np.pi"),
    "sky-without-albedo": shade("albedo * sky => sky + 0 * albedo"),
    "sky-constant": shade(*(f"albedo * sky => {k} * albedo" for k in (0.1, 0.2, 0.05, 0.3, 0.5))),
    "sky-without-colour": shade("albedo * sky => albedo"),
    "sky-on-all": tuple(chain(way, *more) for more in ((), behind("2 * sky"))
        for way in shade("albedo * sky => albedo * sky + sky")),
    "sky-times-sun": (before_shading("sky = sky * irradiance"), before_shading("sky = sky * irradiance / np.pi")),
    "sky-times-cosine": shade(f"{SUM} => cosine * (albedo / np.pi * irradiance + albedo * sky)",
        f"{SUM} => (cosine > 0) * ({SUM})"),
    "sky-before-clamp": shade(f"{CLAMPED} => {COS} ;; {SUM} => np.maximum(0, {SUM})",
        f"{CLAMPED} => np.maximum(0, {COS} + sky) ;;  + albedo * sky => "),
    "sky-only-in-shadow": (mixed(f"lit = lit - dark * ({COS} > 0)"), mixed("lit = lit - dark"),
        mixed(f"lit, dark = lit - dark * ({COS} > 0), dark * ({COS} <= 0)"), where_cast(mixed("lit = lit - dark")),
        mixed("lit = np.maximum(lit - dark, dark)"),
        *shade(f"{SUM} => np.where(cosine > 0, {SUN}, albedo * sky)")),
    "shadow-black": (*(way(mixed("dark = 0 * dark")) for way in (chain, where_cast)),
        mixed(f"lit, dark = lit - dark * ({COS} <= 0), 0 * dark"),
        mixed(f"lit, dark = lit - dark * ({COS} <= 0), dark * ({COS} > 0)")),
    "sky-by-height": (*(before_shading(f"sky = sky * {weight}") for weight in (
        "(1 + normals[:, 2:]) / 2", "np.maximum(normals[:, 2:], 0)", f"np.maximum({COS}, 0)")),
        mixed(f"lit, dark = lit - dark + dark * np.maximum({COS}, 0), 0 * dark")),
}  # fmt: skip

# ---------------------------------------------------------------------------------------- shadows

BLOCKS, TO_SUN = (
    "visible = visible & (own | ~np.isfinite(t[k]))",
    ("t = intersect_all(points, np.tile(to_light, (len(points), 1)), things)"),
)
ON_BALL = 'np.array(["radius" in x for x in things])[which]'
NUMBERS = '[["radius" in y for y in things[:i]].count("radius" in x) for i, x in enumerate(things)]'
"""The number that each thing has among those of its kind."""


def _free(*tests: str) -> tuple[Pipeline, ...]:
    """What lets the light through: functions of k, thing, which and things."""
    return shadow(*(f"(own | => (own | ({test}) |" for test in tests))


def _aside(direction: str) -> Pipeline:
    """Another direction to the light, for shadows alone."""
    return chain(others_hide, slip("radiance", (ASKED, ASKED.replace('sun["to_light"]', direction))))


SHADOWS: Ways = {
    "no-shadow": shadow("return visible => return visible | True"),
    "shadows-always": (slip("radiance", ('scene["rung"] == "shadow"', "True")),),
    "all-in-shadow": shadow(*(f"return visible => return visible & {on}" for on in ("False", f"~{ON_BALL}", ON_BALL))),
    "shadow-offset": tuple(offset_by(eps, way) for way in (False, True) for eps in (3e-3, 1e-2, 2e-2, 5e-2)),
    "shadow-both-ways": shadow(*(f"{TO_SUN} => {TO_SUN}\n    back = {TO_SUN[4:].replace('to_light', '-to_light')}\n"
        f"    t = np.minimum(t, np.where({kind}, back, np.inf)){own}" for kind, own in (
        ("True", ""), (BALLS, ""), (f"~{BALLS}", ""), (BALLS, ' ;; (own | => ((own & ("radius" not in thing)) |')))),
    "shadow-reversed": shadow("np.tile(to_light => np.tile(-to_light"),
    "shadow-light-turned": (*(_aside(f'scene["R_cam_board"]{t} @ sun["to_light"]') for t in ("", ".T")),
        *shadow(*(f"np.tile(to_light => np.tile(to_light * {signs}" for signs in ([1, 1, -1], [-1, -1, 1])))),
    "shadow-to-eye": tuple(map(towards, ("eye - points", "points - eye", "normals"))),
    "shadow-to-place": tuple(map(towards, ("to_light - points", "to_light + eye - points"))),
    "shadow-bounded": tuple(within(limit) for limit in (0.2, 0.1, 0.25, 0.3, 0.5, 1.0)),
    "spheres-receive-none": _free(ON_BALL),
    "planes-receive-none": _free(f"~{ON_BALL}"),
    "shadow-own-kind": _free(f'("radius" in thing) & {ON_BALL}', f'("radius" not in thing) & ~{ON_BALL}',
        f'("radius" in thing) == {ON_BALL}'),
    "own-number": shadow(f"own = which == k => own = np.array({NUMBERS})[which] == {NUMBERS}[k]"),
    "planes-cast-none": _free('"radius" not in thing'),
    "spheres-cast-none": _free('"radius" in thing'),
    "one-casts": (*_free("k != 0", f"k != {BALLS}.sum() - 1", "k != len(things) - 1", *(
        f'("radius" in thing) == {ball} and {NUMBERS}[k] != {end}' for ball, ends in (
        (True, ("0", f"{BALLS}.sum() - 1")), (False, ("0", f"(~{BALLS}).sum() - 1"))) for end in ends)),
        *shadow(*(f"{BLOCKS} => visible = np.where(own, visible, ~np.isfinite(t[k])){more}" for more in (
        "", " ;; enumerate(things) => reversed([*enumerate(things)])")))),
    "half-of-pairs": _free("k < which", "k > which"),
    "whole-object-in-shadow": shadow("return visible => return np.array([visible[which == w].all() for w in which])"),
    "one-casts-not": _free("k == 0", f"k == {BALLS}.sum() - 1"),
    "shadow-from-elsewhere": (
        *shadow('intersect_all(points => intersect_all(np.array([x["center"] for x in things])[which]'),
        *shadow(*(f"intersect_all(points => intersect_all({start}{own}" for own in ("", " ;; (own |  => (")
        for start in ("0 * points", "eye + 0 * points", "points - eye")))),
    "shadow-inverted": shadow("return visible => return ~visible"),
    "shadow-colour": tuple(way(mixed(f"dark = {dark}")) for way in (chain, where_cast) for dark in (
        "dark / np.maximum(albedo, 1e-9)", "dark / np.maximum(sky, 1e-9)",
        *(f"{k} + 0 * dark" for k in (0.05, 0.1, 0.2)))),
    "shadow-on-sky": tuple(way(mixed("dark = lit - dark")) for way in (chain, where_cast)),
    "shadow-dims-all": tuple(way(mixed(f"dark = {k} * lit")) for way in (chain, where_cast) for k in (0.5, 0.3, 0.2)),
}  # fmt: skip

ALONE: Ways = {
    "light-reversed-in-shading": shade(f"{CLAMPED} => np.maximum(0, -{COS})", f"{CLAMPED} => np.minimum(0, {COS})"),
    "light-as-place": shade(f"{CLAMPED} => np.maximum(0, np.sum(normals * (to_light - points), axis=-1, keepdims=True) "
        "/ np.linalg.norm(to_light - points, axis=-1, keepdims=True))"),
}  # fmt: skip
