"""The least of a scene in which a renderer still fails as before, for a bug report.

Each step is tried and kept only if the verdict is still "fail" at a false-alarm rate of RATE, for the same reason, and
explained by the same cause where one was named. Nothing else is known of the renderer.
"""

import re
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from raytwin import twin
from raytwin.analysis.beside_twin import compare_with_twin
from raytwin.compare import Comparison, compare
from raytwin.compare.comparison import CAUSE
from raytwin.contract.subject import find_subject
from raytwin.contract.submission import Shown
from raytwin.diagnose.catalogue import FAULTS
from raytwin.diagnose.diagnosis import Diagnosis, diagnose, view_of
from raytwin.diagnose.parametric_faults import FAMILIES, of_objects
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.progress import Progress, silent
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.twin_renderers import Twin
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene import MitsubaScene, Scene
from raytwin.workflows.compare_mitsuba import subject_of
from raytwin.workflows.compare_scene import stage_causes
from raytwin.workflows.delta_debugging import minimized
from raytwin.workflows.make_reference import find_scene
from raytwin.workflows.settings import MANY, CompareSettings
from raytwin.workflows.shrink_mitsuba import FileScene
from raytwin.workflows.shrink_scene import OwnScene

RATE = 1e-6
"""Probability that a step is kept because of noise alone, in a renderer that is right."""
SECONDS_IN_ALL = 300.0
"""Seconds after which no further step is tried."""
SMALLEST = 24
"""Pixels of a side below which the picture is not cropped: less shows nobody anything."""
COARSEST = 90
"""Pixels of a side below which the resolution is not lowered."""
FIRST = 8.0
"""Processor seconds to search for the cause in the whole scene."""
DIAGNOSIS = 2.0
"""Seconds to search for the cause in a scene that may have another."""


DIGITS = 1, 2, 3
"""Significant digits that numbers are rounded to, the roundest first."""
KINDS = (
    (r"see another object", "other objects are seen"),
    (r"^depth:", "depth"),
    (r"^normal", "normals"),
    (r"not a number|NaN", "not a number"),
    (r"infinite", "infinite values"),
    (r"negative", "negative values"),
    (r"all black", "all black"),
    (r"has the shape|is no array|holds |pixels, the reference", "no such image"),
)
"""A pattern in a reason -> what kind of failure it tells; all others are errors of radiance."""

Case = OwnScene | FileScene
C = TypeVar("C", OwnScene, FileScene)


class Failure(NamedTuple):
    """How a renderer fails: the kind, the reason and the cause in words, the causes' names, and the picture's error."""

    kind: str
    reason: str
    cause: str = ""
    causes: tuple[str, ...] = ()
    error: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Shrunk:
    """What came of it. `removed` does not matter to the failure, `kept` does; `simpler`: what else was reduced."""

    before: Case
    after: Case
    failure: Failure
    removed: tuple[str, ...]
    kept: tuple[str, ...]
    simpler: tuple[str, ...]
    evaluations: int
    seconds: float
    stopped: bool

    @property
    def name(self) -> str:
        """The name of the scene that was begun with."""
        return self.before.scene.name if isinstance(self.before, FileScene) else self.before.written.name

    @property
    def file_name(self) -> str:
        """What the small scene is written as."""
        return "scene.xml" if isinstance(self.after, FileScene) else "scene.toml"

    @property
    def rung(self) -> str:
        """The level of light at which it fails; empty for a Mitsuba file."""
        return "" if isinstance(self.after, FileScene) else self.after.rung

    @property
    def sentences(self) -> tuple[str, ...]:
        """In words: how it fails, what does not matter, what does."""
        gone = ", ".join((*self.removed, *self.simpler)) or "nothing"
        said = [
            f"It fails: {self.failure.cause or self.failure.reason}",
            f"Not needed: {gone}.",
            f"Needed: {', '.join(self.kept) or 'nothing'}.",
        ]
        late = ("Time ran out before every step was tried; raise --time-limit.",) if self.stopped else ()
        return (*said, *late)

    def numbers(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "kind": self.failure.kind, "reason": self.failure.reason, "cause": self.failure.cause or None,
            "removed": self.removed, "kept": self.kept, "simpler": self.simpler,
            "objects": {"before": self.before.count, "after": self.after.count},
            "image_size": {"before": self.before.image_size, "after": self.after.image_size},
            "evaluations": self.evaluations, "seconds": self.seconds, "stopped": self.stopped,
        }  # fmt: skip


