"""A subject beside Mitsuba's own render of a Mitsuba file: what `compare_scene` does where the scene is one.

What is only known of raytwin's own scenes is null: the light level, the ledger, causes that need a model of the scene.
"""

from functools import partial
from pathlib import Path

import msgspec

from raytwin import twin
from raytwin.compare import Report, compare
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.twin_renderers import Twin
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene.mitsuba_file import read_mitsuba
from raytwin.study.compare_scene import Result, judged_in_view
from raytwin.study.make_reference import IN_THE_FILE, LEVEL_OF_FILES
from raytwin.study.rounds import render_sides
from raytwin.study.settings import CompareSettings
from raytwin.teach.contract.subject import find_subject

ONLY_MITSUBA_KNOWS = (
    "only Mitsuba knows the light of this scene: no light level, no ledger, and only causes that can spoil any picture"
)


def subject_of(chosen: CompareSettings) -> UserRenderer | Twin:
    """The renderer that is asked for. Raises InputError for one that cannot take a Mitsuba file, and for a light."""
    if chosen.light is not None:
        raise InputError("--light", "a scene of raytwin's own: a Mitsuba file has its light", chosen.light)
    if chosen.size is not None:
        raise InputError("--size", IN_THE_FILE, "{} x {}".format(*chosen.size))
    expected = "a command with {scene} and {out}, FILE.py:FUNCTION, images or twin-*-path-* for a Mitsuba file"
    if not chosen.subject:
        raise InputError("--subject", expected, "nothing: raytwin's tracer cannot render one")
    found = find_subject(chosen.subject, LEVEL_OF_FILES)
    if not isinstance(found, UserRenderer | Twin) or found.rung != LEVEL_OF_FILES:
        raise InputError("--subject", expected, found.name)
    return found


def compare_mitsuba(path: str | Path, chosen: CompareSettings, *, progress: Progress = silent) -> Result:
    """Compare the subject with the render of Mitsuba's own integrator and film; `chosen.rung` has no meaning here."""
    scene, subject, stages = read_mitsuba(path), subject_of(chosen), Stages(progress)
    with stages.stage("backend"):
        backend = twin.activate()
        scene = msgspec.structs.replace(scene, names=twin.named_shapes(scene))

    def reference(samples: int, seed: int) -> Image:
        return twin.render_mitsuba(scene, samples, seed + 1, cache=chosen.cache)  # the twin as subject has `seed`

    judge = partial(compare, tolerance=scene.tolerance, flip=chosen.flip)
    made, rendered, found = render_sides(subject, scene, reference, judge, chosen, stages, noisy=True)
    if found.verdict == "fail":
        from raytwin.explain.diagnosis import explain

        with stages.stage("cause"):
            found = found.because(*explain(made, rendered))
    found = judged_in_view(found, rendered, scene)
    about = {"twin_variant": backend.variant, "tracer_engine": subject.name, "libllvm": backend.libllvm, "solver": None}
    return Result(
        report=Report(scene.name, None, found.saying(ONLY_MITSUBA_KNOWS), dict(stages.seconds), about, None),
        scene=scene,
        tolerance=scene.tolerance,
        test=made,
        reference=rendered,
        settings={
            "subject": subject.name,
            "scene": Path(scene.file).name,
            "twin": "the file's own integrator and film",
            "twin's samples per pixel": str(rendered.samples),
        },
        versions=twin.versions(),
    )
