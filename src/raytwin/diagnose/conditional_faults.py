"""Mistakes that are tried only where a clue speaks for them, and nothing else explains the pictures.

A channel that is wrong beside others that are right: read from another one. Outlines that are wrong: several rays a
pixel. Scenes that the same process was given before: what has stayed of them.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any

import msgspec
import numpy as np

from raytwin.diagnose.budget import Budget
from raytwin.diagnose.catalogue import FAULTS
from raytwin.diagnose.changes import (
    CAMERA,
    LIGHT,
    ORDER,
    OUTPUT,
    SAMPLING,
    Fault,
    behind,
    by_key,
    chain,
    given,
    offset_by,
    row,
    shown,
)
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import RIGHT, Before, Pipeline, replaced, rewritten
from raytwin.diagnose.textbook import code_of, slipped
from raytwin.scene import Rectangle, Scene, Shape, Sphere

COLOURS = "red", "green", "blue"
RIGHT_CHANNEL = 0.01
"""A channel is right where no more pixels are wrong than so many of those of the worst one."""
BETWEEN = 0.8
"""Least share of the wrong pixels that lies between what is seen around them."""
ALONG = 0.03
"""Least share of the pixels beside outlines that is wrong if several rays per pixel are averaged."""


def clued(sights: Sequence[PixelSample], budget: Budget) -> tuple[Fault, ...]:
    """What the pictures, and the order in which they were asked for, give reason to try."""
    if any(s.view.scene is None for s in sights):
        return ()
    blurred = averaged() if _along_outlines(sights, budget) else ()
    return (*by_channel(wrong_channels(sights)), *blurred, *stale(sights))


# ------------------------------------------------------------------------------------------ channels


def wrong_channels(sights: Sequence[PixelSample]) -> tuple[int, ...]:
    """The channels that are wrong, where others are right; else none."""
    wrong = np.zeros(3)
    for s in sights:
        if s.wrong.any():
            off = np.abs(s.shown - s.predict(RIGHT)) - s.slack > s.tau
            wrong += (s.weight[:, None] * off).sum(axis=0)
    found = tuple(np.flatnonzero(wrong > RIGHT_CHANNEL * wrong.max()).tolist())
    return found if len(found) < 3 and not any(s.view.points and s.wrong.any() for s in sights) else ()


def by_channel(wrong: Sequence[int]) -> tuple[Fault, ...]:
    """These channels read from another one in one term or several; or, if it is one, by a formula of its own."""
    if not wrong:
        return ()
    made: list[Fault] = []
    for sources in product(range(3), repeat=len(wrong)):
        if all(a != b for a, b in zip(wrong, sources, strict=True)):
            index = list(range(3))
            for a, b in zip(wrong, sources, strict=True):
                index[a] = b
            said = " and ".join(f"{COLOURS[a]} from {COLOURS[b]}" for a, b in zip(wrong, sources, strict=True))
            made += [_misread(name, said, changes) for name, changes in _terms_by(index)]
    if len(wrong) == 1:
        made += _alone(wrong[0])
    return tuple(made)


def _misread(name: str, said: str, changes: tuple[Pipeline, ...]) -> Fault:
    return row(f"channel-of-{name.replace(', ', '-').replace(' ', '-')}", OUTPUT if name == "the picture" else LIGHT,
               f"a channel is read from another one, {said}, in {name} (a slip in a line that was copied): 0, 1, 2 are "
               "red, green, blue in every term", *changes)  # fmt: skip


def _terms_by(index: list[int]) -> Iterator[tuple[str, tuple[Pipeline, ...]]]:
    """Each term, and several at once, with its channels in another order; the sky's for the background, too, or not."""
    irradiance, sky, albedo = (given(**{name: lambda x: x[..., index]}) for name in ("irradiance", "sky", "albedo"))
    (background,) = behind(f"sky[{index}]")
    yield "the irradiance", (irradiance,)
    yield "the irradiance and the sky", (chain(irradiance, sky), chain(irradiance, sky, background))
    yield "the sky", (sky, chain(sky, background))
    yield "the background", (background,)
    yield "the albedo", (albedo,)
    yield "the albedo and the irradiance", (chain(albedo, irradiance),)
    yield "the albedo and the sky", (chain(albedo, sky),)
    yield "all that is lit", (chain(albedo, irradiance, sky),)
    yield "the picture", (shown(lambda x: x[..., index]),)


MIXING = {"bgr", "channels-turned", "grey", "channels-summed", "albedo-channels", "light-colour", "empty"}
"""Faults that are made of several channels, or said of the picture alone."""


def _alone(k: int) -> list[Fault]:
    """A fault of light or output in one channel, the others being right; or nothing in it."""
    made = [row("channel-empty", OUTPUT, f"{COLOURS[k]} is zero everywhere: write all three channels",
                shown(lambda x: np.where(np.arange(3) == k, 0.0, x)))]  # fmt: skip
    for fault in FAULTS:
        ways = tuple(in_channel(way, k) for way in fault.ways if _is_of_values(way))
        if ways and fault.name not in MIXING:
            text = f"in {COLOURS[k]} alone (a slip in one line of three): {fault.sentence}"
            made.append(row(f"{fault.name}-in-one-channel", fault.stage, text, *ways))
    return made


