"""Mistakes in normals."""

from functools import lru_cache, partial
from typing import Any

import numpy as np

from raytwin.diagnose.changes import (
    CROSS_AT,
    NORMALS,
    both,
    coloured,
    is_sphere,
    made_unit,
    normals,
    normals_at,
    on_plane,
    put,
    row,
    terms,
)
from raytwin.diagnose.predict import RIGHT, Array, Bench, Change, Rays, Terms, meet_all, others_hide, table_of
from raytwin.scene import Rectangle, Scene, Shape, Sphere


def _backs_shaded(x: Terms) -> Terms:
    """Planes that are seen from behind meet themselves on the way to the sun."""
    own = np.array([getattr(thing, "normal", (0, 0, 0)) for thing in x.scene.objects] + [(0, 0, 0)])[x.hits.ids].T
    hides = x.shadows & ((own * (np.array(x.scene.camera.eye)[:, None] - x.hits.point)).sum(axis=0) < 0)
    return x._replace(visible=np.where(hides, 0.0, x.visible))


def _fixed(n: Array, axis: Any) -> Array:
    return np.broadcast_to(np.array(axis)[:, None], n.shape)


def turned_to_eye(n: Array, rays: Rays) -> Array:
    return np.where((n * rays.d).sum(axis=0) > 0, -n, n)


def _lit_behind(x: Terms) -> Terms:
    return x._replace(cos=np.where(on_plane(x), np.abs(x.cos), x.cos))


def turned_by_origin(n: Array, p: Array, rays: Rays, thing: Shape, sign: int, flat: int = 0) -> Array:
    """A plane's by n·p; `flat`: where that is 0, 1 for the eye's side, -1 for the other; 0: chance, not predicted."""
    if isinstance(thing, Sphere):
        return n
    axis = _fixed(n, thing.normal)
    side = sign * float(np.dot(thing.normal, thing.center))
    return flat * n if abs(side) < 1e-9 else axis * (1 if side < 0 else -1)


def _of_other_center(x: Terms, k: int, unit: bool, inside: bool) -> Terms:
    """Take the normal of the first or last sphere; `inside`: where it points inwards, shadow rays start inside."""
    if not x.scene.spheres:
        return x
    one, flat = x.scene.spheres[k], on_plane(x)
    n = (x.hits.point - np.array(one.center)[:, None]) / one.radius
    n = np.where(flat, x.hits.normal, made_unit(n) if unit else n)
    dark = (inside and x.shadows) & ((n * x.hits.normal).sum(axis=0) < 0)
    return x._replace(cos=np.array(x.scene.sun.to_light) @ n, visible=np.where(dark, 0.0, x.visible))


def _by_number(x: Terms, inside: bool) -> Terms:
    """Sphere k has the normal of plane k, and planes have none; `inside`: shadow rays start there, and meet it."""
    flats = [thing.normal for thing in x.scene.objects if isinstance(thing, Rectangle)]
    balls = [k for k, thing in enumerate(x.scene.objects) if is_sphere(thing)]
    table = np.zeros((len(x.scene.objects) + 1, 3))
    for k, normal in zip(balls, flats, strict=False):
        table[k] = normal
    given, d = table[x.hits.ids].T, x.hits.point - np.array(x.scene.camera.eye)[:, None]
    given = np.where((given * d).sum(axis=0) > 0, -given, given)
    n = np.where(on_plane(x) | given.any(axis=0), given, x.hits.normal)
    dark = ((n * x.hits.normal).sum(axis=0) < 0) & (inside and x.shadows)
    return x._replace(cos=np.array(x.scene.sun.to_light) @ n, visible=x.visible * ~dark)


def _turned_by_camera_ray(x: Terms, spheres: bool, inside: bool) -> Terms:
    """n·d with d in the camera's axes; `spheres`: theirs, too; `inside`: shadow rays start within, and meet them."""
    d = x.hits.point - np.array(x.scene.camera.eye)[:, None]
    flat = on_plane(x)
    n = np.where(flat, table_of(x.scene.objects).facing[x.hits.ids].T, x.hits.normal)
    away = ((n * (np.asarray(x.scene.camera.R_cam_board) @ d)).sum(axis=0) > 0) & (flat | spheres)
    dark = away & ~flat & (inside and x.shadows)
    return x._replace(cos=np.array(x.scene.sun.to_light) @ np.where(away, -n, n), visible=x.visible * ~dark)


