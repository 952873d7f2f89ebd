"""A subject beside Mitsuba's own render of a Mitsuba file: what `compare_scene` does where the scene is one.

What is only known of raytwin's own scenes is null: the light level, the ledger, causes that need a model of the scene.
"""

from pathlib import Path

from raytwin import files, twin
from raytwin.compare import Report, compare
from raytwin.contract.subject import find_subject
from raytwin.diagnose.diagnosis import explain
from raytwin.errors import InputError
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.twin_renderers import Twin
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene import MitsubaScene
from raytwin.workflows.compare_scene import Result, times_of
from raytwin.workflows.make_reference import LEVEL
from raytwin.workflows.settings import MANY, CompareSettings
from raytwin.workflows.versions import versions

UNKNOWN = (
    "only Mitsuba knows the light of this scene: no light level, no ledger, and only causes that can spoil any picture"
)


def read_sized(path: str | Path, size: tuple[int, int] | None = None) -> MitsubaScene:
    """The file; or, with a film of another `size` (width, height), a copy for programs to read."""
    scene = files.read_mitsuba(path)
    if size is None or size == scene.image_size:
        return scene
    sized = files.with_film(scene, width=size[0], height=size[1])
    return files.write_mitsuba(sized, files.cache_folder() / "mitsuba" / sized.digest)


def subject_of(chosen: CompareSettings) -> UserRenderer | Twin:
    """The renderer that is asked for. Raises InputError for one that cannot take a Mitsuba file, and for a light."""
    if chosen.light is not None:
        raise InputError("--light", "a scene of raytwin's own: a Mitsuba file has its light", chosen.light)
    expected = "a command with {scene} and {out}, FILE.py:FUNCTION, images or twin-*-path-* for a Mitsuba file"
    if not chosen.subject:
        raise InputError("--subject", expected, "nothing: raytwin's tracer cannot render one")
    found = find_subject(chosen.subject, LEVEL)
    if not isinstance(found, UserRenderer | Twin) or found.rung != LEVEL:
        raise InputError("--subject", expected, found.name)
    return found


def compare_mitsuba(path: str | Path, chosen: CompareSettings, *, progress: Progress = silent) -> Result:
    """Compare the subject with the render of Mitsuba's own integrator and film; `chosen.rung` has no meaning here."""
    scene = read_sized(path, chosen.size)
    subject = subject_of(chosen)
    stages = Stages(progress)
    with stages.stage("backend"):
        backend = twin.activate()
    with stages.stage("tracer"):
        made = subject.prepare(scene)(chosen.seed + 1)  # the twin's seed would be the twin's noise
    samples = chosen.samples or MANY
    with stages.stage("twin"):
        reference = twin.render_mitsuba(scene, samples, chosen.seed, cache=chosen.cache, progress=stages)
    with stages.stage("compare"):
        comparison = compare(made, reference, tolerance=scene.tolerance, flip=chosen.flip)
    if comparison.verdict == "fail":
        with stages.stage("cause"):
            comparison = comparison.because(*explain(made, reference))
    comparison = comparison.saying(UNKNOWN)
    about = {"twin_variant": backend.variant, "tracer_engine": subject.name, "libllvm": backend.libllvm, "solver": None}
    return Result(
        scene=scene,
        tolerance=scene.tolerance,
        report=Report(scene.name, None, comparison, dict(stages.seconds), about, None),
        test=made,
        reference=reference,
        times=times_of(stages.seconds, comparison, None),
        settings={
            "subject": subject.name,
            "scene": Path(scene.file).name,
            "twin": "the file's own integrator and film",
            "twin's samples per pixel": str(reference.samples),
        },
        versions=versions(),
    )
