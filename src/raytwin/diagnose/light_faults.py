"""Mistakes in how light is reflected."""

from functools import partial
from typing import Any

import numpy as np

from raytwin.diagnose.changes import (
    CLAMPED,
    COS,
    LIGHT,
    ON_PLANE,
    SUM,
    SUN,
    before_shading,
    behind,
    chain,
    given,
    half_lit,
    is_ball,
    lit,
    mixed,
    offset_by,
    others_hide,
    row,
    shade,
    towards,
    unit,
    where_cast,
)
from raytwin.diagnose.predict import Pipeline, replaced, slip
from raytwin.files import srgb_decode, srgb_encode

AWAY = "np.linalg.norm(points - eye, axis=-1, keepdims=True)"
AT_PLACE, TO_PLACE = half_lit(unit("to_light - points")), towards("to_light - points")
FALLOFF = before_shading(
    "irradiance = irradiance / np.maximum(np.sum((to_light - points) ** 2, axis=-1, keepdims=True), 1e-12)"
)
"""1 / (distance to to_light, taken for a place)²."""
KINDS = f"~{ON_PLANE}", f"{ON_PLANE}"
PAINTS = 'np.array([thing["albedo"] for thing in things])'


def turned(matrix: str) -> tuple[Pipeline, ...]:
    """The light's direction turned by a function of R: everywhere, or for shading alone."""
    return lit(f"{matrix} @ to_light"), half_lit(f"{matrix} @ to_light")


def repainted(f: Any) -> Pipeline:
    """Another table of albedos: of the right one and which things are spheres."""

    def paint(things: Any) -> Any:
        return np.array(f([x["albedo"] for x in things], [is_ball(x) for x in things])).reshape(-1, 3)

    index = slip("radiance", (f"{PAINTS}.reshape(-1, 3)[which]", "paint(things)[which]"))
    return chain(index, replaced(paint=lambda _: paint))


def _of_first(albedos: Any, balls: Any) -> Any:
    """The first object's albedo on all spheres."""
    return [albedos[0] if ball else own for own, ball in zip(albedos, balls, strict=True)]


def _of_kind(albedos: Any, balls: Any, kind: bool, of: bool, k: int) -> Any:
    """The albedo of the first or last (`k`) object of the kind `of` on all of `kind`: what a loop has left."""
    there = [a for a, ball in zip(albedos, balls, strict=True) if ball == of]
    return [there[k] if ball == kind and there else a for a, ball in zip(albedos, balls, strict=True)]


def _of_next(albedos: Any, balls: Any, by: int) -> Any:
    """The albedo of the sphere `by` places on."""
    own = [a for a, ball in zip(albedos, balls, strict=True) if ball]
    others = iter(own[by:] + own[:by])
    return [next(others) if ball else a for a, ball in zip(albedos, balls, strict=True)]


def _of_table(albedos: Any, balls: Any, f: Any) -> Any:
    """A table in another order: of the spheres' albedos and the planes'."""
    made = f(*([a for a, ball in zip(albedos, balls, strict=True) if ball == kind] for kind in (True, False)))
    return [*made, *np.zeros((len(albedos) - len(made), 3))]


def darkened(light: str, by: str = "x['albedo']") -> Pipeline:
    """Multiply by what belongs to each object before it, as if an array of the scene were changed in place."""
    return before_shading(f"{light} = {light} * np.cumprod([np.ones(3), *({by} for x in things)], axis=0)[which]")


def on_kind(light: str, kind: str, k: str) -> Pipeline:
    """A factor of one kind of objects."""
    return before_shading(f"{light} = {light} * np.where({kind}, {k}, 1)")


SUMMED, SUMMED_SKY = (f"np.repeat(albedo @ {light}[:, None], 3, axis=-1)" for light in ("irradiance", "sky"))

