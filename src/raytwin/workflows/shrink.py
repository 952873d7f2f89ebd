"""The least of a scene in which a renderer still fails as before, for a bug report.

Each step is tried and kept only if the verdict is still "fail" at a false-alarm rate of RATE, for the same reason, and
explained by the same cause where one was named. Nothing else is known of the renderer.
"""

import re
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from raytwin import twin
from raytwin.analysis.beside_twin import compare_with_twin
from raytwin.compare import Comparison, compare
from raytwin.compare.comparison import CAUSE
from raytwin.contract.subject import find_subject
from raytwin.contract.submission import Shown
from raytwin.diagnose.diagnosis import Diagnosis, diagnose, view_of
from raytwin.errors import InputError, MachineError
from raytwin.image import Image
from raytwin.progress import Progress, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene import MitsubaScene
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
FIRST, DIAGNOSIS = 8.0, 2.0
"""Processor seconds to search for the cause in the whole scene, and in one that may have another."""
CHANCE = re.compile(r"(?:[A-Za-z]:)?[/\\][^\s'\"]+|0x[0-9a-fA-F]+|[0-9][0-9a-fA-F.:-]*")
"""What an error's message has from one run alone: paths, addresses, times and other numbers."""
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


class Failure(NamedTuple):
    """How a renderer fails: the kind, the reason and the cause in words, and the cause's name."""

    kind: str
    reason: str
    cause: str = ""
    name: str = ""


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
    def sentences(self) -> tuple[str, ...]:
        """In words: how it fails, what does not matter, what does."""
        said = (
            f"It fails: {self.failure.cause or self.failure.reason}",
            f"Not needed: {', '.join((*self.removed, *self.simpler)) or 'nothing'}.",
            f"Needed: {', '.join(self.kept) or 'nothing'}.",
        )
        late = "Time ran out before every step was tried; raise --time-limit."
        return (*said, late) if self.stopped else said

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
        raise InputError("--subject", "is missing. It names the renderer that fails.")
    found = find_scene(path, progress)
    if isinstance(found, MitsubaScene):
        subject: Renderer = subject_of(chosen)
        case: Case = FileScene.begin(found, chosen.size)
    else:
        subject = find_subject(chosen.subject, chosen.rung)
        if chosen.light is not None:
            from raytwin.calib.lighting.light_file import read_light  # with OpenCV

            found = read_light(chosen.light).on(found)
        case = OwnScene.begin(found, subject.rung)
        case = case.resized(*(chosen.size or case.image_size))
    if isinstance(subject, UserRenderer) and isinstance(subject.render, Shown):
        raise InputError("--subject", "a renderer, since an image shows one scene alone", subject.name)
    with tempfile.TemporaryDirectory() as folder:
        return _Search(subject, chosen, time_limit, Path(folder), progress).search(case)


