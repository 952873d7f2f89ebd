"""The main job: photos -> camera -> a subject beside the twin -> comparison."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec
import numpy as np

from raytwin import twin
from raytwin.compare import Comparison, Report, compare
from raytwin.compare.finding import Finding, notes
from raytwin.explain.ledger import LIGHT_LEFT_OUT, Ledger, make_ledger
from raytwin.images.image import Image
from raytwin.images.photo_files import read_photo
from raytwin.images.stored_precision import rounding_of
from raytwin.photos.find_camera import find_camera
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import PathTraced, Traced, fast_engine
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.rungs import RUNGS
from raytwin.scene import MitsubaScene, Scene, Shape, Tolerance
from raytwin.scene.lens import without_ray
from raytwin.scene.mitsuba_file import is_mitsuba
from raytwin.scene.scene_files import scene_and_photos
from raytwin.scene_folders import find_scene
from raytwin.study.diff_files import Compared
from raytwin.study.rounds import render_sides
from raytwin.study.settings import CompareSettings

if TYPE_CHECKING:
    from raytwin.photos import camera  # with OpenCV, which a scene whose camera is given needs not
    from raytwin.photos.lighting.light_file import WrittenLight
    from raytwin.twin.backend import Backend

RAYS_THROUGH_CENTERS = (
    "expected difference: the tracer sends one ray through each pixel's center, the twin samples the pixel's area "
    "(--sampling center compares like with like); through the centers they agree"
)

TO_CHECK = (
    "R_cam_board and t_cam_board must take the board's frame to OpenCV's camera (x right, y down, z forward). OpenGL, "
    "NeRF and Blender have y and z the other way, and their matrices take the camera's frame to the world"
)
"""What is wrong with most such poses."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Result(Compared):
    """All that `raytwin compare` found on a scene: the subject's image beside its twin's."""

    made_by: ClassVar[str] = "compare_scene"

    scene: Scene | MitsubaScene

    @property
    def subject(self) -> Image:
        return self.test

    @property
    def twin(self) -> Image:
        return self.reference


@dataclass(frozen=True, eq=False)
class Job:
    """A subject on a scene of raytwin's own, and how its camera was found; `engine`: the fastest here."""

    subject: Renderer
    chosen: CompareSettings
    stages: Stages
    path: str | Path | Scene
    scene: Scene
    backend: "Backend"
    light: "WrittenLight | None" = None
    photo: Path | None = None
    calibration: "camera.Calibration | None" = None
    pose: "camera.View | None" = None

    @property
    def engine(self) -> str:
        return fast_engine(self.backend.variant)

    @property
    def alike(self) -> bool:
        """Whether both sides hold the same light: whatever differs is a fault or noise."""
        return (self.subject.rung, self.subject.sampling) == (self.chosen.rung, self.chosen.sampling)

    def twin(self, samples: int, seed: int, like: Renderer | CompareSettings | None = None) -> Image:
        """The twin with the light that was asked for, or with that of another."""
        lit, show = like or self.chosen, self.stages if self.chosen.samples else silent
        return twin.render(
            self.scene, lit.rung, sampling=lit.sampling, samples=samples, seed=seed, cache=self.chosen.cache,
            progress=show,
        )  # fmt: skip


