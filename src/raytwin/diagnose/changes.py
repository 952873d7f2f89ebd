"""What mistakes are made of: a fault, and changes of the textbook that many faults share."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from raytwin.diagnose.predict import Array, Pipeline, SceneDict, replaced, rewritten, slip, slips, written

CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, OUTPUT, SAMPLING = (
    "camera", "solver", "order", "normals", "light", "shadow", "output", "sampling",
)  # fmt: skip
STAGES = (CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, SAMPLING, OUTPUT)
"""From the pixel to the picture: what stands earlier is told first."""
Thing = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Fault:
    """`name` is unique; `sentence` says to a student what is wrong and what is right.

    `alone`: slips that show the fault where a function is tested alone; pictures have `ways` for it.
    """

    name: str
    stage: str
    sentence: str
    ways: tuple[Pipeline, ...]
    alone: tuple[Pipeline, ...] = ()


Ways = dict[str, tuple[Pipeline, ...]]
"""Name of a fault -> the mistakes that make it."""


def row(name: str, stage: str, sentence: str, *ways: Pipeline, alone: tuple[Pipeline, ...] = ()) -> Fault:
    return Fault(name, stage, sentence, ways, alone)


def chain(*ways: Pipeline) -> Pipeline:
    """One mistake after the other."""
    return sum(ways, ())


# ------------------------------------------------------------------------------------------ camera and things


def pixels(*places: str) -> tuple[Pipeline, ...]:
    """Rays through other places in the image: functions of u, v, width and height."""
    return slips("pixel", *(f"return u, v => return {place}" for place in places))


def moved(x: float, y: float) -> Pipeline:
    """Rays that miss their pixels' centres."""

    def change(pixel: Any) -> Any:
        def wrong(*args: Any) -> tuple[Any, Any]:
            u, v = pixel(*args)
            return u + x, v + y

        return wrong

    return replaced(pixel=change)


IN_K = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}


def lens(**numbers: Any) -> Pipeline:
    """Other entries of K, functions of the scene."""

    def camera(scene: SceneDict) -> SceneDict:
        K = scene["K"].copy()
        for name, f in numbers.items():
            K[IN_K[name]] = f(scene)
        return scene | {"K": K}

    return (("camera", camera),)


def posed(*poses: tuple[str, str]) -> tuple[Pipeline, ...]:
    """(the eye in the board's frame, the directions there) as functions of rays, R and t."""
    return slips("to_board", *(f"-R.T @ t => {eye} ;; rays @ R => {turned}" for eye, turned in poses))


def other(f: Callable[[Thing, SceneDict], Thing]) -> Pipeline:
    """Another thing in the place of each."""
    return (("things", lambda scene: scene | {"things": [f(x, scene) for x in scene["things"]]}),)


def is_ball(thing: Thing) -> bool:
    return "radius" in thing


def resized(factor: float) -> Pipeline:
    """Spheres of another radius."""
    return other(lambda x, _: x | {"radius": factor * x["radius"]} if is_ball(x) else x)


def gone(thing: Thing) -> Thing:
    """Out of reach, so that the others keep their numbers."""
    size = {"radius": 1e-9} if is_ball(thing) else {"half_u": np.array([1e-9, 0, 0]), "half_v": np.array([0, 1e-9, 0])}
    return thing | {"center": np.array([0.0, 0.0, -1e9])} | size


# ------------------------------------------------------------------------------------------ intersections and order

sphere, plane = partial(slips, "intersect_sphere"), partial(slips, "intersect_plane")
order, normals_at = partial(slips, "nearest"), partial(slips, "normals_at")
UNIT, POINT = "rays / np.linalg.norm(rays, axis=-1, keepdims=True)", "origins + t[:, None] * directions"
NU, NV = "np.linalg.norm(half_u)", "np.linalg.norm(half_v)"
IN_U, IN_V = "np.abs(q @ half_u) <= half_u @ half_u", "np.abs(q @ half_v) <= half_v @ half_v"
INSIDE, T, MET = f"({IN_U}) & ({IN_V})", "((center - origins) @ n) / (directions @ n)", "inside & (t > 0)"
CROSS_AT = 'n = np.cross(thing["half_u"], thing["half_v"])'
ALONG_Z = '(directions @ scene["R_cam_board"][2])'
"""What unit rays are divided by for z = 1."""
NEAREST = "which, t = nearest(intersect_all(origins, directions, things))"
BALLS = 'np.array([["radius" in x] for x in things])'


def inside(*tests: str) -> tuple[Pipeline, ...]:
    """Rectangles that end elsewhere."""
    return plane(*(f"{INSIDE} => {test}" for test in tests))


def reaching(u: str, v: str) -> str:
    """|q·u| and |q·v| up to these."""
    return f"(np.abs(q @ half_u) <= {u}) & (np.abs(q @ half_v) <= {v})"


def by_key(*keys: str, first: str = "") -> tuple[Pipeline, ...]:
    """The hit of the least key (objects, N) is seen: functions of every_t, number and ball, things,
    eye, directions; `first`: a line."""
    lines = "\n    ".join([
        "every_t = intersect_all(origins, directions, things)",
        "number, ball = np.arange(len(every_t))[:, None], np.array([['radius' in x] for x in things] or [[False]])",
        *([first] if first else []),
        "which, _ = nearest(np.where(np.isfinite(every_t), KEY, np.inf))",
        "t = np.where(which >= 0, every_t[which, np.arange(len(which))], np.inf)",
    ])  # fmt: skip
    return tuple(slip("met", (NEAREST, lines.replace("KEY", key))) for key in keys)


