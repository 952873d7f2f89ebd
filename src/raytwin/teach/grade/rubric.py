"""A rubric in TOML: exercises with their points, partial credit by measured error, limits.

    title = "The paper's pipeline"
    [[exercises]]
    stage = "render"
    scenes = ["single", "overlap"]      # shipped, or in the folder `scenes` beside the rubric
    drawn = 2                           # and two that nobody has seen, drawn anew for each submission
    rung = "shadow"
    points = 30
    credit = [[1e-4, 0.9], [1e-2, 0.5]] # an error of 1e-4 earns 0.9 of the points, of 1e-2 a half, above that nothing
    visibility = "after_due_date"

`raytwin grade starter --rubric` writes a whole one. `stage`: any that `raytwin.check` knows, a walk's lessons too.
"""

import hashlib
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from raytwin.errors import InputError, check_one_of
from raytwin.removed import RUBRIC_KEYS
from raytwin.rungs import RUNGS
from raytwin.scene import Record
from raytwin.scene.toml_json import read_toml, to_record
from raytwin.teach.contract.composed_tracer import NEEDED
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.sandbox.sandbox import Limits

PICTURES = tuple(NEEDED)
"""Stages that take a scene: these can be compared on scenes by name, and on drawn ones."""
NOISELESS_RUNGS = ("lambert", "shadow")
"""Rungs without noise, which drawn scenes are compared on."""