def compare_scene(
    path: str | Path | Scene,
    settings: CompareSettings | None = None,
    *,
    progress: Progress = silent,
    **options: Any,
) -> Result:
    """Compare a subject, by default the hand-written tracer, with its Mitsuba twin on a scene.

    `path`: a scene's folder, scene.toml or name, or a scene made in Python; a Mitsuba file (XML) is a scene too, see
    `compare_mitsuba`. `settings` or `options`: fields of CompareSettings, `compare_scene(path, rung="path",
    engine="drjit32")`. If the twin follows more light than the tracer, and the two agree at the tracer's own level, the
    difference is expected (`differs`), and the ledger says what the further light adds. `progress(stage, done, total)`
    is called as work goes on. Raises InputError for a scene, an option or a subject that is wrong.
    """
    chosen = replace(settings or CompareSettings(), **options)
    if not isinstance(path, Scene) and is_mitsuba(path):
        from raytwin.study.compare_mitsuba import compare_mitsuba

        return compare_mitsuba(path, chosen, progress=progress)
    job = prepared(path, chosen, Stages(progress))
    noisy = RUNGS[chosen.rung].sampled(chosen.sampling)
    judge = partial(compare_with_twin, scene=job.scene, tolerance=job.scene.tolerance, flip=chosen.flip)
    made, reference, found = render_sides(job.subject, job.scene, job.twin, judge, chosen, job.stages, noisy, job.alike)
    return _result(job, made, reference, *_explained(job, made, reference, found))


def compare_with_twin(
    test: Image, reference: Image, scene: Scene, tolerance: Tolerance | None = None, flip: bool = False, **options: Any
) -> Comparison:
    """Compare with the twin's `reference`, whose float32 may err (`twin.settle`). `flip`: with the perceptual metric.

    What the format of the test's file has rounded off is not counted. `options` are further ones of `compare`.
    """
    rounding = rounding_of(test)
    test, said = twin.settle(test, reference, scene)
    shown, half_steps = rounding.shown(reference), (rounding.half, None)
    found = compare(test, shown, tolerance=tolerance or Tolerance(), half_steps=half_steps, flip=flip, **options)
    return found.saying(*said)


def prepared(path: str | Path | Scene, chosen: CompareSettings, stages: Stages) -> Job:
    """Read the scene, find its camera, and wake the backend."""
    subject, light = _subject(chosen), None
    if chosen.light is not None:
        from raytwin.photos.lighting.light_file import read_light

        light = read_light(chosen.light)
    with stages.stage("calibrate"):
        scene, photo, calibration, pose = find_camera(path, chosen.photo, stages)
    if light is not None:
        scene = light.on(scene)
    with stages.stage("backend"):
        backend = twin.activate()
    if chosen.size is not None:
        scene = scene.with_camera(scene.camera.resized(*chosen.size))
    return Job(subject, chosen, stages, path, scene, backend, light, photo, calibration, pose)


def _result(job: Job, made: Image, reference: Image, comparison: Comparison, ledger: Ledger | None) -> Result:
    """The record of all that was found, the objects drawn into the photo with it."""
    subject, chosen, scene = job.subject, job.chosen, job.scene
    picture, augmented = _photos(job)
    of_subject = subject.name if chosen.subject else chosen.engine
    backend = {"twin_variant": job.backend.variant, "tracer_engine": of_subject, "libllvm": job.backend.libllvm}
    judged = judged_in_view(comparison, reference, scene)
    report = Report(
        scene.name,
        chosen.rung,
        judged.saying(*_untested(scene, chosen.rung, judged.passed)),
        dict(job.stages.seconds),
        backend | {"solver": chosen.solver},
        ledger.parts if ledger else (),
    )
    return Result(
        scene=scene,
        tolerance=job.scene.tolerance,
        report=report,
        test=made,
        reference=reference,
        photo=picture,
        augmented=augmented,
        calibration=job.calibration,
        pose=job.pose,
        settings={
            "subject": subject.name,
            "light level of the tracer": subject.rung,
            "light level of the twin": chosen.rung,
            "tracer's engine": of_subject,
            "sphere solver": chosen.solver,
            "twin's sampling": chosen.sampling,
            "twin's samples per pixel": str(reference.samples),
            "trim boxes": chosen.trim,
        },
        versions=twin.versions(),
        ledger=ledger,
    )


