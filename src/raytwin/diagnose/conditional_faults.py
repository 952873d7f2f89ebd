"""Mistakes that are tried only where a clue speaks for them, and nothing else explains the pictures.

A channel that is wrong beside others that are right: read from another one. Outlines that are wrong: several rays a
pixel. Scenes that the same process was given before: what has stayed of them.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product

import numpy as np

from raytwin.diagnose.antialiasing import AVERAGED, along_outlines
from raytwin.diagnose.changes import (
    CAMERA,
    LIGHT,
    ORDER,
    OUTPUT,
    Fault,
    behind,
    by_key,
    chain,
    given,
    is_ball,
    offset_by,
    row,
    shown,
)
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import RIGHT, Before, Pipeline, SceneDict, as_dict, replaced
from raytwin.scene import Scene

COLOURS = "red", "green", "blue"
RIGHT_CHANNEL = 0.01
"""A channel counts as right if its wrong pixels are at most this share of the worst channel's."""
BLENDED = 0.03
"""Least share of the pixels beside outlines that is wrong if several rays per pixel are averaged."""


def faults_suggested(samples: Sequence[PixelSample]) -> tuple[Fault, ...]:
    """What the pictures, and the order in which they were asked for, give reason to try."""
    if any(s.view.scene is None for s in samples):
        return ()
    blurred = AVERAGED if along_outlines(samples) > BLENDED else ()
    return (*by_channel(wrong_channels(samples)), *blurred, *stale(samples))


# ------------------------------------------------------------------------------------------ channels


def wrong_channels(samples: Sequence[PixelSample]) -> tuple[int, ...]:
    """The channels that are wrong, where others are right; else none."""
    wrong = np.zeros(3)
    for s in samples:
        if s.wrong.any():
            off = np.abs(s.shown - s.predict(RIGHT)) - s.slack > s.tau
            wrong += (s.weight[:, None] * off).sum(axis=0)
    found = tuple(np.flatnonzero(wrong > RIGHT_CHANNEL * wrong.max()).tolist())
    return found if len(found) < 3 and not any(s.view.points and s.wrong.any() for s in samples) else ()


def by_channel(wrong: Sequence[int]) -> tuple[Fault, ...]:
    """These channels read from another one, in one term or several; or, of one, nothing written in it."""
    made: list[Fault] = []
    for sources in product(range(3), repeat=len(wrong)) if wrong else ():
        if all(a != b for a, b in zip(wrong, sources, strict=True)):
            index = list(range(3))
            for a, b in zip(wrong, sources, strict=True):
                index[a] = b
            said = " and ".join(f"{COLOURS[a]} from {COLOURS[b]}" for a, b in zip(wrong, sources, strict=True))
            made += [_misread(name, said, changes) for name, changes in _terms_by(index)]
    if len(wrong) == 1:
        made.append(row("channel-empty", OUTPUT, f"{COLOURS[wrong[0]]} is zero everywhere: write all three channels",
                        shown(lambda x: np.where(np.arange(3) == wrong[0], 0.0, x))))  # fmt: skip
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
    yield "all that is lit", (chain(albedo, irradiance, sky),)
    yield "the picture", (shown(lambda x: x[..., index]),)


# ------------------------------------------------------------------------------------------ earlier scenes

OFF_SURFACE = offset_by(1e-6)
"""Shadow rays start a little off the surface: another scene's floor lies in this one's."""
EQUALS = by_key(
    *(
        f"np.where(every_t <= np.min(every_t, axis=0) * (1 + 1e-9), {sign}np.arange(len(every_t))[:, None], np.inf)"
        for sign in "+-"
    )
)
"""The nearest; of those as near, such as the floors of several scenes, the first or the last."""
FIRST, LAST, ALL = slice(0, 1), slice(-1, None), slice(None)
LENS, POSE = ("K", "dist"), ("R_cam_board", "t_cam_board")
SHARED = "what all calls share (a list of the class, a default argument, a global) has to be made anew for each scene"
Earlier = Callable[[Before], list[Scene]]


