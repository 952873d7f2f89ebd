"""Mistakes in how light is reflected."""

from collections.abc import Callable
from functools import partial
from math import pi
from typing import Any

import numpy as np

from raytwin.diagnose.changes import (
    CLAMPED,
    COS,
    LIGHT,
    SUM,
    SUN,
    behind,
    both,
    coloured,
    half_lit,
    is_sphere,
    lit,
    made_unit,
    offset_by,
    on_plane,
    put,
    row,
    shade,
    shaded,
    sky_scaled,
    sky_times,
    sun,
    sun_times,
    turned,
    where_cast,
)
from raytwin.diagnose.predict import Array, Change, Hits, Terms, others_hide
from raytwin.files import srgb_decode, srgb_encode
from raytwin.scene import Scene


def ambient(x: Terms) -> Array:
    return x.albedo * x.sky


def moved_light(f: Callable[[Array, Array, Array], Array]) -> tuple[Change, ...]:
    """(to, R, t) -> a direction, made unit or not."""

    def g(to: Array, scene: Scene, hits: Hits, unit: bool) -> Array:
        R, t = np.asarray(scene.camera.R_cam_board), np.array(scene.camera.t_cam_board)[:, None]
        return made_unit(f(to, R, t)) if unit else f(to, R, t)

    return tuple(lit(partial(g, unit=unit)) for unit in (True, False))


def _to_position(to: Array, scene: Scene, hits: Hits) -> Array:
    return made_unit(to - hits.point)


def _to_eye(to: Array, scene: Scene, hits: Hits, sign: int) -> Array:
    return sign * made_unit(np.array(scene.camera.eye)[:, None] - hits.point)


def _off_position(to: Array, scene: Scene, hits: Hits) -> Array:
    return made_unit(hits.point - to)


def _to_place_by_eye(to: Array, scene: Scene, hits: Hits) -> Array:
    """The same in the camera's frame."""
    return made_unit(to + np.array(scene.camera.eye)[:, None] - hits.point)


def _grey(x: Array) -> Array:
    return np.broadcast_to(x.mean(axis=0, keepdims=True), x.shape)


def _permuted(*order: int, sign: tuple[int, int, int] = (1, 1, 1)) -> Callable[[Array, Scene, Hits], Array]:
    return lambda to, scene, hits: to[list(order)] * np.array(sign)[:, None]


def _of_one(x: Terms, k: int) -> Array:
    """The first or the last object's albedo on all."""
    one = np.array(x.scene.objects[k].material.albedo)[:, None] if x.scene.objects else 1.0
    return one + 0 * x.albedo


def _of_first(x: Terms) -> Array:
    """The first object's albedo on all spheres."""
    first = np.array(x.scene.objects[0].material.albedo)[:, None] if x.scene.objects else 1.0
    spheres = np.array([is_sphere(thing) for thing in x.scene.objects] + [False])[x.hits.ids]
    return np.where(spheres, first, x.albedo)


def _of_next(x: Terms, by: int) -> Array:
    """The albedo of the sphere `by` places on."""
    balls = [i for i, thing in enumerate(x.scene.objects) if is_sphere(thing)]
    table = [thing.material.albedo for thing in x.scene.objects]
    for k, i in enumerate(balls):
        table[i] = x.scene.objects[balls[(k + by) % len(balls)]].material.albedo
    return np.array([*table, (0.0, 0.0, 0.0)])[x.hits.ids].T


def _of_table(x: Terms, f: Callable[[list[Any], list[Any]], list[Any]]) -> Array:
    """By the object's index, from a table in another order: of the spheres' albedos and the planes'."""
    balls, flats = (
        [thing.material.albedo for thing in x.scene.objects if is_sphere(thing) == k] for k in (True, False)
    )
    table = f(balls, flats)
    return np.array([*table, (0.0, 0.0, 0.0)])[np.minimum(x.hits.ids, len(table))].T


def _darkened(x: Terms, f: Callable[[Array], Array]) -> Array:
    """Multiply each albedo by f of all before it, as if an array of the scene were changed in place."""
    each = [f(np.array(thing.material.albedo)) for thing in x.scene.objects]
    return np.cumprod([np.ones(3), *each], axis=0)[x.hits.ids].T


def _darkened_sky(scene: Scene) -> Array:
    return np.array(scene.sky.radiance) * np.prod([thing.material.albedo for thing in scene.objects], axis=0)


def _on_kind(x: Terms, planes: bool, k: float) -> Array:
    """A factor of one kind of objects."""
    return np.where(on_plane(x) == planes, k, 1.0)


def _falloff(x: Terms) -> Array:
    """1 / (distance to to_light, taken for a place)²."""
    away = np.array(x.scene.sun.to_light)[:, None] - x.hits.point
    return 1 / np.maximum((away * away).sum(axis=0), 1e-12)


