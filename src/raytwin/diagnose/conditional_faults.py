"""Mistakes that are tried only where a clue speaks for them, and nothing else explains the pictures.

Outlines that are wrong: several rays a pixel. Scenes that the same process was given before: what has stayed of them.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from itertools import product

import numpy as np

from raytwin.diagnose.changes import CAMERA, LIGHT, ORDER, SAMPLING, Fault, by_key, chain, is_ball, offset_by, row
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


# ------------------------------------------------------------------------------------------ several rays a pixel


def mean_of(places: Iterable[tuple[float, float]]) -> Pipeline:
    """The mean of rays through several places about the pixel's centre."""
    chosen = tuple(places)
    return replaced(spread=lambda _: chosen)


def grid(n: int, low: float, high: float) -> Pipeline:
    """The mean of n x n rays from `low` to `high` in both directions, pixels."""
    return mean_of(product(np.linspace(low, high, n).tolist(), repeat=2))


BLENDS = "each pixel is the mean of several rays (anti-aliasing), which blends outlines and the edges of shadows"
ONE_RAY = "here a pixel shows what the one ray through its centre, (u, v), meets"
AVERAGED = (
    row("averaged-over-pixel", SAMPLING, f"{BLENDS}: {ONE_RAY}",
        *(grid(n, 0.5 / n - 0.5, 0.5 - 0.5 / n) for n in (2, 3, 4)), *(grid(n, -0.5, 0.5) for n in (2, 3))),
    row("averaged-from-corner", SAMPLING,
        f"{BLENDS}, and the rays are spread to one side of (u, v) as if that were the pixel's corner: {ONE_RAY}",
        *(grid(n, 0.5 / n, 1 - 0.5 / n) for n in (2, 3, 4)), *(grid(n, 0.0, 1 - 1 / n) for n in (2, 3, 4)),
        grid(2, 0.0, 1.0)),
)  # fmt: skip


def along_outlines(samples: Sequence[PixelSample]) -> float:
    """The share of the pixels beside outlines that is wrong; of points, which have none, 0."""
    seen = [s for s in samples if not s.view.points]
    edge = sum(float((s.weight * s.edge).sum()) for s in seen)
    return sum(float((s.weight * s.edge * s.wrong).sum()) for s in seen) / edge if edge else 0.0


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
    wrong = [s.view.before for s in samples if s.wrong.any()]
    lists: list[Earlier] = [
        partial(_some, stages={before.stage for before in wrong}, apart=apart)
        for apart in (False, True)[: len({stage for s in samples for stage, _ in s.view.before.calls})]
    ]
    lists = [of for of in lists if all(map(of, wrong))]  # a scene before which there was none is right
    if not lists:
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


def _some(before: Before, stages: Collection[str], apart: bool) -> list[Scene]:
    """The scenes that were given before to whichever stage, or to the same one (`apart`); to other `stages`, none."""
    if before.stage not in stages:
        return []
    return [one for stage, one in before.calls if stage == before.stage or not apart]


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