def in_shadow_test(change: Pipeline) -> Pipeline:
    """For shadow rays alone: the eye sees what it should."""
    return replaced(sun_visible=lambda f: rewritten(f, intersect_all=written(change)["intersect_all"]))


def only_seen(change: Pipeline) -> Pipeline:
    """For the eye's rays alone: shadow rays meet what they should."""
    return chain(change, in_shadow_test(()))


# ------------------------------------------------------------------------------------------ light

shade, shadow = partial(slips, "shade"), partial(slips, "sun_visible")
COS = "np.sum(normals * to_light, axis=-1, keepdims=True)"
CLAMPED, SUN, SUM = (
    f"np.maximum(0, {COS})",
    "albedo / np.pi * irradiance * cosine",
    ("albedo / np.pi * irradiance * cosine + albedo * sky"),
)
ON_PLANE = f"~{BALLS}[which]"
SHADED, MIXED, ASKED = "    lit = shade(", "    picture[hit] = ", 'sun_visible(points, normals, which, sun["to_light"]'


def unit(v: str) -> str:
    return f"({v}) / np.linalg.norm({v}, axis=-1, keepdims=True)"


def before_shading(*lines: str) -> Pipeline:
    """Other `normals`, `albedo`, `to_light`, `irradiance`, `sky` for shading; `sun` for shadows."""
    return slip("radiance", (SHADED, "".join(f"    {line}\n" for line in lines) + SHADED))


def mixed(*lines: str) -> Pipeline:
    """Other values `lit` and `dark` at points, or another `visible`."""
    return slip("radiance", (MIXED, "".join(f"    {line}\n" for line in lines) + MIXED))


def shading_normals(normals: str, *lines: str) -> Pipeline:
    """Other normals for shading alone."""
    right = (ASKED, ASKED.replace("normals", "right"))
    return chain(before_shading("right = normals", *lines, f"normals = {normals}"), slip("radiance", right))


def lit(to_light: str) -> Pipeline:
    """Another direction to the light, for shading and for shadows; R is the camera's."""
    return chain(half_lit(to_light), before_shading('sun = sun | {"to_light": to_light}'))


def half_lit(to_light: str) -> Pipeline:
    """The same for shading alone: shadows are cast rightly."""
    return before_shading('R, t = scene["R_cam_board"], scene["t_cam_board"]', f"to_light = {to_light}")


def given(**functions: Callable[[Any], Any]) -> Pipeline:
    """Other arguments of `shade`."""

    def wrong(right: Any, points: Any, normals: Any, albedo: Any, to_light: Any, irradiance: Any, sky: Any) -> Any:
        args = {"points": points, "normals": normals, "albedo": albedo, "to_light": to_light,
                "irradiance": irradiance, "sky": sky}  # fmt: skip
        return right(**args | {name: f(args[name]) for name, f in functions.items()})

    return replaced(shade=lambda right: partial(wrong, right))


def behind(*backgrounds: str) -> tuple[Pipeline, ...]:
    """Other backgrounds (3,), functions of scene, sky, sun and things."""
    return slips("radiance", *(f"np.tile(sky, => np.tile({one} + 0 * sky," for one in backgrounds))


others_hide = slip("sun_visible")
"""What faces away from the sun is not in its own shadow: it is dark by n·l alone."""


def where_cast(change: Pipeline) -> Pipeline:
    """What is done in shadow is done where another object casts it: what faces away from the sun is not tested."""
    return chain(others_hide, change)


def with_number(name: str, value: Any, *ways: Pipeline) -> Pipeline:
    """Mistakes whose text calls a number by this name."""
    return chain(*ways, replaced(**{name: lambda _: value}))


OWN_MEETS = slip("sun_visible", ("(own | ~np.isfinite(t[k]))", "~np.isfinite(t[k])"))
OFF_SURFACE = {
    along: chain(
        slip("sun_visible", ("intersect_all(points, ", f"intersect_all(points + offset * {along}, ")), OWN_MEETS
    )
    for along in ("normals", "to_light")
}
NEAR = chain(slip("sun_visible", ("~np.isfinite(t[k])", "~(t[k] < reach)")), slip("sun_visible", (
    "return visible", f"return visible & ({COS}[:, 0] > 0)")))  # fmt: skip


def offset_by(eps: float, along_light: bool = False) -> Pipeline:
    """The shadow ray starts eps metres along the normal (or towards the light), and may meet its own object."""
    return with_number("offset", eps, OFF_SURFACE["to_light" if along_light else "normals"])


def within(limit: float) -> Pipeline:
    """Only what is nearer than this, metres, casts a shadow."""
    return chain(offset_by(1e-7), with_number("reach", limit, NEAR))


def towards(direction: str) -> Pipeline:
    """Shadow rays that go elsewhere."""
    return slip("sun_visible", ("np.tile(to_light, (len(points), 1))", unit(f"({direction})")))


def shown(f: Callable[[Array], Array]) -> Pipeline:
    """Other values, each by itself."""
    return replaced(output=lambda right: lambda x, brightest: f(right(x, brightest)))