@lru_cache(maxsize=8)
def _norms(scene: Scene) -> dict[str, Array]:
    """By what (K + 1, 3) each object's normals are divided where a norm is taken of more than one of them.

    `drawn`: of all pixels where a sphere was nearest when it was its turn; `left`: where it is in the end; `columns`:
    of these, axis by axis; `all`, `all columns`: of the whole picture.
    """
    step = int(np.ceil(np.sqrt(scene.camera.width * scene.camera.height / 20_000)))
    camera = scene.camera.resized(-(-scene.camera.width // step), -(-scene.camera.height // step))
    v, u = np.indices((camera.height, camera.width), float).reshape(2, -1)
    bench = Bench(scene.with_camera(camera), u, v)
    rays, hits = bench.rays(RIGHT), bench.hits(RIGHT)
    made = {name: np.ones((len(scene.objects) + 1, 3)) for name in ("drawn", "left", "columns")}
    t = meet_all(rays.origin, rays.d, scene.objects, RIGHT)
    for k, thing in enumerate(scene.objects):
        here = hits.ids == k
        if is_sphere(thing) and here.any():
            first = np.isfinite(t[k]) & (t[k] <= t[: k + 1].min(axis=0))
            made["drawn"][k] = step * np.sqrt(first.sum())
            made["left"][k] = step * np.sqrt(here.sum())
            made["columns"][k] = step * np.linalg.norm(hits.normal[:, here], axis=1)
    there = max(int((hits.ids >= 0).sum()), 1)
    made["all"] = np.full((len(scene.objects) + 1, 3), step * np.sqrt(there))
    made["all columns"] = step * np.linalg.norm(hits.normal, axis=1) + np.zeros((len(scene.objects) + 1, 1))
    return made


def _by_norm(x: Terms, of: str) -> Terms:
    n = x.hits.normal / np.maximum(_norms(x.scene)[of][x.hits.ids].T, 1e-9)
    return x._replace(cos=(n * np.array(x.scene.sun.to_light)[:, None]).sum(axis=0))


PLANES_BY_ORIGIN = (
    "the planes' normals are turned round by n·p, p measured from the board's origin: which side the eye sees is told "
    "by n·d"
)
FACED = "n = np.where(towards, n, -n)"
FREE = f'{FACED} => n = n if "radius" in thing else np.where(towards, n, -n)'
BALL, UP = '(points - thing["center"]) / thing["radius"]', "np.tile([0.0, 0.0, 1.0], (len(points), 1))"
PAINT = 'np.tile(thing["albedo"], (len(points), 1))'


def _ball(*texts: str) -> tuple[Change, ...]:
    """Other normals of spheres."""
    return normals_at(*(f"{FREE} ;; {BALL} => {text}" for text in texts))


def _flat(*texts: str) -> tuple[Change, ...]:
    """Other normals of planes, once they are half_u × half_v made unit."""
    return normals_at(*(f'{FACED} => n = n if "radius" in thing else {text}' for text in texts))


NORMALS_ = (
    row("normal-inward", NORMALS,
        "the spheres' normals point inwards: n = (p - center) / radius, from the centre to the point",
        *_ball('(thing["center"] - points) / thing["radius"]')),
    row("all-normals-inward", NORMALS,
        "the normals point away from the eye, those of planes too: turn them round",
        *normals_at("np.where(towards, n, -n) => np.where(towards, -n, n)")),
    row("plane-normal-turned", NORMALS,
        "the planes' normals point to the side that the eye does not see: turn them round where n·d > 0",
        *_flat("np.where(towards, -n, n)")),
    row("plane-normal-fixed", NORMALS,
        "the planes' normals are half_u × half_v whatever side is seen, in shading or where shadow rays start: turn "
        "them round where n·d > 0",
        *_flat("n", "-n"), both(*_flat("n"), put(blocked=others_hide), terms(_backs_shaded)), terms(_backs_shaded)),
    row("plane-faces-light", NORMALS,
        "planes are lit on both sides at once, their normals turned to the sun, or up: a normal belongs to the side "
        "that the eye sees, and max(0, n·l) is 0 where that is turned away from the sun",
        both(put(blocked=others_hide), terms(_lit_behind)), terms(_lit_behind),
        *_flat("np.where(n[:, 2:] < 0, -n, n)")),
    row("plane-normal-by-origin", NORMALS,
        PLANES_BY_ORIGIN,
        *(normals(partial(turned_by_origin, sign=k)) for k in (1, -1)),
        *_flat("np.where(np.sum(n * eye, axis=-1, keepdims=True) < 0, -n, n)")),
    row("plane-normal-up", NORMALS, "the planes' normals are taken for the board's z axis: they are half_u × half_v",
        *_flat(UP), *normals_at(f"{CROSS_AT} => n = np.array([0.0, 0.0, 1.0])")),
    row("normal-turned-by-other-ray", NORMALS,
        "normals are turned to the eye by a ray in another frame: in n·d both have to be in the board's",
        *(both(put(blocked=others_hide), terms(partial(_turned_by_camera_ray, spheres=balls, inside=dark)))
          for balls, dark in ((True, False), (True, True), (False, False)))),
    row("plane-normal-edge", NORMALS, "the planes' normals lie in the plane: they are half_u × half_v",
        *normals_at(*(f'{CROSS_AT} => n = thing["{edge}"]' for edge in ("half_u", "half_v")))),
    row("normal-not-unit", NORMALS,
        "the spheres' normals are not unit: divide p - center by the radius",
        *_ball('points - thing["center"]', '(points - thing["center"]) * thing["radius"]')),
    row("normal-by-radius-twice", NORMALS,
        "the spheres' normals are divided by the radius once too often: (p - center) / radius is unit",
        *_ball(f'{BALL} / thing["radius"]')),
    row("made-unit-by-square", NORMALS,
        "vectors are divided by v·v, the square of their length: v / √(v·v) is unit",
        *normals_at(f'{FREE} ;; {BALL} => {BALL} / thing["radius"] ;; n / np.linalg.norm(n) => n / (n @ n)',
                    "n / np.linalg.norm(n) => n / (n @ n)")),
    row("normal-by-whole-norm", NORMALS,
        "the normals are divided by the norm of the whole array, or along the wrong axis: each by its own length, "
        "np.linalg.norm(n, axis=-1, keepdims=True)",
        *(terms(partial(_by_norm, of=of)) for of in ("drawn", "left", "columns", "all", "all columns"))),
    row("normal-from-origin", NORMALS,
        "the spheres' normals point away from the origin, not from the sphere's centre: n = (p - center) / radius",
        *_ball(*(f"({p}) / np.linalg.norm({p}, axis=-1, keepdims=True)" for p in ("points", "points - eye")))),
    row("normal-of-another", NORMALS,
        "the spheres' normals point away from another sphere's centre: n = (p - center) / radius, with the centre of "
        "the sphere that was hit",
        *(both(put(blocked=others_hide), terms(partial(_of_other_center, k=k, unit=unit, inside=inside)))
          for k in (-1, 0) for unit, inside in ((True, False), (False, False), (False, True)))),
    row("normal-by-number", NORMALS,
        "the planes' normals are given to the spheres of the same number: in one list of all objects plane k has the "
        "number k + len(spheres)",
        *(both(put(blocked=others_hide), terms(partial(_by_number, inside=dark))) for dark in (True, False))),
    row("normal-to-eye", NORMALS,
        "the spheres' normals are the directions to the eye: n = (p - center) / radius",
        *_ball("(eye - points) / np.linalg.norm(eye - points, axis=-1, keepdims=True)")),
    row("plane-normal-not-unit", NORMALS,
        "the planes' normals are not unit: half_u × half_v has to be divided by its length",
        *normals_at("np.tile(n / np.linalg.norm(n) => np.tile(n")),
    row("one-array", NORMALS,
        "normals and albedo (or points) are kept in one and the same array, so that writing one overwrites the other: "
        "make one for each, a = b = np.zeros(...) makes only one",
        *normals_at(f"{FACED} => n = {PAINT}", f"towards = np => n = {PAINT}\n        towards = np",
                    f"{FACED} => n = points"),
        coloured(lambda x: x.hits.normal)),
    row("normal-axis", NORMALS,
        "one axis of the normals has the wrong sign",
        *_ball(*(f"{BALL} * {signs}" for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1])))),
)  # fmt: skip
