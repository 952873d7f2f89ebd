"""The least of a scene in which a renderer still fails as before, for a bug report.

Each step is tried and kept only if the renderer still fails at a false-alarm rate of RATE, in the same kind: radiance,
silhouettes, depth, normals, NaN, an error. Nothing else is known of it.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from msgspec import structs

from raytwin import twin
from raytwin.compare.finding import KINDS
from raytwin.errors import InputError, MachineError
from raytwin.explain.diagnosis import explain
from raytwin.images.image import Image
from raytwin.progress import Progress, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene import Scene, Sky
from raytwin.scene.mitsuba_file import is_mitsuba
from raytwin.scene.scene import NO_SUN
from raytwin.study.beside_twin import compare_with_twin
from raytwin.study.compare_scene import stage_causes
from raytwin.study.make_reference import find_scene
from raytwin.study.settings import SAMPLES_IF_NOISY, CompareSettings
from raytwin.teach.contract.subject import find_subject
from raytwin.teach.contract.submission import Shown

RATE = 1e-6
"""Probability that a step is kept because of noise alone, in a renderer that is correct."""
SECONDS_IN_ALL = 300.0
"""Seconds after which no further step is tried."""
SMALLEST = 24
"""Pixels of a side below which the picture is not cropped: less shows nobody anything."""
T = TypeVar("T")


class Failure(NamedTuple):
    """How a renderer fails: the kind, and in words; both images, where it made one."""

    kind: str
    reason: str
    images: tuple[Image, Image] | None = None


@dataclass(frozen=True, eq=False)
class Shrunk:
    """What came of it. `removed` does not matter to the failure, `kept` does; `simpler`: what else was reduced.

    `cause`: what the smallest scene says of it, empty where nothing.
    """

    before: Scene
    after: Scene
    rung: str
    failure: Failure
    cause: str
    removed: tuple[str, ...]
    kept: tuple[str, ...]
    simpler: tuple[str, ...]
    evaluations: int
    seconds: float
    stopped: bool

    @property
    def sentences(self) -> tuple[str, ...]:
        """In words: how it fails, what does not matter, what does."""
        said = (
            f"It fails: {self.cause or self.failure.reason}",
            f"Not needed: {', '.join((*self.removed, *self.simpler)) or 'nothing'}.",
            f"Needed: {', '.join(self.kept) or 'nothing'}.",
        )
        late = "Time ran out before every step was tried; raise --time-limit."
        return (*said, late) if self.stopped else said

    def numbers(self) -> dict[str, Any]:
        """As JSON has it."""
        both = {"before": self.before, "after": self.after}
        return {
            "kind": self.failure.kind, "reason": self.failure.reason, "cause": self.cause or None,
            "removed": self.removed, "kept": self.kept, "simpler": self.simpler,
            "objects": {when: len(scene.objects) for when, scene in both.items()},
            "image_size": {when: scene.camera.image_size for when, scene in both.items()},
            "evaluations": self.evaluations, "seconds": self.seconds, "stopped": self.stopped,
        }  # fmt: skip


def shrink(
    path: str | Path, settings: CompareSettings | None = None, *, time_limit: float = SECONDS_IN_ALL,
    progress: Progress = silent, **options: Any,
) -> Shrunk:  # fmt: skip
    """Return the least of the scene in which the subject still fails as it does on the whole.

    `options` are fields of CompareSettings. Raises InputError where it does not fail, or is an image of one scene.
    """
    chosen = replace(settings or CompareSettings(), **options)
    if not time_limit > 0:
        raise InputError("--time-limit", "seconds above 0", time_limit)
    if chosen.subject is None:
        raise InputError("--subject", "is missing. It names the renderer that fails.")
    if is_mitsuba(path):
        raise InputError("`shrink` of a Mitsuba file", "was removed in 0.2.0. Delete shapes from a copy by hand.")
    found = find_scene(path, progress)
    assert isinstance(found, Scene)
    subject = find_subject(chosen.subject, chosen.rung)
    if isinstance(subject, UserRenderer) and isinstance(subject.render, Shown):
        raise InputError("--subject", "a renderer, since an image shows one scene alone", subject.name)
    if chosen.light is not None:
        from raytwin.photos.lighting.light_file import read_light  # with OpenCV

        found = read_light(chosen.light).on(found)
    camera = found.camera
    scene = found.with_camera(camera.resized(*(chosen.size or camera.image_size)))
    return _Search(subject, chosen, time.perf_counter() + time_limit, progress).shrunk(scene)


class _Search:
    """The kind of failure that is to be kept; each look at a scene has random numbers of its own."""

    def __init__(self, subject: Renderer, chosen: CompareSettings, until: float, progress: Progress) -> None:
        self.subject, self.chosen, self.until, self.progress = subject, chosen, until, progress
        self.count, self.stopped, self.failure = 0, False, Failure("", "")

    def shrunk(self, scene: Scene) -> Shrunk:
        """Take the steps one after the other, from the one that saves most."""
        began, first = time.perf_counter(), self._look(scene)
        if first is None:
            raise InputError("--subject", "a renderer that fails on this scene, beyond doubt", "one that does not")
        again = self._look(scene)
        if again is None or again.kind != first.kind:
            then = f"then it failed otherwise: {again.reason}" if again else "then it passed"
            got = f"one that fails by chance: first {first.reason}; {then}"
            raise InputError("--subject", "a renderer that fails alike each time", got)
        self.failure, parts = first, parts_of(scene)

        def only(kept: Iterable[str], small: Scene) -> Scene:
            for name in (name for name in parts if name not in kept):
                small = parts[name](small)
            return small

        whole = self._cropped(scene)
        kept = minimized(list(parts), lambda kept: self._fails(only(kept, whole)))
        small = self._cropped(only(kept, whole))
        sizes = [s.camera.image_size for s in (small, scene)]
        cropped = "most of the picture ({} x {} of {} x {} pixels remain)".format(*sizes[0], *sizes[1])
        images = self.failure.images
        causes = stage_causes(self.subject) or (explain(*images, small, self.subject.rung) if images else ())
        cause = causes[0].text if causes and causes[0].names_a_cause else ""
        removed = tuple(name for name in parts if name not in kept)
        return Shrunk(
            scene, small, self.subject.rung, self.failure, cause, removed, tuple(kept),
            (cropped,) if sizes[0] != sizes[1] else (), self.count, time.perf_counter() - began, self.stopped,
        )  # fmt: skip

    def _fails(self, scene: Scene) -> bool:
        """Whether the subject fails on it as on the whole scene; the last failure is remembered."""
        if time.perf_counter() > self.until:
            self.stopped = True
            return False
        found = self._look(scene)
        if found is None or found.kind != self.failure.kind:
            return False
        self.failure = found
        return True

    def _cropped(self, scene: Scene) -> Scene:
        """Take a half of the picture while one fails, along its longer side first."""
        while (found := next(filter(self._fails, _halves(scene)), None)) is not None:
            scene = found
        return scene

    def _look(self, scene: Scene) -> Failure | None:
        """How it fails beyond doubt."""
        self.progress("shrink", self.count, self.count + 1)
        self.count += 1
        seed, samples, subject = self.chosen.seed + self.count, self.chosen.samples or SAMPLES_IF_NOISY, self.subject
        try:
            made = subject.prepare(scene)(seed)
        except InputError as broken:
            if isinstance(broken, MachineError) or (self.count == 1 and broken.where.startswith("--")):
                raise
            return Failure("error", str(broken))
        try:
            reference = twin.render(
                scene, subject.rung, sampling=subject.sampling, samples=samples, seed=seed, cache=False
            )
            found = compare_with_twin(made, reference, scene, scene.tolerance, false_alarm_rate=RATE)
        except InputError:  # the twin cannot render such a scene
            if self.count == 1:
                raise
            return None
        if found.verdict != "fail":
            return None
        return Failure(KINDS[found.findings[0].kind].failure, found.reasons[0], (made, reference))


def _halves(scene: Scene) -> Iterable[Scene]:
    """The scene seen in each half of its picture, where a half is not too small."""
    camera = scene.camera
    width, height = camera.image_size
    for across, length in sorted(((True, width), (False, height)), key=lambda side: -side[1]):
        size = (-(-length // 2), height) if across else (width, -(-length // 2))
        for first in (0, length // 2) if length >= 2 * SMALLEST else ():
            yield scene.with_camera(camera.grid(first * across, first * (not across), size=size))


def parts_of(scene: Scene) -> dict[str, Callable[[Scene], Scene]]:
    """Name -> what leaves the part out of this scene; the parts can be left out together."""
    things = scene.objects
    labels = scene.names if len(set(scene.names)) == len(things) else scene.numbers
    found = {name: _without(thing) for name, thing in zip(labels, things, strict=True)}
    if any(scene.sun.irradiance):
        found["the sun"] = lambda scene: structs.replace(scene, sun=NO_SUN)
    if scene.sky != Sky():
        found["the sky"] = lambda scene: structs.replace(scene, sky=Sky())
    if any(scene.camera.dist):
        found["the lens's distortion"] = lambda scene: scene.with_camera(structs.replace(scene.camera, dist=()))
    return found


def _without(gone: Any) -> Callable[[Scene], Scene]:
    def edit(scene: Scene) -> Scene:
        spheres, planes = (
            tuple(thing for thing in kind if thing is not gone) for kind in (scene.spheres, scene.planes)
        )
        return structs.replace(scene, spheres=spheres, planes=planes, pyramids=())

    return edit


def minimized(parts: Sequence[T], fails: Callable[[list[T]], bool]) -> list[T]:
    """Return parts, in their order, that still fail together, and of which no single one can be left out.

    Delta debugging (Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", 2002). `fails(parts)`
    must hold of all. With n parts of which k must stay it is asked some k log n times at best and n² at worst.

    >>> minimized(range(8), lambda kept: {2, 5} <= set(kept))
    [2, 5]
    """
    kept = list(parts)
    if kept and fails([]):
        return []
    pieces = 2
    while len(kept) > 1:
        pieces = min(pieces, len(kept))
        ends = [round(i * len(kept) / pieces) for i in range(pieces + 1)]
        spans = list(pairwise(ends))
        alone = [kept[a:b] for a, b in spans]
        rest = [kept[:a] + kept[b:] for a, b in spans] if pieces > 2 else []
        if (found := next(filter(fails, alone), None)) is not None:
            kept, pieces = found, 2
        elif (found := next(filter(fails, rest), None)) is not None:
            kept, pieces = found, pieces - 1
        elif pieces == len(kept):
            break
        else:
            pieces = 2 * pieces
    return kept