class _Search:
    """The failure that is to be kept, and every scene that was tried."""

    def __init__(
        self, subject: Renderer, chosen: CompareSettings, time_limit: float, folder: Path, progress: Progress
    ) -> None:
        self.subject, self.chosen, self.folder, self.progress = subject, chosen, folder, progress
        self.began, self.limit = time.perf_counter(), time_limit
        self.tried: dict[bytes, bool] = {}
        self.count, self.stopped = 0, False
        self.error: np.ndarray | None = None
        self.wanted = Failure("", "")

    def search(self, case: Any) -> Shrunk:
        """Take the steps one after the other, from the one that saves most."""
        self._begin(case)
        small = self._leave_out(self._smaller(case))
        gone, small = self._fewer_bounces(self._crop(small))
        small = self._crop(self._leave_out(small))
        if small.image_size != case.image_size:
            sizes = (*small.image_size, *case.image_size)
            gone = (*gone, "most of the picture ({} x {} of {} x {} pixels remain)".format(*sizes))
        left, spent = small.parts(), time.perf_counter() - self.began
        removed = tuple(part for part in case.parts() if part not in left)
        return Shrunk(case, small, self.wanted, removed, tuple(left), gone, self.count, spent, self.stopped)

    def _begin(self, case: Any) -> None:
        """Note how the subject fails on the whole scene. Raises InputError where it does not."""
        failure, made, reference = self._look(case)
        if failure is None:
            raise InputError("--subject", "a renderer that fails on this scene, beyond doubt", "one that does not")
        again, *_ = self._look(case)
        if again is None or again.kind != failure.kind:
            then = f"then it failed otherwise: {again.reason}" if again else "then it passed"
            got = f"one that fails by chance: first {failure.reason}; {then}"
            raise InputError("--subject", "a renderer that fails alike each time", got)
        self.wanted, self.tried[case.key] = failure, True
        if made is not None and reference is not None and isinstance(case, OwnScene):
            found = _diagnosed(made, reference, case, FIRST)
            named = found.cause if found else None
            words = stage_causes(self.subject) or (found.words if found and named else ())
            cause = CAUSE.sub("", words[0]) if words else ""
            self.wanted = failure._replace(name=_kind(named.name) if named else "", cause=cause)

    def _fails(self, case: Any) -> bool:
        """Whether the subject fails on it as on the whole scene."""
        if case.key not in self.tried:
            if time.perf_counter() > self.began + self.limit:
                self.stopped = True
                return False
            self.tried[case.key] = self._same(case)
        return self.tried[case.key]

    def _same(self, case: Any) -> bool:
        failure, made, reference = self._look(case)
        if failure is None or failure.kind != self.wanted.kind:
            return False
        if self.wanted.name and made is not None and reference is not None and isinstance(case, OwnScene):
            found = _diagnosed(made, reference, case, DIAGNOSIS)
            return found is not None and found.cause is not None and _kind(found.cause.name) == self.wanted.name
        return True

    def _first(self, cases: Iterable[Any]) -> Any:
        return next((case for case in cases if self._fails(case)), None)

    def _smaller(self, case: Any) -> Any:
        """Halve the resolution, which keeps all that is seen, while that fails."""
        while min(half := tuple(n // 2 for n in case.image_size)) >= COARSEST and self._fails(case.resized(*half)):
            case = case.resized(*half)
        return case

    def _crop(self, case: Any) -> Any:
        """Halve the picture while a half fails, along its longer side first."""
        while (found := self._first(self._halves(case))) is not None:
            case = found
        return case

    def _halves(self, case: Any) -> Iterable[Any]:
        """Both halves along the longer side, then along the other; of each first the one with more of the error."""
        width, height = case.image_size
        for across in (width >= height, width < height):
            length = width if across else height
            if length < 2 * SMALLEST:
                continue
            half, starts = -(-length // 2), [0, length // 2]
            if self.error is not None and self.error.shape == (height, width):
                sums = self.error.sum(axis=0 if across else 1)
                starts.sort(key=lambda a: -float(sums[a : a + half].sum()))
            yield from (case.cropped(a, 0, half, height) if across else case.cropped(0, a, width, half) for a in starts)

    def _leave_out(self, case: Any) -> Any:
        """Leave out every part that the failure does not need."""
        return case.only(minimized(case.parts(), lambda kept: self._fails(case.only(kept))))

    def _fewer_bounces(self, case: Any) -> tuple[tuple[str, ...], Any]:
        """Take the lowest level of light that fails, and say what is gone."""
        if isinstance(case, OwnScene) and not isinstance(self.subject, UserRenderer):
            return (), case  # a method has a level of its own
        found = next(((what, less) for what, less in case.fewer_bounces() if self._fails(less)), None)
        return ((found[0],), found[1]) if found else ((), case)

    def _look(self, case: Any) -> tuple[Failure | None, Image | None, Image | None]:
        """How it fails beyond doubt, and both images; each time with other random numbers."""
        self.progress("shrink", self.count, self.count + 1)
        self.count += 1
        seed, samples = self.chosen.seed + self.count, self.chosen.samples or MANY
        subject, scene = self.subject, case.placed(self.folder)
        if isinstance(case, OwnScene) and isinstance(subject, UserRenderer):
            subject = replace(subject, rung=case.rung)
        try:
            made = subject.prepare(scene)(seed)
        except InputError as broken:
            if isinstance(broken, MachineError) or (self.count == 1 and broken.where.startswith("--")):
                raise
            return Failure(f"no image: {CHANCE.sub('#', broken.got or broken.expected)}", str(broken)), None, None
        try:
            if isinstance(case, FileScene):
                reference = twin.render_mitsuba(scene, samples, seed, cache=False)
                found = compare(made, reference, tolerance=scene.tolerance, false_alarm_rate=RATE)
            else:
                reference = twin.render(
                    scene, subject.rung, sampling=subject.sampling, samples=samples, seed=seed, cache=False
                )
                found = compare_with_twin(made, reference, scene, case.written.tolerance, false_alarm_rate=RATE)
        except InputError:
            if self.count == 1:
                raise
            return None, None, None
        if found.verdict != "fail":
            return None, None, None
        self.error = None
        if made.shape == reference.shape:
            self.error = np.nan_to_num(np.abs(made.mean.astype(float) - reference.mean), nan=0, posinf=0).sum(axis=2)
        return Failure(kind_of(found), found.reasons[0]), made, reference


def kind_of(found: Comparison) -> str:
    """Return what sort of failure the first reason tells."""
    return next((kind for pattern, kind in KINDS if re.search(pattern, found.reasons[0])), "radiance")


def _kind(cause: str) -> str:
    """A cause of one sphere by what is wrong with it: objects are numbered anew as others go."""
    return re.sub("^radius-of-.*", "radius", cause)


def _diagnosed(made: Image, reference: Image, case: OwnScene, seconds: float) -> Diagnosis | None:
    """Return what is wrong; None where nobody can tell."""
    if made.shape != reference.shape or not np.isfinite(made.mean).all():
        return None
    view = view_of(made, reference, case.written.scene, case.rung)
    return diagnose([view], seconds=seconds) if view.scene is not None else None