def _by_distance(x: Terms, power: int) -> Array:
    return np.linalg.norm(x.hits.point - np.array(x.scene.camera.eye)[:, None], axis=0) ** -power


def _in_shadow(x: Terms) -> Array:
    return np.where((x.visible > 0) & (x.cos > 0), 0.0, 1.0)


def _up(x: Terms) -> Array:
    return (1 + x.hits.normal[2]) / 2


SUMMED, SUMMED_SKY = (f"np.repeat(albedo @ {light}[:, None], 3, axis=-1)" for light in ("irradiance", "sky"))

LIGHTS = (
    row("light-reversed", LIGHT,
        "the light comes from the wrong side: to_light points from the surface to the sun, use it as it is",
        lit(lambda to, *_: -to)),
    row("light-reversed-in-shading", LIGHT,
        "n·l is taken with the wrong sign of l, though shadow rays go the right way: to_light points from the surface "
        "to the sun, use it as it is",
        *(both(half_lit(lambda to, *_: -to), put(blocked=test)) for test in (others_hide, offset_by(1e-6))),
        alone=shade(f"{CLAMPED} => np.maximum(0, -{COS})", f"{CLAMPED} => np.minimum(0, {COS})")),
    row("light-in-camera-frame", LIGHT,
        "the sun's direction is given in the board's frame, but your normals are in the camera's (or the other way "
        "round): turn one of them by R",
        *turned(lambda R: R.T)),
    row("light-turned-needlessly", LIGHT,
        "the sun's direction is turned by R although points and normals are in the board's frame already",
        *turned(lambda R: R)),
    row("light-turned-by-transpose", LIGHT,
        "the sun's direction is turned by Rᵀ instead of R",
        *turned(lambda R: R.T @ R.T)),
    row("light-moved", LIGHT,
        "the sun's direction is moved by t as if it were a point (a homogeneous 1): only turn it",
        *moved_light(lambda to, R, t: to + R.T @ t), *moved_light(lambda to, R, t: to - R.T @ t),
        *moved_light(lambda to, R, t: to + t)),
    row("light-axes", LIGHT,
        "the axes of the sun's direction (or of all normals) are mixed up, or one has the wrong sign: z is up here",
        lit(_permuted(0, 2, 1)), lit(_permuted(1, 0, 2)), lit(_permuted(2, 1, 0)),
        lit(_permuted(0, 2, 1, sign=(1, 1, -1))), lit(_permuted(0, 1, 2, sign=(1, -1, 1))),
        lit(_permuted(0, 1, 2, sign=(-1, 1, 1))), lit(_permuted(0, 1, 2, sign=(1, 1, -1))),
        lit(_permuted(0, 1, 2, sign=(-1, -1, 1))), lit(_permuted(0, 2, 1, sign=(1, -1, 1))),
        *(half_lit(_permuted(0, 1, 2, sign=sign)) for sign in ((1, 1, -1), (1, -1, 1), (-1, 1, 1))),
        *(half_lit(_permuted(*order)) for order in ((0, 2, 1), (1, 0, 2), (2, 1, 0)))),
    row("light-as-place", LIGHT,
        "to_light is used as a point that the light sits at: it is a direction, the same for every surface",
        lit(_to_position), both(lit(_to_position), sun_times(_falloff)), half_lit(_to_position), lit(_to_place_by_eye),
        half_lit(_off_position), both(half_lit(_off_position), put(blocked=offset_by(1e-6))),
        both(half_lit(_to_position), sun_times(_falloff)),
        alone=shade(f"{CLAMPED} => np.maximum(0, np.sum(normals * (to_light - points), axis=-1, keepdims=True) / "
                    "np.linalg.norm(to_light - points, axis=-1, keepdims=True))")),
    row("light-at-eye", LIGHT,
        "surfaces are lit from the eye, by n·d of the ray that sees them: the sun's light falls along to_light",
        half_lit(partial(_to_eye, sign=1)), half_lit(partial(_to_eye, sign=-1))),
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
        *(both(*test, *shade(f"{CLAMPED} => np.abs({COS})")) for test in ((), (put(blocked=others_hide),)))),
    row("squared-cosine", LIGHT, "the cosine is squared: max(0, n·l) goes in once",
        *shade(f"{CLAMPED} => {CLAMPED} ** 2", f"{CLAMPED} => {COS} ** 2")),
    row("angle-for-cosine", LIGHT,
        "n·l is the cosine of the angle already: take no arccos, cos or sin of it, and no degrees",
        *shade(*(f"{CLAMPED} => {f.format(c=f'np.clip({COS}, 0, 1)')}" for f in (
            "np.cos({c})", "np.arccos({c})", "np.sqrt(1 - {c} ** 2)", "np.cos(np.degrees(np.arccos({c})))")),
            f"{CLAMPED} => np.maximum(0, np.arccos({COS}))")),
    row("distance-falloff", LIGHT,
        "the sun's light gets weaker with distance: the sun is so far away that its irradiance is the same everywhere",
        *(sun_times(partial(_by_distance, power=k)) for k in (2, 1)),
        both(sun_times(partial(_by_distance, power=2)), sky_times(partial(_by_distance, power=2)))),
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
        coloured(lambda x: srgb_decode(x.albedo)), coloured(lambda x: x.albedo**2.2),
        coloured(lambda x: srgb_encode(x.albedo)), coloured(lambda x: x.albedo ** (1 / 2.2)),
        coloured(lambda x: np.sqrt(x.albedo))),
    row("albedo-of-another", LIGHT, "objects have another one's albedo: check the index",
        coloured(_of_first), coloured(partial(_of_one, k=0)), coloured(partial(_of_one, k=-1)),
        *(coloured(partial(_of_next, by=k)) for k in (1, -1))),
    row("albedo-order", LIGHT,
        "the table of albedos is in another order than the objects that the index counts: spheres, then planes, in "
        "both",
        *(coloured(partial(_of_table, f=f)) for f in (
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
        both(sky_times(partial(_darkened, f=lambda a: a)), behind(_darkened_sky)),
        sky_times(partial(_darkened, f=lambda a: a)), sun_times(partial(_darkened, f=lambda a: a)),
        sun_times(partial(_darkened, f=lambda a: a / pi)), sun_times(partial(_darkened, f=lambda a: 1 / pi + 0 * a))),
    row("albedo-channels", LIGHT, "the albedo's channels are mixed up: they are red, green, blue",
        coloured(lambda x: x.albedo[::-1]), coloured(lambda x: np.broadcast_to(x.albedo[:1], x.albedo.shape)),
        coloured(lambda x: _grey(x.albedo))),
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
        *(sun_times(partial(_on_kind, planes=planes, k=k)) for planes in (False, True) for k in (pi, 1 / pi))),
    *(row(f"one-kind-without-{name}", LIGHT,
          f"spheres and planes are shaded by different formulas, one of them without the {name}'s light: both have "
          "albedo/π E max(0, n·l) + albedo Lₛ",
          *(times(partial(_on_kind, planes=planes, k=0.0)) for planes in (False, True)))
      for name, times in (("sun", sun_times), ("sky", sky_times))),
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
        *(both(way, *more) for more in ((), (behind(partial(sky_scaled, k=2.0)),))
          for way in shade("albedo * sky => albedo * sky + sky"))),
    row("sky-times-sun", LIGHT, "the sky's part is multiplied by the sun's irradiance: it is albedo Lₛ",
        sky_times(lambda x: x.irradiance), sky_times(lambda x: x.irradiance / pi),
        *shade(f"{SUM} => cosine * (albedo / np.pi * irradiance + albedo * sky)", f"{SUM} => (cosine > 0) * ({SUM})")),
    row("sky-before-clamp", LIGHT, "the clamp comes too late: max(0, n·l) alone, then the sky's light is added",
        *shade(f"{CLAMPED} => {COS} ;; {SUM} => np.maximum(0, {SUM})",
               f"{CLAMPED} => np.maximum(0, {COS} + sky) ;;  + albedo * sky => ")),
    row("sky-only-in-shadow", LIGHT, "the sky lights only what the sun does not: add it everywhere",
        sky_times(_in_shadow), sky_times(lambda x: 1 - x.visible), sky_times(lambda x: np.where(x.cos > 0, 0.0, 1.0)),
        where_cast(sky_times(lambda x: 1 - x.visible)),
        shaded(lambda x: np.maximum(sun(x), ambient(x))),
        *shade(f"{SUM} => np.where(cosine > 0, {SUN}, albedo * sky)")),
    row("shadow-black", LIGHT, "shadows are black: the sky's light reaches them too",
        sky_times(lambda x: x.visible), sky_times(lambda x: 1 - _in_shadow(x)),
        sky_times(lambda x: np.where(x.cos > 0, 1.0, 0.0)), where_cast(sky_times(lambda x: x.visible))),
    row("sky-by-height", LIGHT, "the sky's light is weighed by the normal: here it is albedo Lₛ whatever way it faces",
        sky_times(_up), sky_times(lambda x: np.maximum(x.hits.normal[2], 0)),
        sky_times(lambda x: np.maximum(x.cos, 0)), sky_times(lambda x: x.visible * np.maximum(x.cos, 0))),
)  # fmt: skip
