"""What a rubric asks of one submission: cases of functions, and scenes with their pictures, drawn from the seed."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from raytwin.compare import Comparison
from raytwin.errors import InputError
from raytwin.explain.draw_scene import DRAWN_SIZE, LARGER, draw_scene
from raytwin.explain.pixel_sample import traced_once
from raytwin.images.image import Image
from raytwin.renderers import references
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Scene, Sphere, Tolerance
from raytwin.teach.contract.stage import Case
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.rubric import Exercise, Rubric
from raytwin.teach.sandbox.sandbox import Answer

INSIDE = (60, 44)
"""Pixels of a scene that is seen from inside a sphere: little is to be seen."""


@dataclass(eq=False)
class Question:
    """One call: its exercise and case, and for a picture its scene; `drawn`: from the seed, so nobody has stored it.

    `answer`: filled in by the call. `made_of`: see `made_of`. `reference`: of a picture at a sampled light level, which
    `verdict`, filled in by the calls, is about.
    """

    exercise: Exercise
    case: Case
    scene: Scene | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    answer: Answer = field(default_factory=Answer)
    made_of: str = ""
    drawn: bool = False
    reference: Image | None = None
    verdict: Comparison | None = None


def questions_of(rubric: Rubric, seed: int) -> Iterator[Question]:
    """Yield every call of the rubric. Raises InputError where a scene has no reference."""
    for number, exercise in enumerate(rubric.exercises):
        own = seed + 1000 * number
        if not (exercise.scenes or exercise.drawn):
            yield from (Question(exercise, case) for case in LESSONS[exercise.stage].cases(own))
        for name in exercise.scenes:
            yield _reference_question(rubric, exercise, name)
        for i in range(exercise.drawn):
            scale = LARGER if exercise.stage == "render" and i % 2 else 1.0
            scene = draw_scene(own + i, INSIDE if exercise.inside else DRAWN_SIZE, f"random scene {i + 1}", scale)
            if exercise.inside:
                scene = _around_eye(scene)
            right = np.asarray(traced_once(scene, exercise.rung).mean, float)
            yield replace(_picture_question(exercise, scene, right, Tolerance()), drawn=True)


def _around_eye(scene: Scene) -> Scene:
    """The scene within one more sphere, which holds the eye and what is near."""
    camera = scene.camera
    eye = -np.transpose(camera.R_cam_board) @ camera.t_cam_board
    x, y, z = (0.5 * eye).tolist()
    wall = Sphere((x, y, z), 0.9 * float(np.linalg.norm(eye)), (0.7, 0.55, 0.8))
    return msgspec.structs.replace(scene, name=f"{scene.name}, from inside", spheres=(*scene.spheres, wall))


def _reference_question(rubric: Rubric, exercise: Exercise, name: str) -> Question:
    found = _load_reference(reference_path(rubric, name, exercise.rung))
    asked = _picture_question(exercise, found.origin(), np.asarray(found.image.mean, float), found.tolerance)
    return replace(asked, reference=found.image) if exercise.sampled else asked


def reference_path(rubric: Rubric, name: str, rung: str) -> Path:
    """Return the reference beside the rubric, or the shipped one: it has a named scene's camera and picture."""
    own = references.path_of(Path(rubric.folder) / "reference", name, rung)
    return own if own.is_file() else references.path_of(references.SHIPPED, name, rung)


def references_of(rubric: Rubric, file: Path) -> list[tuple[str, str, Path]]:
    """Return (scene, rung, reference) of all named scenes, each read once.

    Raises InputError, which names the field of the rubric's file, where a reference is missing or of a scene that a
    submission cannot be called with.
    """
    found = []
    for number, exercise in enumerate(rubric.exercises):
        for name in exercise.scenes:
            path = reference_path(rubric, name, exercise.rung)
            try:
                as_arrays(_load_reference(path).origin(), exercise.rung)
            except InputError as error:
                raise error.at(f"{file}: exercises[{number}].scenes: ") from None
            found.append((name, exercise.rung, path))
    return found


@functools.cache
def _load_reference(path: Path) -> references.Reference:
    return references.load(path)


def _picture_question(exercise: Exercise, scene: Scene, picture: np.ndarray, tolerance: Tolerance) -> Question:
    arguments = as_arrays(scene, exercise.rung)
    if exercise.stage == "hit_points":
        picture = np.asarray(LESSONS["hit_points"].reference(arguments))
    if exercise.tolerance is not None:
        tolerance = msgspec.structs.replace(tolerance, p999_abs=exercise.tolerance)
    case = Case(
        f"{scene.name}, {exercise.rung}" if exercise.stage == "render" else scene.name, (arguments,), (picture,)
    )
    return Question(exercise, case, scene, tolerance)