def _photos(job: Job) -> tuple[np.ndarray | None, np.ndarray | None]:
    """The photo, and with the scene's objects in it where it has the camera's size."""
    if job.photo is None:
        return None, None
    from raytwin.photos import boards
    from raytwin.photos.augment import augment
    from raytwin.photos.lighting.light_file import photo_exposure

    with job.stages.stage("augment"):
        picture = read_photo(job.photo)
        exposure: float | np.ndarray = 1.0
        if job.chosen.size is not None:
            return picture, None
        if job.light is not None and not isinstance(job.path, Scene) and (asked := scene_and_photos(job.path)[1]):
            board = boards.read_board(find_scene(job.path).parent / asked.board)
            exposure = photo_exposure(job.photo, job.scene.camera, board, job.light)
        return picture, augment(picture, job.scene, engine=job.engine, exposure=exposure).pixels


def _subject(chosen: CompareSettings) -> Renderer:
    """What is compared with the twin."""
    if chosen.subject:
        from raytwin.teach.contract.subject import find_subject

        return find_subject(chosen.subject, chosen.tracer_rung or chosen.rung, chosen.sampling)
    if RUNGS[chosen.climbed].noisy:
        return PathTraced(chosen.climbed, chosen.engine, chosen.twin_samples, chosen.sampling, surface=True)
    return Traced(chosen.climbed, chosen.engine, chosen.trim, chosen.solver, surface=True)


def _explained(job: Job, made: Image, reference: Image, comparison: Comparison) -> tuple[Comparison, Ledger | None]:
    """The verdict with its causes, and what each part of the light has to do with the difference."""
    subject, scene, chosen, stages = job.subject, job.scene, job.chosen, job.stages
    own, compared_with = None, reference
    if not job.alike and comparison.verdict != "pass":
        with stages.stage("compare"):
            level = job.twin(chosen.twin_samples, chosen.seed, like=subject)
            own = compare_with_twin(made, level, scene, job.scene.tolerance)
        if subject.rung != chosen.rung:
            compared_with = level
        elif own.verdict == "pass":
            comparison = comparison.judged("differs", *notes([RAYS_THROUGH_CENTERS]), *own.findings)
    on_own_rung = own if compared_with is not reference else None
    failed = (on_own_rung or comparison).verdict == "fail"
    causes: tuple[Finding, ...] = ()
    if failed:
        with stages.stage("cause"):
            causes = stage_causes(subject) or find_causes(made, compared_with, scene, subject.rung)
    ledger = None
    if RUNGS[subject.rung].lit:
        with stages.stage("ledger"):
            faulty = failed and not (causes and causes[0].kind == "rounding")
            ledger = make_ledger(scene, made, subject.rung, job.engine, faulty=faulty)
        if ledger.missing and causes and causes[0].kind != "proved" and RUNGS[subject.rung].noisy:
            causes = (causes[0]._replace(text=f"{causes[0].text}; as if {ledger.missing} were missing"), *causes[1:])
    if on_own_rung is not None:
        comparison = _expected_difference(comparison, on_own_rung, subject.rung, chosen.rung, ledger)
    return comparison.because(*causes), ledger


def find_causes(made: Image, reference: Image, scene: Scene, rung: str) -> tuple[Finding, ...]:
    """Return why `made` is not its reference, on the same rung."""
    from raytwin.explain.diagnosis import explain  # what passes needs no cause
    from raytwin.explain.rounding_cause import rounding_cause

    rounded = rounding_cause(made, reference, scene, rung)
    return rounded or explain(made, reference, scene, rung, rounding_of(made))


def stage_causes(subject: Renderer) -> tuple[Finding, ...]:
    """What the subject's own functions of stages do wrong, each tested alone; nothing where all pass."""
    functions = subject.stages if isinstance(subject, UserRenderer) else {}
    if not functions:
        return ()
    from raytwin.teach.contract.check_function import judge_function
    from raytwin.teach.contract.stage_table import CONTRACT
    from raytwin.teach.contract.subject_process import SubjectFunction

    tested = [judge_function(CONTRACT[name], function) for name, function in functions.items()]
    wrong = [result for result in tested if not result.passed][:3]
    hints = [f.hint() if isinstance(f := functions[r.stage], SubjectFunction) else "" for r in wrong]
    return tuple(
        Finding(r.sureness or "likely", f"{r.stage}: {'; '.join(r.said)}") if r.causes or r.hint
        else Finding("proved", f"{r.stage} fails its own test: {r.sentence}")
        for r in (msgspec.structs.replace(r, hint=hint) for r, hint in zip(wrong, hints, strict=True))
    )  # fmt: skip


