"""What mistakes are made of: a fault, and changes of the textbook that many faults share."""

from dataclasses import dataclass
from types import FunctionType
from typing import Any

from raytwin.explain.predict import Pipeline, replaced, slip, written

CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, OUTPUT, SAMPLING = (
    "camera", "solver", "order", "normals", "light", "shadow", "output", "sampling",
)  # fmt: skip
FAULT_STAGES = (CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, SAMPLING, OUTPUT)
"""From the pixel to the picture."""


@dataclass(frozen=True, eq=False)
class Fault:
    """`name` is unique; `sentence` says to a student what is wrong and what is correct.

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


def with_number(name: str, value: Any, slips: Pipeline) -> Pipeline:
    """Slips whose text calls a number by this name."""
    return chain(slips, replaced(**{name: lambda _: value}))


def moved(x: float, y: float) -> Pipeline:
    """Rays that miss their pixels' centres."""
    return slip("pixel", ("return u, v", f"return u + {x!r}, v + {y!r}"))


def read(changed: str) -> Pipeline:
    """Other values of the scene."""
    return slip("read_scene", ("return scene", f"return scene | {{{changed}}}"))


def resized(radius: str) -> Pipeline:
    """Other radii of the spheres x, whose number among the objects is k."""
    things = f'[x | {{"radius": {radius}}} if "radius" in x else x for k, x in enumerate(things)]'
    return slip("read_scene", (", things\n", f", {things}\n"))


def in_shadow(light: str) -> Pipeline:
    """Another value of `dark`, what points show that the sun does not reach."""
    return slip("radiance", ("    picture[hit] = ", f"    dark = {light}\n    picture[hit] = "))


def handed_in(values: str) -> Pipeline:
    """Other values of the picture, each by itself."""
    return slip("hand_in", ("return picture", f"return {values}"))


def off_surface(metres: str, along: str = "normals") -> Pipeline:
    """The shadow ray starts so far from the surface, and may meet its own object."""
    start = slip("sun_visible", ("intersect_all(points, ", f"intersect_all(points + {metres} * {along}, "))
    return chain(start, slip("sun_visible", ("(own | ~np.isfinite(t[k]))", "~np.isfinite(t[k])")))


def offset_by(metres: float, along_light: bool = False) -> Pipeline:
    """Such a start along the normal, or towards the light."""
    return off_surface(repr(metres), "to_light" if along_light else "normals")


NEAR = slip(
    "sun_visible", ("~np.isfinite(t[k])", "~(t[k] < 10 ** p[0])"),
    ("return visible", "return visible & (np.sum(normals * to_light, axis=-1) > 0)"),
)  # fmt: skip
"""Only what is nearer than so many metres casts a shadow."""
others_hide = slip("sun_visible")
"""What faces away from the sun is not in its own shadow: it is dark by n·l alone."""


def in_shadow_test(change: Pipeline) -> Pipeline:
    """For shadow rays alone: the eye sees what it should."""

    def wrong(f: Any) -> Any:
        return FunctionType(f.__code__, {**f.__globals__, "intersect_all": written(change)["intersect_all"]})

    return replaced(sun_visible=wrong)