LIGHTS = (
    row("light-reversed", LIGHT,
        "the light comes from the wrong side: to_light points from the surface to the sun, use it as it is",
        lit("-to_light")),
    row("light-reversed-in-shading", LIGHT,
        "n·l is taken with the wrong sign of l, though shadow rays go the right way: to_light points from the surface "
        "to the sun, use it as it is",
        *(chain(half_lit("-to_light"), test) for test in (others_hide, offset_by(1e-6))),
        alone=shade(f"{CLAMPED} => np.maximum(0, -{COS})", f"{CLAMPED} => np.minimum(0, {COS})")),
    row("light-in-camera-frame", LIGHT,
        "the sun's direction is given in the board's frame, but your normals are in the camera's (or the other way "
        "round): turn one of them by R",
        *turned("R.T")),
    row("light-turned-needlessly", LIGHT,
        "the sun's direction is turned by R although points and normals are in the board's frame already",
        *turned("R")),
    row("light-turned-by-transpose", LIGHT,
        "the sun's direction is turned by Rᵀ instead of R",
        *turned("R.T @ R.T")),
    row("light-moved", LIGHT,
        "the sun's direction is moved by t as if it were a point (a homogeneous 1): only turn it",
        *(lit(one) for d in ("to_light + R.T @ t", "to_light - R.T @ t", "to_light + t") for one in (unit(d), d))),
    row("light-axes", LIGHT,
        "the axes of the sun's direction (or of all normals) are mixed up, or one has the wrong sign: z is up here",
        *(lit(f"to_light[{order}] * {signs}") for order, signs in (
            ([0, 2, 1], 1), ([1, 0, 2], 1), ([2, 1, 0], 1), ([0, 2, 1], [1, 1, -1]), ([0, 1, 2], [1, -1, 1]),
            ([0, 1, 2], [-1, 1, 1]), ([0, 1, 2], [1, 1, -1]), ([0, 1, 2], [-1, -1, 1]), ([0, 2, 1], [1, -1, 1]))),
        *(half_lit(f"to_light * {signs}") for signs in ([1, 1, -1], [1, -1, 1], [-1, 1, 1])),
        *(half_lit(f"to_light[{order}]") for order in ([0, 2, 1], [1, 0, 2], [2, 1, 0]))),
    row("light-as-place", LIGHT,
        "to_light is used as a point that the light sits at: it is a direction, the same for every surface",
        chain(AT_PLACE, TO_PLACE), chain(FALLOFF, AT_PLACE, TO_PLACE), AT_PLACE,
        chain(half_lit(unit("to_light + eye - points")), towards("to_light + eye - points")),
        half_lit(unit("points - to_light")), chain(half_lit(unit("points - to_light")), offset_by(1e-6)),
        chain(FALLOFF, AT_PLACE),
        alone=shade(f"{CLAMPED} => np.maximum(0, np.sum(normals * (to_light - points), axis=-1, keepdims=True) / "
                    "np.linalg.norm(to_light - points, axis=-1, keepdims=True))")),
    row("light-at-eye", LIGHT,
        "surfaces are lit from the eye, by n·d of the ray that sees them: the sun's light falls along to_light",
        half_lit(unit("eye - points")), half_lit(unit("points - eye"))),
    row("dot-product", LIGHT,
        "n·l is mistyped: it is n_x l_x + n_y l_y + n_z l_z, each component with the same one of the other",
        *shade(*(f"{COS} => ({COS} - normals[:, {k}:{k + 1}] * to_light[{k}] + {term.format(k=k)})" for term in (
            "normals[:, {k}:{k}+1] ** 2", "to_light[{k}] ** 2", "0") for k in (2, 0, 1)),
            *(f"{COS} => 3 * normals[:, {k}:{k + 1}] * to_light[{k}]" for k in (2, 0, 1)))),
    row("no-clamp", LIGHT,
        "light is negative where a surface faces away from the sun: max(0, n·l)",
        *shade(f"{CLAMPED} => {COS}")),
    row("abs-cosine", LIGHT,
        "surfaces that face away from the sun are lit: max(0, n·l), not |n·l|",
        *(chain(*test, *shade(f"{CLAMPED} => np.abs({COS})")) for test in ((), (others_hide,)))),
    row("squared-cosine", LIGHT, "the cosine is squared: max(0, n·l) goes in once",
        *shade(f"{CLAMPED} => {CLAMPED} ** 2", f"{CLAMPED} => {COS} ** 2")),
    row("angle-for-cosine", LIGHT,
        "n·l is the cosine of the angle already: take no arccos, cos or sin of it, and no degrees",
        *shade(*(f"{CLAMPED} => {f.format(c=f'np.clip({COS}, 0, 1)')}" for f in (
            "np.cos({c})", "np.arccos({c})", "np.sqrt(1 - {c} ** 2)", "np.cos(np.degrees(np.arccos({c})))")),
            f"{CLAMPED} => np.maximum(0, np.arccos({COS}))")),
    row("distance-falloff", LIGHT,
        "the sun's light gets weaker with distance: the sun is so far away that its irradiance is the same everywhere",
        *(before_shading(f"irradiance = irradiance / {AWAY}{power}") for power in (" ** 2", "")),
        before_shading(f"irradiance, sky = irradiance / {AWAY} ** 2, sky / {AWAY} ** 2")),
    row("no-cosine", LIGHT, "the cosine is missing: the sun's light falls with max(0, n·l)",
        *shade(f"{CLAMPED} => ({COS} > 0)", f"{CLAMPED} => np.ones_like({COS})")),
    row("half-lambert", LIGHT, "n·l is mapped to 0..1 as (1 + n·l) / 2: it has to be max(0, n·l)",
        *shade(f"{CLAMPED} => (1 + {COS}) / 2", f"{CLAMPED} => ((1 + {COS}) / 2) ** 2")),
    row("albedo-missing-sun", LIGHT, "the albedo is missing in the sun's part: albedo/π E max(0, n·l)",
        *shade("albedo / np.pi => 1 / np.pi")),
    row("albedo-missing", LIGHT, "the albedo is missing: it multiplies the sun's part and the sky's",
        *shade(f"{SUM} => irradiance / np.pi * cosine + sky + 0 * albedo")),
    row("albedo-squared", LIGHT, "the albedo is multiplied in twice",
        *shade("albedo / np.pi => albedo**2 / np.pi ;; albedo * sky => albedo**2 * sky",
               "albedo / np.pi => albedo**2 / np.pi", "albedo * sky => albedo**2 * sky")),
    row("albedo-decoded", LIGHT, "the albedo is treated as a display colour: it is linear, use it as it is",
        *(given(albedo=f) for f in (srgb_decode, lambda a: a**2.2, srgb_encode, lambda a: a ** (1 / 2.2), np.sqrt))),
    row("albedo-of-another", LIGHT,
        "objects have another one's albedo: check the index, or the name (after a loop its variable is the last one)",
        repainted(_of_first), *(repainted(lambda a, balls, k=k: [a[k]] * len(a)) for k in (0, -1)),
        *(repainted(partial(_of_next, by=k)) for k in (1, -1)),
        *(repainted(partial(_of_kind, kind=kind, of=of, k=k)) for kind, of, k in (
            (False, True, -1), (False, True, 0), (True, True, -1), (False, False, -1), (False, False, 0)))),
    row("albedo-order", LIGHT,
        "the table of albedos is in another order than the objects that the index counts: spheres, then planes, in "
        "both",
        *(repainted(partial(_of_table, f=f)) for f in (
            lambda balls, flats: flats + balls, lambda balls, flats: (balls + flats)[::-1],
            lambda balls, flats: balls + (balls * len(flats))[: len(flats)],
            lambda balls, flats: (balls + flats)[1:] + (balls + flats)[:1],
            lambda balls, flats: (balls + flats)[-1:] + (balls + flats)[:-1]))),
    row("channels-summed", LIGHT,
        "albedo and light are multiplied by a dot product (@), which sums over the channels: multiply channel by "
        "channel (*)",
        *shade(f"{SUN} => {SUMMED} / np.pi * cosine", f"albedo * sky => {SUMMED_SKY}",
               f"{SUN} => {SUMMED} / np.pi * cosine ;; albedo * sky => {SUMMED_SKY}")),
    row("changed-in-place", LIGHT,
        "the scene's own array is changed in place (*=, /=), so that each object changes the light of the next one: "
        "write a = b * c",
        chain(darkened("sky"), *behind("sky * np.prod([x['albedo'] for x in things], axis=0)")),
        darkened("sky"), darkened("irradiance"), darkened("irradiance", "x['albedo'] / np.pi"),
        darkened("irradiance", "1 / np.pi + 0 * x['albedo']")),
    row("albedo-channels", LIGHT, "the albedo's channels are mixed up: they are red, green, blue",
        given(albedo=lambda a: a[..., ::-1]), given(albedo=lambda a: a[..., :1] + 0 * a),
        given(albedo=lambda a: a.mean(axis=-1, keepdims=True) + 0 * a)),
    row("light-colour", LIGHT, "the light's colour is lost: irradiance and sky have three channels",
        *shade(*(f"* irradiance => * {one}" for one in (
            "np.mean(irradiance)", "irradiance[0]", "np.max(irradiance)", "np.linalg.norm(irradiance)",
            "np.sum(irradiance)", "irradiance[::-1]")), "albedo * sky => albedo * np.mean(sky)",
               "albedo * sky => albedo * sky[0]")),
    row("irradiance-missing", LIGHT, "the sun's irradiance E is missing: albedo/π E max(0, n·l)",
        *shade(*(f"* irradiance => {new}" for new in (
            "* (irradiance > 0)", "* np.pi * (irradiance > 0)", "* irradiance / max(np.max(irradiance), 1e-300)",
            "* irradiance / max(np.linalg.norm(irradiance), 1e-300)")))),
    row("irradiance-squared", LIGHT, "the sun's irradiance is multiplied in twice",
        *shade("* irradiance => * irradiance**2")),
    row("pi-multiplied", LIGHT, "the sun's part is multiplied by π where it has to be divided: albedo/π E max(0, n·l)",
        *shade("/ np.pi => * np.pi")),
    row("pi-missing", LIGHT,
        "the sun's part is π times too bright: a Lambertian surface reflects albedo/π, not albedo",
        *shade(" / np.pi => ")),
    row("pi-twice", LIGHT, "the sun's part is divided by π twice",
        *shade("/ np.pi => / np.pi**2")),
    row("pi-missing-everywhere", LIGHT, "everything that is lit is π times too bright: reflection is albedo/π of the "
        "irradiance, and a sky of constant radiance gives π Lₛ of it",
        *shade(f"{SUM} => np.pi * ({SUM})")),
    row("one-kind-by-pi", LIGHT,
        "spheres and planes are shaded by different formulas, the sun's part of one of them π times too bright or too "
        "dark: both reflect albedo/π E max(0, n·l)",
        *(on_kind("irradiance", kind, k) for kind in KINDS for k in ("np.pi", "1 / np.pi"))),
    *(row(f"one-kind-without-{name}", LIGHT,
          f"spheres and planes are shaded by different formulas, one of them without the {name}'s light: both have "
          "albedo/π E max(0, n·l) + albedo Lₛ",
          *(on_kind(light, kind, "0") for kind in KINDS))
      for name, light in (("sun", "irradiance"), ("sky", "sky"))),
    row("sun-twice", LIGHT, "the sun's light is added twice",
        *shade("albedo / np.pi => 2 * albedo / np.pi")),
    row("sun-half", LIGHT, "the sun's part is half as bright as it should be",
        *shade("np.pi => (2 * np.pi)")),
    row("sun-missing", LIGHT, "the sun's part is missing: only the sky's light is there",
        *shade(f"{SUM} => albedo * sky + 0 * cosine")),
    row("sky-twice", LIGHT, "the sky's light is added twice",
        *shade("albedo * sky => 2 * albedo * sky")),
    row("sky-missing", LIGHT, "the sky's light (albedo times sky) is missing on surfaces",
        *shade(f"{SUM} => {SUN}")),
    row("sky-by-pi", LIGHT,
        "the sky's part is divided by π: a sky of constant radiance gives albedo Lₛ",
        *shade("albedo * sky => albedo * sky / np.pi")),
    row("sky-times-pi", LIGHT, "the sky's part is π times too bright: it is albedo Lₛ",
        *shade("albedo * sky => albedo * sky * np.pi")),
    row("sky-half", LIGHT, "the sky's part is half as bright as it should be",
        *shade("albedo * sky => albedo * sky / 2")),
    row("sky-without-albedo", LIGHT, "the sky's light is added without the albedo: albedo Lₛ",
        *shade("albedo * sky => sky + 0 * albedo")),
    row("sky-constant", LIGHT,
        "surfaces get a constant for the sky's light (ambient = 0.1): it is albedo Lₛ, Lₛ being the scene's sky",
        *shade(*(f"albedo * sky => {k} * albedo" for k in (0.1, 0.2, 0.05, 0.3, 0.5)))),
    row("sky-without-colour", LIGHT, "the sky's radiance is left out of its part: albedo Lₛ, not albedo",
        *shade("albedo * sky => albedo")),
    row("sky-on-all", LIGHT,
        "the sky's radiance is added to every pixel, to surfaces too: only rays that meet nothing show it as it is",
        *(chain(way, *more) for more in ((), behind("2 * sky"))
          for way in shade("albedo * sky => albedo * sky + sky"))),
    row("sky-times-sun", LIGHT, "the sky's part is multiplied by the sun's irradiance: it is albedo Lₛ",
        before_shading("sky = sky * irradiance"), before_shading("sky = sky * irradiance / np.pi"),
        *shade(f"{SUM} => cosine * (albedo / np.pi * irradiance + albedo * sky)", f"{SUM} => (cosine > 0) * ({SUM})")),
    row("sky-before-clamp", LIGHT, "the clamp comes too late: max(0, n·l) alone, then the sky's light is added",
        *shade(f"{CLAMPED} => {COS} ;; {SUM} => np.maximum(0, {SUM})",
               f"{CLAMPED} => np.maximum(0, {COS} + sky) ;;  + albedo * sky => ")),
    row("sky-only-in-shadow", LIGHT, "the sky lights only what the sun does not: add it everywhere",
        mixed(f"lit = lit - dark * ({COS} > 0)"), mixed("lit = lit - dark"),
        mixed(f"lit, dark = lit - dark * ({COS} > 0), dark * ({COS} <= 0)"), where_cast(mixed("lit = lit - dark")),
        mixed("lit = np.maximum(lit - dark, dark)"),
        *shade(f"{SUM} => np.where(cosine > 0, {SUN}, albedo * sky)")),
    row("shadow-black", LIGHT, "shadows are black: the sky's light reaches them too",
        *(way(mixed("dark = 0 * dark")) for way in (chain, where_cast)),
        mixed(f"lit, dark = lit - dark * ({COS} <= 0), 0 * dark"),
        mixed(f"lit, dark = lit - dark * ({COS} <= 0), dark * ({COS} > 0)")),
    row("sky-by-height", LIGHT, "the sky's light is weighed by the normal: here it is albedo Lₛ whatever way it faces",
        *(before_shading(f"sky = sky * {weight}") for weight in (
            "(1 + normals[:, 2:]) / 2", "np.maximum(normals[:, 2:], 0)", f"np.maximum({COS}, 0)")),
        mixed(f"lit, dark = lit - dark + dark * np.maximum({COS}, 0), 0 * dark")),
)  # fmt: skip