def _is_of_values(way: Pipeline) -> bool:
    names = [name for name, _ in way]
    return 0 < len(names) == len(set(names) & {"shade", "radiance", "output"})


def in_channel(way: Pipeline, k: int) -> Pipeline:
    """The mistakes in one channel alone."""

    def change(right: Any, name: str, what: Any) -> Any:
        wrong = rewritten(right, code=code_of(slipped(name, what))) if isinstance(what, tuple) else what(right)
        return lambda *args: np.where(np.arange(3) == k, wrong(*args), right(*args))

    return tuple((name, partial(change, name=name, what=what)) for name, what in way)


# ------------------------------------------------------------------------------------------ several rays a pixel


def _along_outlines(sights: Sequence[PixelSample], budget: Budget) -> bool:
    """Wrong along outlines, and in the worst picture between what is seen within a pixel's reach."""
    seen = [s for s in sights if not s.view.points]
    edge = sum(float((s.weight * s.edge).sum()) for s in seen)
    if not sum(float((s.weight * s.edge * s.wrong).sum()) for s in seen) > ALONG * edge:
        return False
    worst = max(seen, key=lambda s: float((s.weight * s.wrong).sum()))
    worst = worst.only(worst.wrong)
    grid = _grid(5, -1.0, 1.0)
    rows = [worst.predict(spread(((x, y),))) for x, y in budget.within("several rays a pixel", grid)]
    if len(rows) < len(grid):
        return False
    around = np.stack(rows)
    off = worst.off(np.clip(worst.shown, around.min(axis=0), around.max(axis=0)))
    return float((worst.weight * (off <= 4 * worst.tau)).sum()) > BETWEEN


def _grid(n: int, low: float, high: float) -> tuple[tuple[float, float], ...]:
    places = np.linspace(low, high, n).tolist()
    return tuple((x, y) for y in places for x in places)


def spread(places: Sequence[tuple[float, float]]) -> Pipeline:
    """The mean of rays through several places about the pixel's centre."""
    return replaced(spread=lambda _: places)


