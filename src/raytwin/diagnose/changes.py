"""What mistakes are made of: a fault, and changes of the textbook that many faults share."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from raytwin.diagnose.predict import Array, Pipeline, SceneDict, replaced, rewritten, slip, slips, written

CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, OUTPUT, SAMPLING = (
    "camera", "solver", "order", "normals", "light", "shadow", "output", "sampling",
)  # fmt: skip
STAGES = (CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, SAMPLING, OUTPUT)
"""From the pixel to the picture."""
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


def row(name: str, stage: str, sentence: str, *ways: Pipeline) -> Fault:
    return Fault(name, stage, sentence, ways)


def chain(*ways: Pipeline) -> Pipeline:
    """One mistake after the other."""
    return sum(ways, ())


# ------------------------------------------------------------------------------------------ scene and order


def moved(x: float, y: float) -> Pipeline:
    """Rays that miss their pixels' centres."""

    def change(pixel: Any) -> Any:
        def wrong(*args: Any) -> tuple[Any, Any]:
            u, v = pixel(*args)
            return u + x, v + y

        return wrong

    return replaced(pixel=change)


def reading(change: Callable[[SceneDict], SceneDict]) -> Pipeline:
    """The scene, its objects (`things`) too, as the tracer takes it."""

    def wrong(scene: SceneDict, things: list[Thing]) -> tuple[SceneDict, list[Thing]]:
        made = change(scene | {"things": things})
        return made, made["things"]

    return replaced(read_scene=lambda right: lambda *args: wrong(*right(*args)))


def is_ball(thing: Thing) -> bool:
    return "radius" in thing


def in_shadow_test(change: Pipeline) -> Pipeline:
    """For shadow rays alone: the eye sees what it should."""
    return replaced(sun_visible=lambda f: rewritten(f, intersect_all=written(change)["intersect_all"]))


# ------------------------------------------------------------------------------------------ light

MIXED = "    picture[hit] = "


def mixed(*lines: str) -> Pipeline:
    """Other values `lit` and `dark` at points."""
    return slip("radiance", (MIXED, "".join(f"    {line}\n" for line in lines) + MIXED))


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
    "return visible", "return visible & (np.sum(normals * to_light, axis=-1) > 0)")))  # fmt: skip


def offset_by(eps: float, along_light: bool = False) -> Pipeline:
    """The shadow ray starts eps metres along the normal (or towards the light), and may meet its own object."""
    return with_number("offset", eps, OFF_SURFACE["to_light" if along_light else "normals"])


def within(limit: float) -> Pipeline:
    """Only what is nearer than this, metres, casts a shadow."""
    return chain(offset_by(1e-7), with_number("reach", limit, NEAR))


def shown(f: Callable[[Array], Array]) -> Pipeline:
    """Other values, each by itself."""
    return replaced(hand_in=lambda right: lambda picture, brightest: f(right(picture, brightest)))
