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
from raytwin.explain.pixel_sample import SubmittedImage, traced_once
from raytwin.images.image import Image
from raytwin.renderers import references
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Scene, Tolerance
from raytwin.teach.contract.stage import Case
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.result import MarkedPart
from raytwin.teach.grade.rubric import Exercise, Rubric
from raytwin.teach.sandbox.sandbox import Answer


@dataclass(frozen=True, eq=False)
class CheckedPicture:
    """A picture beside what it should be. `got`: if it is wrong and can be shown; `scale`: of its values."""

    part: MarkedPart
    view: SubmittedImage | None = None
    got: np.ndarray | None = None
    scale: float = 1.0


@dataclass(eq=False)
class Question:
    """One call: its exercise and case, and for a picture its scene.

    `answer`: filled in by the call. `made_of`: the functions that the picture is made of, in words. `reference`: of a
    picture at a sampled light level, which `verdict`, filled in by the calls, is about. `checked`: the picture held
    against what it should be; `again`: the one that correct functions gave in place of those that failed.
    """

    exercise: Exercise
    case: Case
    scene: Scene | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    answer: Answer = field(default_factory=Answer)
    made_of: str = ""
    reference: Image | None = None
    verdict: Comparison | None = None
    checked: CheckedPicture | None = None
    again: CheckedPicture | None = None

    @property
    def passed(self) -> bool:
        """Whether the picture, as it was handed in, is correct."""
        return self.checked is not None and self.checked.part.passed

    @property
    def fixed(self) -> bool:
        """Whether the failed functions alone made this picture wrong."""
        return self.again is not None and self.again.part.passed


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
            scene = draw_scene(own + i, DRAWN_SIZE, f"random scene {i + 1}", scale)
            right = np.asarray(traced_once(scene, exercise.rung).mean, float)
            yield _picture_question(exercise, scene, right, Tolerance())


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
