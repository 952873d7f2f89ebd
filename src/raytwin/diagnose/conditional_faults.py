"""Mistakes that are tried only where a clue speaks for them, and nothing else explains the pictures.

Outlines that are wrong: several rays a pixel. Scenes that the same process was given before: what has stayed of them.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product

from raytwin.diagnose.antialiasing import AVERAGED, along_outlines
from raytwin.diagnose.changes import (
    CAMERA,
    LIGHT,
    ORDER,
    Fault,
    by_key,
    chain,
    is_ball,
    offset_by,
    row,
)
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import Before, Pipeline, SceneDict, as_dict, replaced
from raytwin.scene import Scene

BLENDED = 0.03
"""Least share of the pixels beside outlines that is wrong if several rays per pixel are averaged."""


def faults_suggested(samples: Sequence[PixelSample]) -> tuple[Fault, ...]:
    """What the pictures, and the order in which they were asked for, give reason to try."""
    if any(s.view.scene is None for s in samples):
        return ()
    blurred = AVERAGED if along_outlines(samples) > BLENDED else ()
    return (*blurred, *stale(samples))


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
