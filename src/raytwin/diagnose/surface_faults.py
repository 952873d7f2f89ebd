"""Mistakes in normals."""

from functools import lru_cache
from typing import Any

import numpy as np

from raytwin.diagnose.changes import (
    BALLS,
    COS,
    CROSS_AT,
    NORMALS,
    ON_PLANE,
    before_shading,
    chain,
    is_ball,
    mixed,
    normals_at,
    others_hide,
    row,
    shading_normals,
    unit,
)
from raytwin.diagnose.predict import RIGHT, Array, Pipeline, SceneDict, replaced, written

SHADOWS = '(scene["rung"] == "shadow")'
FACING = (
    'np.array([np.cross(x["half_u"], x["half_v"]) / np.linalg.norm(np.cross(x["half_u"], x["half_v"])) '
    'if "half_u" in x else np.zeros(3) for x in things])'
)
"""(K, 3): half_u × half_v of planes, made unit; 0 of spheres."""
BACKS_SHADED = mixed(
    f"back = np.sum({FACING}[which] * (eye - points), axis=-1) < 0", f"visible = visible & ~({SHADOWS} & back)"
)
"""Planes that are seen from behind meet themselves on the way to the sun."""
LIT_BEHIND = shading_normals(f"np.where({ON_PLANE} & ({COS} < 0), -normals, normals)")
INSIDE_DARK = mixed(f"visible = visible & ~({SHADOWS} & (np.sum(normals * right, axis=-1) < 0))")
"""Where normals for shading point inwards, shadow rays start inside."""
BY_NUMBER = shading_normals(
    f"np.where({ON_PLANE} | given.any(axis=-1, keepdims=True), given, normals)",
    f"flats, balls = [x for x in {FACING} if x.any()], iter(range(len(things)))",
    "flats = [*flats, *np.zeros((len(things), 3))]",
    f"given = np.array([flats[next(balls)] if ball else np.zeros(3) for ball in {BALLS}[:, 0]])[which]",
    "given = np.where(np.sum(given * (points - eye), axis=-1, keepdims=True) > 0, -given, given)",
)
"""Sphere k has the normal of plane k, and planes have none."""


def turned_by_camera_ray(spheres: bool, inside: bool) -> Pipeline:
    """n·d with d in the camera's axes; `spheres`: theirs, too; `inside`: shadow rays start within, and meet them."""
    kinds = "True" if spheres else ON_PLANE
    made = shading_normals(
        "np.where(away, -own, own)",
        f"own = np.where({ON_PLANE}, {FACING}[which], normals)",
        'd = (points - eye) @ scene["R_cam_board"].T',
        f"away = (np.sum(own * d, axis=-1, keepdims=True) > 0) & {kinds}",
    )
    dark = mixed(f"visible = visible & ~({SHADOWS} & (away & ~({ON_PLANE}))[:, 0])")
    return chain(others_hide, made, *([dark] if inside else []))


def by_origin(sign: int, flat: str) -> str:
    """A plane's normal by n·p; where that is 0, `flat` times the one on the eye's side; 0: chance, not predicted."""
    side = 'np.sum(n * thing["center"], axis=-1, keepdims=True)'
    return f"np.where(np.abs({side}) < 1e-9, {flat} * np.where(towards, n, -n), np.where({sign} * {side} < 0, n, -n))"


def of_other_center(k: int, made_unit: bool) -> Pipeline:
    """Take the normal of the first or last sphere."""
    n = '(points - one["center"]) / one["radius"]'
    one = f"one = ([x for x in things if 'radius' in x] or [dict(center=eye, radius=1.0)])[{k}]"
    return shading_normals(f"np.where({ON_PLANE}, normals, {unit(n) if made_unit else n})", one)


class _Same(dict[str, Any]):
    """A scene that is the same only if it is the same object, so that what is made of it can be kept."""

    def __hash__(self) -> int:  # type: ignore[override]
        return id(self["things"])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self["things"] is other["things"]


def norms(scene: SceneDict, of: str) -> Array:
    """(K, 3): by what each object's normals are divided where a norm is taken of more than one of them.

    `drawn`: of all pixels where a sphere was nearest when it was its turn; `left`: where it is in the end; `columns`:
    of these, axis by axis; `all`, `all columns`: of the whole picture.
    """
    return _norms(_Same(scene))[of]