def shrink(
    path: str | Path,
    settings: CompareSettings | None = None,
    *,
    time_limit: float = SECONDS_IN_ALL,
    progress: Progress = silent,
    **options: Any,
) -> Shrunk:
    """Return the least of the scene in which the subject still fails as it does on the whole.

    `options` are fields of CompareSettings. Raises InputError where it does not fail, or is an image of one scene.
    """
    chosen = replace(settings or CompareSettings(), **options)
    if not time_limit > 0:
        raise InputError("--time-limit", "seconds above 0", time_limit)
    if chosen.subject is None:
        raise InputError("--subject", "the renderer that fails", "nothing")
    found = find_scene(path, progress)
    if isinstance(found, MitsubaScene):
        return _shrunk(FileScene.begin(found, chosen.size), subject_of(chosen), chosen, time_limit, progress)
    subject = find_subject(chosen.subject, chosen.rung)
    if chosen.light is not None:
        from raytwin.calib.lighting.light_file import read_light  # with OpenCV

        found = read_light(chosen.light).on(found)
    if chosen.size is not None:
        found = found.with_camera(found.scene.camera.resized(*chosen.size))
    return _shrunk(OwnScene.begin(found, subject.rung), subject, chosen, time_limit, progress)


def _shrunk(case: C, subject: Renderer, chosen: CompareSettings, time_limit: float, progress: Progress) -> Shrunk:
    if isinstance(subject, UserRenderer) and isinstance(subject.render, Shown):
        raise InputError("--subject", "a renderer, since an image shows one scene alone", subject.name)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        search = _Search(subject, chosen, began + time_limit, Path(folder), progress)
        failure = search.begin(case)
        small: C = search.leave_out(search.smaller(case))
        less: _Less[C] = search.fewer_bounces(search.crop(small))
        small = search.round_off(less.case)
        small = search.crop(search.leave_out(small))
    left = small.parts()
    simpler: tuple[str, ...] = less.gone
    if small.image_size != case.image_size:
        sizes = (*small.image_size, *case.image_size)
        simpler = (*simpler, "most of the picture ({} x {} of {} x {} pixels remain)".format(*sizes))
    return Shrunk(
        case,
        small,
        failure,
        removed=tuple(part for part in case.parts() if part not in left),
        kept=tuple(left),
        simpler=simpler,
        evaluations=search.count,
        seconds=time.perf_counter() - began,
        stopped=search.stopped,
    )


@dataclass(frozen=True)
class _Less(Generic[C]):
    """A simpler case, and what was taken out of it."""

    case: C
    gone: tuple[str, ...] = ()