def averaged() -> tuple[Fault, ...]:
    """The mean of several rays: spread around the pixel's centre, or from it on."""
    centred = [_grid(n, 0.5 / n - 0.5, 0.5 - 0.5 / n) for n in (2, 3, 4, 5)]
    centred += [_grid(n, -0.5, 0.5) for n in (2, 3, 4, 5)]
    centred += [_grid(2, -1 / 3, 1 / 3), _grid(3, -0.25, 0.25), _grid(3, -1.0, 1.0)]
    centred += [((0.0, 0.0), *_grid(2, -a, a)) for a in (0.25, 0.5)]
    centred += [((-a, 0.0), (a, 0.0), (0.0, -a), (0.0, a)) for a in (0.25, 0.5)]
    centred += [((0.0, 0.0), (-a, 0.0), (a, 0.0), (0.0, -a), (0.0, a)) for a in (0.25, 0.5)]
    centred += [tuple((k * x, k * y) for x, y in ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)))
                for k in (1, -1)]  # fmt: skip
    cornered = [_grid(n, 0.5 / n, 1 - 0.5 / n) for n in (2, 3, 4)] + [_grid(n, 0.0, 1 - 1 / n) for n in (2, 3, 4)]
    cornered += [_grid(2, 0.0, 1.0), _grid(3, 0.0, 1.0)]
    text = "each pixel is the mean of several rays (anti-aliasing), which blends outlines and the edges of shadows"
    right = "here a pixel shows what the one ray through its centre, (u, v), meets"
    return (
        row("averaged-over-pixel", SAMPLING, f"{text}: {right}", *map(spread, centred)),
        row("averaged-from-corner", SAMPLING,
            f"{text}, and the rays are spread to one side of (u, v) as if that were the pixel's corner: {right}",
            *map(spread, cornered)),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------ earlier scenes

OFF_SURFACE = offset_by(1e-6)
"""Shadow rays start a little off the surface: another scene's floor lies in this one's."""
EQUALS = by_key(*(f"np.where(every_t <= np.min(every_t, axis=0) * (1 + 1e-9), {sign}number, np.inf)" for sign in "+-"))
"""The nearest; of those as near, such as the floors of several scenes, the first or the last."""
KINDS: tuple[Any, ...] = ((Sphere, Rectangle), Sphere, Rectangle)
SHARED = "what all calls share (a list of the class, a default argument, a global) has to be made anew for each scene"


def stale(sights: Sequence[PixelSample]) -> tuple[Fault, ...]:
    """What a process keeps of the scenes that it was given before: all of them, the first, or the one before."""
    stages = tuple(sorted({stage for s in sights for stage, _ in s.view.before.calls}))
    ways = [(stages, False), *([(stages, True), *(((stage,), False) for stage in stages)] if len(stages) > 1 else [])]
    # A scene before which there was none is right.
    lists = [partial(_some, stages=some, apart=apart) for some, apart in ways]
    lists = [of for of in lists if not any(s.wrong.any() for s in sights if not of(s.view.before))]
    first, last = slice(0, 1), slice(-1, None)
    kept = [(part, of) for part in (first, last) for of in lists]
    added = [(part, of) for part in (slice(None), last) for of in lists]
    if not lists or not stages:
        return ()
    return (
        row("objects-kept", ORDER, f"objects of scenes that were rendered before are still there: {SHARED}",
            *(chain(_from_earlier(partial(_with_objects, kind=kind), part, of), order, OFF_SURFACE)
              for part, of in added for kind in KINDS for order in EQUALS)),
        row("objects-of-earlier", ORDER, f"the objects of a scene that was rendered before are shown: {SHARED}",
            *(_from_earlier(partial(_for_objects, kind=kind), part, of) for part, of in kept for kind in KINDS)),
        row("albedos-kept", LIGHT,
            f"albedos of scenes that were rendered before are still in the table, before those of this one: {SHARED}",
            *(_from_earlier(partial(_with_albedos, apart=apart), slice(None), of) for of in lists
              for apart in (False, True))),
        row("light-kept", LIGHT, f"the light of a scene that was rendered before is used: {SHARED}",
            *(_from_earlier(partial(_with_lights, names=names), part, of) for part, of in kept
              for names in (("to_light", "irradiance", "sky"), ("to_light", "irradiance"), ("to_light",),
                            ("irradiance",), ("sky",), ("irradiance", "sky")))),
        row("camera-kept", CAMERA, f"the camera of a scene that was rendered before is used: {SHARED}",
            *(_from_earlier(partial(_with_camera, names=names), part, of) for part, of in kept
              for names in (("K", "dist", "R_cam_board", "t_cam_board"), ("K", "dist"), ("K",), ("dist",),
                            ("R_cam_board", "t_cam_board"), ("R_cam_board",), ("t_cam_board",)))),
    )  # fmt: skip


def _some(before: Before, stages: Sequence[str], apart: bool) -> list[Scene]:
    """Earlier scenes of these stages, which share what they keep; or each has its own (`apart`)."""
    if before.stage not in stages:
        return []
    return [one for stage, one in before.calls if (stage == before.stage if apart else stage in stages)]


def _from_earlier(
    f: Callable[[Scene, Sequence[Scene]], Scene], part: slice, of: Callable[[Before], list[Scene]]
) -> Pipeline:
    """The scene as f(scene, some of the earlier ones) makes it."""

    def earlier(scene: Scene, before: Before) -> Scene:
        some = of(before)[part]
        return f(scene, some) if some else scene

    return replaced(earlier=lambda _: earlier)


def _of(scenes: Sequence[Scene], kind: Any) -> tuple[Shape, ...]:
    return tuple(x for one in scenes for x in one.objects if isinstance(x, kind))


def _with_objects(scene: Scene, some: Sequence[Scene], kind: Any) -> Scene:
    return msgspec.structs.replace(scene, objects=(*_of(some, kind), *scene.objects))


def _for_objects(scene: Scene, some: Sequence[Scene], kind: Any) -> Scene:
    own = tuple(x for x in scene.objects if not isinstance(x, kind))
    return msgspec.structs.replace(scene, objects=(*_of(some, kind), *own))


def _with_albedos(scene: Scene, some: Sequence[Scene], apart: bool) -> Scene:
    """One table of all objects, spheres first, or one of each kind (`apart`): an index counts from its beginning."""
    made: list[Shape] = []
    for kinds in ((Sphere,), (Rectangle,)) if apart else (KINDS[0],):
        table = [x.material for one in (*some, scene) for kind in KINDS[1:] for x in _of([one], kind)
                 if isinstance(x, kinds)]  # fmt: skip
        own = [x for kind in KINDS[1:] for x in _of([scene], kind) if isinstance(x, kinds)]
        made += [msgspec.structs.replace(x, material=m) for x, m in zip(own, table, strict=False)]
    return msgspec.structs.replace(scene, objects=tuple(made))


def _with_lights(scene: Scene, some: Sequence[Scene], names: tuple[str, ...]) -> Scene:
    """`names`: of the sun's fields, and "sky"."""
    of_sun = {name: getattr(some[0].sun, name) for name in names if name != "sky"}
    sky = some[0].sky if "sky" in names else scene.sky
    return msgspec.structs.replace(scene, lights=(msgspec.structs.replace(scene.sun, **of_sun), sky))


def _with_camera(scene: Scene, some: Sequence[Scene], names: tuple[str, ...]) -> Scene:
    return scene.with_camera(
        msgspec.structs.replace(scene.camera, **{name: getattr(some[0].camera, name) for name in names})
    )