@lru_cache(maxsize=8)
def _norms(scene: _Same) -> dict[str, Array]:
    things, space = scene["things"], written(RIGHT)
    step = int(np.ceil(np.sqrt(scene["width"] * scene["height"] / 20_000)))
    columns, rows = np.meshgrid(np.arange(0, scene["width"], step), np.arange(0, scene["height"], step))
    rays = space["through"](scene["K"], scene["dist"], columns.ravel(), rows.ravel())
    eye, which, points = space["met"](rays, scene, things)
    directions = rays @ scene["R_cam_board"]
    t = space["intersect_all"](np.tile(eye, (len(rays), 1)), directions, things)
    points = np.where((which >= 0)[:, None], points, 0)
    normals = space["normals_at"](points, which, eye, things)
    made = {name: np.ones((len(things), 3)) for name in ("drawn", "left", "columns")}
    for k, thing in enumerate(things):
        here = which == k
        if is_ball(thing) and here.any():
            made["drawn"][k] = step * np.sqrt((np.isfinite(t[k]) & (t[k] <= t[: k + 1].min(axis=0))).sum())
            made["left"][k] = step * np.sqrt(here.sum())
            made["columns"][k] = np.maximum(step * np.linalg.norm(normals[here], axis=0), 1e-9)
    there = max(int((which >= 0).sum()), 1)
    made["all"] = np.full((len(things), 3), step * np.sqrt(there))
    made["all columns"] = step * np.linalg.norm(normals[which >= 0], axis=0) + np.zeros((len(things), 1))
    return made


PLANES_BY_ORIGIN = (
    "the planes' normals are turned round by n·p, p measured from the board's origin: which side the eye sees is told "
    "by n·d"
)
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


NORMALS_ = (
    row("normal-inward", NORMALS,
        "the spheres' normals point inwards: n = (p - center) / radius, from the centre to the point",
        *_ball('(thing["center"] - points) / thing["radius"]')),
    row("all-normals-inward", NORMALS,
        "the normals point away from the eye, those of planes too: turn them round",
        *normals_at("np.where(towards, n, -n) => np.where(towards, -n, n)")),
    row("plane-normal-turned", NORMALS,
        "the planes' normals point to the side that the eye does not see: turn them round where n·d > 0",
        *flat_normals("np.where(towards, -n, n)")),
    row("plane-normal-fixed", NORMALS,
        "the planes' normals are half_u × half_v whatever side is seen, in shading or where shadow rays start: turn "
        "them round where n·d > 0",
        *flat_normals("n", "-n"), chain(*flat_normals("n"), others_hide, BACKS_SHADED), BACKS_SHADED),
    row("plane-faces-light", NORMALS,
        "planes are lit on both sides at once, their normals turned to the sun, or up: a normal belongs to the side "
        "that the eye sees, and max(0, n·l) is 0 where that is turned away from the sun",
        chain(others_hide, LIT_BEHIND), LIT_BEHIND,
        *flat_normals("np.where(n[:, 2:] < 0, -n, n)")),
    row("plane-normal-by-origin", NORMALS,
        PLANES_BY_ORIGIN,
        *flat_normals(by_origin(1, "0"), by_origin(-1, "0")),
        *flat_normals("np.where(np.sum(n * eye, axis=-1, keepdims=True) < 0, -n, n)")),
    row("plane-normal-up", NORMALS, "the planes' normals are taken for the board's z axis: they are half_u × half_v",
        *flat_normals(UP), *normals_at(f"{CROSS_AT} => n = np.array([0.0, 0.0, 1.0])")),
    row("normal-turned-by-other-ray", NORMALS,
        "normals are turned to the eye by a ray in another frame: in n·d both have to be in the board's",
        *(turned_by_camera_ray(*kinds) for kinds in ((True, False), (True, True), (False, False)))),
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
        *(chain(shading_normals(f"normals / norms(scene, '{of}')[which]"), replaced(norms=lambda _: norms))
          for of in ("drawn", "left", "columns", "all", "all columns"))),
    row("normal-from-origin", NORMALS,
        "the spheres' normals point away from the origin, not from the sphere's centre: n = (p - center) / radius",
        *_ball(*(f"({p}) / np.linalg.norm({p}, axis=-1, keepdims=True)" for p in ("points", "points - eye")))),
    row("normal-of-another", NORMALS,
        "the spheres' normals point away from another sphere's centre: n = (p - center) / radius, with the centre of "
        "the sphere that was hit",
        *(chain(others_hide, of_other_center(k, unit_), *([INSIDE_DARK] if dark else []))
          for k in (-1, 0) for unit_, dark in ((True, False), (False, False), (False, True)))),
    row("normal-by-number", NORMALS,
        "the planes' normals are given to the spheres of the same number: in one list of all objects plane k has the "
        "number k + len(spheres)",
        *(chain(others_hide, BY_NUMBER, *([INSIDE_DARK] if dark else [])) for dark in (True, False))),
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
        before_shading("albedo = normals")),
    row("normal-axis", NORMALS,
        "one axis of the normals has the wrong sign",
        *_ball(*(f"{BALL} * {signs}" for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1])))),
)  # fmt: skip