Visibility = Literal["visible", "hidden", "after_due_date"]
Positive = Annotated[float, msgspec.Meta(gt=0)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Exercise(Record, frozen=True):
    """One row: a `stage` tested on its own cases, or a picture on `scenes` by name and on as many `drawn` ones.

    `tolerance`: of the stage's error, or of a picture's, relative to its scale; None: the stage's own, the scene's own.
    A case or scene that passes earns its share of the points whole; one that does not earns what `credit` says of its
    error, interpolated over the error's logarithm: the first row's share below it, nothing above the last. A sampled
    picture that fails earns nothing.
    """

    stage: str
    points: Annotated[float, msgspec.Meta(ge=0)]
    name: str = ""
    scenes: tuple[str, ...] = ()
    drawn: Annotated[int, msgspec.Meta(ge=0, le=100)] = 0
    rung: str = "shadow"
    tolerance: Positive | None = None
    visibility: Visibility = "visible"
    credit: tuple[tuple[Positive, Fraction], ...] = ()

    @property
    def sampled(self) -> bool:
        """Whether its pictures are noisy, and judged by the sequential verdict."""
        return self.stage == "render" and RUNGS[self.rung].noisy

    def share(self, passed: bool, error: float | None) -> float:
        """What one case or scene earns, 0 to 1.

        >>> Exercise("shade", 10, credit=((1e-4, 0.9), (1e-2, 0.5))).share(False, 1e-3)
        0.7
        """
        if passed:
            return 1.0
        if self.sampled or not self.credit or error is None or not math.isfinite(error) or error > self.credit[-1][0]:
            return 0.0
        below = self.credit[0]
        for above in self.credit:
            if error <= above[0]:
                if above[0] == below[0] or error <= below[0]:
                    return below[1]
                x = math.log(error / below[0]) / math.log(above[0] / below[0])
                return round(below[1] + x * (above[1] - below[1]), 6)
            below = above
        return 0.0


class Rubric(Record, frozen=True):
    """`seed`: of the drawn scenes, cases and orders, together with each submission's own content: keep it to yourself.

    `file`: what a submission's Python file is called, where it is one of several. `command`: what runs one that is a
    program: {scene} is the scene as JSON, {out} the image to write. `packages`: what submissions may import beside the
    standard library, NumPy and SciPy, in words for pip, which installs them on Gradescope. `folder`: where the rubric
    lies, with a `reference` of its own if any. `hints`: of a slip that one change of the submission's text undoes, a
    student reads the line (1), what is wrong there (2), what to write (3); 0: nothing is tried. `follow_through`: the
    share of its points that an exercise keeps if it is wrong only by a mistake that another one pays for.
    """

    title: str
    exercises: Annotated[tuple[Exercise, ...], msgspec.Meta(min_length=1)]
    seed: int = 0
    limits: Limits = Limits()
    file: str = "tracer"
    command: str = ""
    packages: tuple[str, ...] = ()
    hints: Annotated[int, msgspec.Meta(ge=0, le=3)] = 2
    follow_through: Fraction = 0.0
    folder: str = "."

    @property
    def points(self) -> float:
        return sum(e.points for e in self.exercises)

    @property
    def stages(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(e.stage for e in self.exercises))

    @property
    def functions(self) -> tuple[str, ...]:
        """What is looked for in a submission: the stages, and what a picture can be made of where one is missing."""
        return tuple(dict.fromkeys([*self.stages, *(part for s in self.stages for part in NEEDED.get(s, ()))]))

    @property
    def questions(self) -> tuple[Any, ...]:
        """What decides the answers and what is found of them: all other keys are arithmetic with stored results."""
        exercises = [(e.stage, e.scenes, e.drawn, e.rung, e.tolerance) for e in self.exercises]
        return exercises, self.limits, self.file, self.command, self.packages, self.hints

    def seed_of(self, content: bytes) -> int:
        """Return a submission's seed, which nobody without the rubric's own can compute."""
        total = hashlib.sha256(f"{self.seed} ".encode() + content).digest()
        return int.from_bytes(total[:4], "little")


READY = Path(__file__).with_name("rubric.toml")
"""A whole rubric for the paper's pipeline, to be copied and changed."""


def read_rubric(path: str | Path) -> Rubric:
    """The rubric of a TOML file, or an InputError that names the field."""
    path = Path(path)
    data = read_toml(path)
    if "folder" in data:
        raise InputError(f"{path}: folder", "is no known key.")
    rows = data.get("exercises")
    for table in (data, data.get("limits"), *(rows if isinstance(rows, list) else ())):
        for name in RUBRIC_KEYS.keys() & table if isinstance(table, dict) else ():
            raise InputError(f"{path}: {name}", f"was removed in 0.2.0. {RUBRIC_KEYS[name]}")
    rubric = to_record(path, data | {"folder": str(path.parent)}, Rubric)
    named = []
    for i, exercise in enumerate(rubric.exercises):
        _check(f"{path}: exercises[{i}]", exercise)
        named.append(msgspec.structs.replace(exercise, name=exercise.name or _name(exercise)))
    names = [e.name for e in named]
    if twice := next((n for n in names if names.count(n) > 1), None):
        raise InputError(f"{path}: exercises: name", "names that differ", f"{twice!r} twice")
    return msgspec.structs.replace(rubric, exercises=tuple(named))


def _check(where: str, e: Exercise) -> None:
    check_one_of(f"{where}.stage", e.stage, LESSONS)
    check_one_of(f"{where}.rung", e.rung, RUNGS)
    if e.rung not in NOISELESS_RUNGS and not (RUNGS[e.rung].noisy and e.stage == "render" and e.scenes and not e.drawn):
        raise InputError(
            f"{where}.rung", f"one of {', '.join(NOISELESS_RUNGS)}, or for render of named scenes sky or path", e.rung
        )
    if e.stage not in PICTURES and (e.scenes or e.drawn):
        raise InputError(f"{where}.scenes", f"none: {e.stage} has cases of its own", e.scenes or e.drawn)
    errors = [row[0] for row in e.credit]
    if errors != sorted(errors):
        raise InputError(f"{where}.credit", "rows by rising error", errors)


def _name(e: Exercise) -> str:
    of = ", ".join([*e.scenes, *([f"{e.drawn} drawn"] if e.drawn else [])])
    return f"{e.stage} ({e.rung}: {of})" if of and e.stage == "render" else f"{e.stage} ({of})" if of else e.stage
