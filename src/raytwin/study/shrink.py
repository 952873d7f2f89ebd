"""The least of a scene in which a renderer still fails as before, for a bug report.

A step is kept only if the renderer still fails at FALSE_ALARM_RATE with the same kind of failure: radiance, depth,
silhouettes, normals, NaN, an error. The cause is not looked for.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import structs

from raytwin import twin
from raytwin.compare.finding import KINDS
from raytwin.errors import InputError, MachineError
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene import Scene, Sky
from raytwin.scene.mitsuba_file import is_mitsuba
from raytwin.scene.scene import NO_SUN
from raytwin.study.compare_scene import compare_with_twin, prepared
from raytwin.study.settings import SAMPLES_IF_NOISY, CompareSettings
from raytwin.teach.contract.submission import Shown

FALSE_ALARM_RATE = 1e-6
"""Probability that a step is kept because of noise alone, in a renderer that is correct."""
TIME_LIMIT = 300.0
"""Seconds after which no further step is tried."""
MIN_SIDE = 24
"""Pixels of a side below which the picture is not cropped: too little to recognise anything."""


class Failure(NamedTuple):
    """How a renderer fails: the kind, and in words."""

    kind: str
    reason: str


@dataclass(frozen=True, eq=False)
class Shrunk:
    """The small scene. `removed` does not matter to the failure, `kept` does; `simpler`: what else was reduced."""

    before: Scene
    after: Scene
    rung: str
    failure: Failure
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
            f"It fails: {self.failure.reason}",
            f"Not needed: {', '.join((*self.removed, *self.simpler)) or 'nothing'}.",
            f"Needed: {', '.join(self.kept) or 'nothing'}.",
        )
        late = "Time ran out before every step was tried; raise --time-limit."
        return (*said, late) if self.stopped else said

    def numbers(self) -> dict[str, Any]:
        """As JSON has it."""
        both = {"before": self.before, "after": self.after}
        return {
            "kind": self.failure.kind, "reason": self.failure.reason,
            "removed": self.removed, "kept": self.kept, "simpler": self.simpler,
            "objects": {when: len(scene.objects) for when, scene in both.items()},
            "image_size": {when: scene.camera.image_size for when, scene in both.items()},
            "evaluations": self.evaluations, "seconds": self.seconds, "stopped": self.stopped,
        }  # fmt: skip


def shrink(
    path: str | Path, settings: CompareSettings | None = None, *, time_limit: float = TIME_LIMIT,
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
    job = prepared(path, chosen, Stages(progress))
    if isinstance(job.subject, UserRenderer) and isinstance(job.subject.render, Shown):
        raise InputError("--subject", "a renderer, since an image shows one scene alone", job.subject.name)
    return _Search(job.subject, chosen, time.perf_counter() + time_limit, progress).shrunk(job.scene)


class _Search:
    """The kind of failure that is to be kept; each comparison has random numbers of its own."""

    def __init__(self, subject: Renderer, chosen: CompareSettings, until: float, progress: Progress) -> None:
        self.subject, self.chosen, self.until, self.progress = subject, chosen, until, progress
        self.count, self.stopped, self.failure = 0, False, Failure("", "")

    def shrunk(self, scene: Scene) -> Shrunk:
        """Take the steps one after the other, the one that saves most first."""
        began, looks, parts = time.perf_counter(), [self._look(scene), self._look(scene)], parts_of(scene)
        if (first := looks[0]) is None:
            raise InputError("--subject", "a renderer that fails on this scene, beyond doubt", "one that does not")
        if looks[1] is None or looks[1].kind != first.kind:
            got = f"one that fails by chance: first {first.reason}; then {looks[1].reason if looks[1] else 'it passed'}"
            raise InputError("--subject", "a renderer that fails alike each time", got)
        self.failure = first

        def only(kept: Iterable[str], small: Scene) -> Scene:
            for name in (name for name in parts if name not in kept):
                small = parts[name](small)
            return small

        whole = self._cropped(scene)
        kept = minimized(list(parts), lambda kept: self._fails(only(kept, whole)))
        small = self._cropped(only(kept, whole))
        removed = tuple(name for name in parts if name not in kept)
        left, of = small.camera, scene.camera
        cropped = f"most of the picture ({left.width} x {left.height} of {of.width} x {of.height} pixels remain)"
        simpler = (cropped,) if left.image_size != of.image_size else ()
        seconds = time.perf_counter() - began
        return Shrunk(
            scene, small, self.subject.rung, self.failure, removed, tuple(kept), simpler, self.count, seconds,
            self.stopped,
        )  # fmt: skip

    def _fails(self, scene: Scene) -> bool:
        """Whether the subject fails on it as on the whole scene; the last failure is remembered."""
        if time.perf_counter() > self.until:
            self.stopped = True
            return False
        found = self._look(scene)
        if alike := found is not None and found.kind == self.failure.kind:
            self.failure = found
        return alike

    def _cropped(self, scene: Scene) -> Scene:
        """Take a half of the picture while one fails, along its longer side first."""
        while (found := next(filter(self._fails, _halves(scene)), None)) is not None:
            scene = found
        return scene

    def _look(self, scene: Scene) -> Failure | None:
        """Render both sides with fresh seeds; None unless the subject fails beyond doubt."""
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
            found = compare_with_twin(made, reference, scene, scene.tolerance, false_alarm_rate=FALSE_ALARM_RATE)
        except InputError:  # the twin cannot render such a scene
            if self.count == 1:
                raise
            return None
        if found.verdict != "fail":
            return None
        return Failure(KINDS[found.findings[0].kind].failure, found.reasons[0])


def _halves(scene: Scene) -> Iterable[Scene]:
    """The scene seen in each half of its picture, where a half is not too small."""
    camera = scene.camera
    width, height = camera.image_size
    for across, length in sorted(((True, width), (False, height)), key=lambda side: -side[1]):
        size = (-(-length // 2), height) if across else (width, -(-length // 2))
        for first in (0, length // 2) if length >= 2 * MIN_SIDE else ():
            yield scene.with_camera(camera.grid(first * across, first * (not across), size=size))


def parts_of(scene: Scene) -> dict[str, Callable[[Scene], Scene]]:
    """Name -> what leaves the part out of this scene; the parts can be left out together."""
    labels = scene.names if len(set(scene.names)) == len(scene.objects) else scene.numbers
    edits = (partial(_without, thing) for thing in scene.objects)
    found: dict[str, Callable[[Scene], Scene]] = dict(zip(labels, edits, strict=True))
    if any(scene.sun.irradiance):
        found["the sun"] = lambda scene: structs.replace(scene, sun=NO_SUN)
    if scene.sky != Sky():
        found["the sky"] = lambda scene: structs.replace(scene, sky=Sky())
    if any(scene.camera.dist):
        found["the lens's distortion"] = lambda scene: scene.with_camera(structs.replace(scene.camera, dist=()))
    return found


def _without(gone: Any, scene: Scene) -> Scene:
    spheres, planes = (tuple(thing for thing in kind if thing is not gone) for kind in (scene.spheres, scene.planes))
    return structs.replace(scene, spheres=spheres, planes=planes, pyramids=())


def minimized(parts: Sequence[Any], fails: Callable[[list[Any]], bool]) -> list[Any]:
    """Return parts, in their order, that still fail together, and of which no single one can be left out.

    Leave out all, then each half, quarter and so on of what is left, at last each part, until none can go. `fails`
    must hold of all. With n parts of which k must stay it is asked some 2 k log n times at best and n² at worst.

    >>> minimized(range(8), lambda kept: {2, 5} <= set(kept))
    [2, 5]
    """
    kept, size = list(parts), len(parts)
    while size:
        before, first = kept, 0
        while first < len(kept):
            fewer = kept[:first] + kept[first + size :]
            kept, first = (fewer, first) if fails(fewer) else (kept, first + size)
        size = 0 if size == 1 and kept == before else max(1, size // 2)
    return kept