def stale(samples: Sequence[PixelSample]) -> tuple[Fault, ...]:
    """What a process keeps of the scenes that it was given before: all of them, the first, or the one before."""
    stages = tuple(sorted({stage for s in samples for stage, _ in s.view.before.calls}))
    ways = [(stages, False), *([(stages, True), *(((stage,), False) for stage in stages)] if len(stages) > 1 else [])]
    # A scene before which there was none is right.
    lists: list[Earlier] = [partial(_some, stages=some, apart=apart) for some, apart in ways]
    lists = [of for of in lists if not any(s.wrong.any() for s in samples if not of(s.view.before))]
    if not lists or not stages:
        return ()

    def taken(*several: tuple[str, ...], sized: bool = False) -> Iterator[Pipeline]:
        """The first or last earlier scene's values of these names."""
        for part, of, names in product((FIRST, LAST), lists, several):
            yield _from_earlier(partial(_with, names=names), part, of, sized)

    return (
        row("objects-kept", ORDER, f"objects of scenes that were rendered before are still there: {SHARED}",
            *(chain(_from_earlier(partial(_with_objects, kinds=kinds), part, of), order, OFF_SURFACE)
              for part, of in product((ALL, LAST), lists) for kinds in KINDS for order in EQUALS)),
        row("objects-of-earlier", ORDER, f"the objects of a scene that was rendered before are shown: {SHARED}",
            *taken(("things",))),
        row("light-kept", LIGHT, f"the light of a scene that was rendered before is used: {SHARED}",
            *taken(("sun", "sky"), ("sun",), ("sky",))),
        row("camera-kept", CAMERA,
            "the camera of a scene that was rendered before is used, or its rays: what is kept between calls has to be "
            "found by all that it depends on, K and dist too, not by width and height alone",
            *taken((*LENS, *POSE), LENS, POSE, sized=True),
            *(_from_earlier(_with_rays, part, of, sized=True) for part, of in product((FIRST, LAST), lists))),
    )  # fmt: skip


def _some(before: Before, stages: Sequence[str], apart: bool) -> list[Scene]:
    """Earlier scenes of these stages, which share what they keep; or each has its own (`apart`)."""
    if before.stage not in stages:
        return []
    return [one for stage, one in before.calls if (stage == before.stage if apart else stage in stages)]


def _from_earlier(
    change: Callable[[SceneDict, list[SceneDict]], SceneDict], part: slice, of: Earlier, sized: bool = False
) -> Pipeline:
    """The scene as change(scene, some of the earlier ones) makes it; of those of its size if `sized`."""

    def earlier(scene: SceneDict, before: Before) -> SceneDict:
        every = [as_dict(one, scene["rung"] == "shadow") for one in of(before)]
        alike = [one for one in every if (one["width"], one["height"]) == (scene["width"], scene["height"])]
        some = (alike if sized else every)[part]
        return change(scene, some) if some else scene

    return replaced(earlier=lambda _: earlier)


KINDS = (True, False), (True,), (False,)
"""Spheres, planes or both."""


def _with_objects(scene: SceneDict, some: list[SceneDict], kinds: tuple[bool, ...]) -> SceneDict:
    """Objects of the earlier scenes before its own."""
    more = [x for one in some for x in one["things"] if is_ball(x) in kinds]
    return scene | {"things": [*more, *scene["things"]]}


def _with(scene: SceneDict, some: list[SceneDict], names: tuple[str, ...]) -> SceneDict:
    return scene | {name: some[0][name] for name in names}


def _with_rays(scene: SceneDict, some: list[SceneDict]) -> SceneDict:
    """Another camera's directions, from the own eye."""
    eye = -scene["R_cam_board"].T @ scene["t_cam_board"]
    return _with(scene, some, (*LENS, "R_cam_board")) | {"t_cam_board": -some[0]["R_cam_board"] @ eye}