def judged_in_view(comparison: Comparison, reference: Image, scene: Scene | MitsubaScene) -> Comparison:
    """The comparison; undecided where it passed although no pixel's center sees any of the scene's objects."""
    surface = reference.surface
    if surface is None or (surface.depth > 0).any() or not scene.names:
        return comparison
    said = "the camera sees no object, so that only the sky is compared"
    if isinstance(scene, Scene):
        said += f": {_where(scene)}. {TO_CHECK}"
    if not comparison.passed:
        return comparison.saying(said)
    return comparison.judged("undecided", *notes([f"undecided: {said}"]), *comparison.findings)


def _where(scene: Scene) -> str:
    """How many objects are behind the camera, and how many beside what it sees."""
    axes, depth = np.asarray(scene.camera.R_cam_board), scene.camera.t_cam_board[2]

    def reach(thing: Shape) -> float:
        return float(axes[2] @ thing.center + depth + thing.extent(axes)[2])

    behind = sum(reach(thing) <= 0 for thing in scene.objects)
    parts = [(behind, "behind it"), (len(scene.objects) - behind, "outside the frame")]
    return " and ".join(f"{n} object{'s are' if n > 1 else ' is'} {place}" for n, place in parts if n)


def _untested(scene: Scene, rung: str, passed: bool) -> Iterator[str]:
    """What the scene cannot show, whatever the two images are; `passed`: they agree."""
    if passed and len(scene.objects) == 1 and RUNGS[rung].shadows:  # every shape is convex
        yield "one object alone: shadows, the sky's occlusion and bounced light stay untested"
    if (lost := without_ray(scene.camera)) is not None:
        yield f"no ray belongs to {100 * lost.mean():.2g} % of the frame, where the lens folds back: black in both"


def _expected_difference(
    whole: Comparison, at_own: Comparison, climbed: str, rung: str, ledger: Ledger | None
) -> Comparison:
    """Return the comparison with a twin that has more light; a bug must not hide behind what is missing on purpose.

    The verdict is that of the tracer beside the twin at the tracer's own level. What the further light adds is the
    difference of two levels of the twin.
    """
    if at_own.verdict != "pass":
        own = (f._replace(text=f"at its own light level, {climbed}: {f.text}") for f in at_own.findings)
        return whole.judged(at_own.verdict, *own)
    less, more = RUNGS[climbed].reach, RUNGS[rung].reach
    expected = f"the tracer stops at {less}; the twin also models {more}"
    if list(RUNGS).index(climbed) > list(RUNGS).index(rung):
        expected = f"the twin stops at {more}; the tracer also models {less}"
    agrees = f"compared at its own level, {climbed}, the tracer agrees with the twin"
    return whole.judged("differs", Finding("expected", expected), *notes([*_left_out(ledger), agrees]))


HIDDEN = {"sun's shadow": "what hides the sun", "sky's occlusion": "what hides the sky"}
"""Parts of the ledger as what a renderer ignores."""


def _left_out(ledger: Ledger | None) -> tuple[str, ...]:
    """What the rung leaves out, in words, the largest part first."""
    rows = [row for row in ledger.parts if row.part in LIGHT_LEFT_OUT and row.share_of_light] if ledger else []
    shares = {HIDDEN.get(row.part, row.part): 100 * (row.share_of_light or 0) for row in rows}
    return tuple(
        f"ignoring {part} makes it {abs(share):.2g} % too {'bright' if share > 0 else 'dark'}"
        for part, share in sorted(shares.items(), key=lambda item: -abs(item[1]))
    )