class _Search:
    """The failure that is to be kept, and every scene that was tried."""

    def __init__(
        self, subject: Renderer, chosen: CompareSettings, deadline: float, folder: Path, progress: Progress
    ) -> None:
        self.subject, self.chosen, self.deadline, self.folder, self.progress = (
            subject,
            chosen,
            deadline,
            folder,
            progress,
        )
        self.tried: dict[bytes, Failure | None] = {}
        self.count, self.stopped = 0, False
        self.wanted = Failure("", "")
        self.names: dict[str, str] = {}

    def begin(self, case: Case) -> Failure:
        """Note how the subject fails on the whole scene. Raises InputError where it does not."""
        failure, made, reference = self._look(case)
        if failure is None:
            raise InputError("--subject", "a renderer that fails on this scene, beyond doubt", "one that does not")
        self.wanted = failure
        if made is not None and reference is not None and isinstance(case, OwnScene):
            found = _diagnosed(made, reference, case, seconds=FIRST)
            named = tuple(cause.name for cause in found.causes) if found else ()
            words = stage_causes(self.subject) or (found.words if found and found.causes else ())
            self.wanted = failure._replace(causes=named, cause=CAUSE.sub("", words[0]) if words else "")
            self.names = dict(zip(case.labels, case.written.scene.numbers, strict=True))
        self.tried[case.key] = self.wanted
        return self.wanted

    def fails(self, case: Case) -> bool:
        """Whether the subject fails on it as on the whole scene."""
        if case.key not in self.tried:
            if time.perf_counter() > self.deadline:
                self.stopped = True
                return False
            self.tried[case.key] = self._same(case)
        return self.tried[case.key] is not None

    def smaller(self, case: C) -> C:
        """Halve the resolution, which keeps all that is seen, while that fails."""
        while True:
            width, height = (n // 2 for n in case.image_size)
            half = case.resized(width, height)
            if min(width, height) < COARSEST or not self.fails(half):
                return case
            case = half

    def crop(self, case: C) -> C:
        """Halve the picture while a half fails, the half with more of the error first."""
        while True:
            width, height = case.image_size
            across = width >= height
            halves = [h for side in (across, not across) for h in self._halves(case, side)]
            found = next((half for half in halves if self.fails(half)), None)
            if found is None:
                return case
            case = found

    def leave_out(self, case: C) -> C:
        """Leave out every part that the failure does not need."""
        return case.only(minimized(case.parts(), lambda kept: self.fails(case.only(kept))))

    def fewer_bounces(self, case: C) -> "_Less[C]":
        """Take the lowest level of light that fails, and say what is gone."""
        if isinstance(case, OwnScene) and not isinstance(self.subject, UserRenderer):
            return _Less(case)  # a method has a level of its own
        found = next(((what, less) for what, less in case.fewer_bounces() if self.fails(less)), None)
        return _Less(found[1], (found[0],)) if found else _Less(case)

    def round_off(self, case: C) -> C:
        """Round all numbers at once where that still fails; then each as far as it goes."""
        everything = [case.rounded(case.fields(), digits) for digits in DIGITS]
        case = next((one for one in everything if self.fails(one)), case)
        for key in case.fields():
            tried = (case.rounded([key], digits) for digits in DIGITS)
            case = next((one for one in tried if one.key == case.key or self.fails(one)), case)
        return case

    def _halves(self, case: C, across: bool) -> list[C]:
        (width, height), failure = case.image_size, self.tried.get(case.key)
        length = width if across else height
        if length < 2 * SMALLEST:
            return []
        half = -(-length // 2)
        starts = [0, length - half]
        error = failure.error if failure is not None else None
        if error is not None:
            sums = error.sum(axis=0 if across else 1)
            starts.sort(key=lambda a: -float(sums[a : a + half].sum()))
        return [case.cropped(a, 0, half, height) if across else case.cropped(0, a, width, half) for a in starts]

    def _same(self, case: Case) -> Failure | None:
        """How it fails there, where that is as on the whole scene."""
        failure, made, reference = self._look(case)
        if failure is None or failure.kind != self.wanted.kind:
            return None
        if self.wanted.causes and made is not None and reference is not None and isinstance(case, OwnScene):
            wanted = [name for cause in self.wanted.causes if (name := self._called_now(cause, case))]
            found = _diagnosed(made, reference, case, tuple(wanted))
            if not wanted or found is None or wanted[0] not in [cause.name for cause in found.causes]:
                return None
            found = _diagnosed(made, reference, case)  # of all that is known it is still the one that is named
            if found is None or wanted[0] not in [cause.name for cause in found.causes]:
                return None
        return failure

    def _called_now(self, cause: str, case: OwnScene) -> str:
        """A cause of one object by the name that the object has now; empty where it is gone."""
        now = dict(zip(case.labels, case.written.scene.numbers, strict=True))
        for label, name in self.names.items():
            if cause.endswith(f"-{name}"):
                return cause.removesuffix(name) + now[label] if label in now else ""
        return cause

    def _look(self, case: Case) -> tuple[Failure | None, Image | None, Image | None]:
        """How it fails beyond doubt, and both images; each time with other random numbers."""
        self.progress("shrink", self.count, self.count + 1)
        self.count += 1
        seed, samples = self.chosen.seed + self.count, self.chosen.samples or MANY
        scene = case.placed(self.folder)
        subject = self.subject
        if isinstance(case, OwnScene) and isinstance(subject, UserRenderer):
            subject = replace(subject, rung=case.rung)
        try:
            made = prepared(subject, scene)(seed)
        except InputError as broken:
            if broken.expected == "a program that runs" or (self.count == 1 and broken.where.startswith("--")):
                raise
            return Failure(f"no image: {re.sub(r'[0-9.]+', '#', broken.got)}", str(broken)), None, None
        try:
            if isinstance(scene, MitsubaScene):
                reference = twin.render_mitsuba(scene, samples, seed, cache=False)
                found = compare(made, reference, tolerance=scene.tolerance, false_alarm_rate=RATE)
            else:
                reference = twin.render(
                    scene, subject.rung, sampling=subject.sampling, samples=samples, seed=seed,
                    cache=False,
                )  # fmt: skip
                tolerance = case.written.tolerance if isinstance(case, OwnScene) else None
                found = compare_with_twin(made, reference, scene, tolerance, false_alarm_rate=RATE)
        except InputError:
            if self.count == 1:
                raise
            return None, None, None
        if found.verdict != "fail":
            return None, None, None
        error = None
        if made.shape == reference.shape:
            error = np.nan_to_num(np.abs(made.mean.astype(float) - reference.mean), nan=0, posinf=0).sum(axis=2)
        return Failure(kind_of(found), found.reasons[0], error=error), made, reference


def prepared(subject: Renderer, scene: Scene | MitsubaScene) -> Call:
    """What renders the scene. Raises InputError where the subject cannot take a Mitsuba file."""
    if isinstance(scene, Scene):
        return subject.prepare(scene)
    if not isinstance(subject, UserRenderer | Twin):
        raise InputError("--subject", "a renderer of Mitsuba files", subject.name)
    return subject.prepare(scene)


def kind_of(found: Comparison) -> str:
    """Return what sort of failure the first reason tells."""
    return next((kind for pattern, kind in KINDS if re.search(pattern, found.reasons[0])), "radiance")


def _diagnosed(
    made: Image,
    reference: Image,
    case: OwnScene,
    names: tuple[str, ...] = (),
    seconds: float = DIAGNOSIS,
) -> Diagnosis | None:
    """Return what is wrong, of these mistakes alone where the catalogue has them all; None where nobody can tell."""
    if made.shape != reference.shape or not np.isfinite(made.mean).all():
        return None
    view = view_of(made, reference, case.written.scene, case.rung)
    if view.scene is None:
        return None
    faults = tuple(fault for fault in FAULTS if fault.name in names)
    families = tuple(f for f in (*FAMILIES, *of_objects(view.scene)) if f.name in names)
    if names and len(faults) + len(families) == len(names):
        return diagnose([view], faults=faults, families=families, most=len(names), seconds=seconds)
    return diagnose([view], seconds=seconds)
