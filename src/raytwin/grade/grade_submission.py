"""One submission held to one rubric: (submission, rubric, seed) -> Result. The same function on every machine.

The submission runs in a sandbox and gives arrays; everything else happens here, where none of its code runs: cases and
scenes are made from the seed, numbers held to them, causes named.
"""

import base64
import functools
import hashlib
import io
import itertools
import os
import shlex
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from raytwin import files, references
from raytwin.compare import compare, error_map
from raytwin.compare.scale import scale_of
from raytwin.contract.check_function import judge
from raytwin.contract.composed_tracer import NEEDED, compose, made_of
from raytwin.contract.stage import Case, Function
from raytwin.contract.stage_table import LESSONS
from raytwin.contract.submission import cells
from raytwin.diagnose.diagnosis import Diagnosis, diagnose
from raytwin.diagnose.draw_scene import draw_scene
from raytwin.diagnose.pixel_sample import View, traced_once
from raytwin.diagnose.predict import FIRST, Before
from raytwin.diagnose.tolerance_mask import forgiven
from raytwin.errors import InputError
from raytwin.grade.result import Marked, Part, Picture, Result, Status
from raytwin.grade.rubric import Exercise, Rubric, read_rubric
from raytwin.image import Image
from raytwin.image_input import ENDINGS
from raytwin.renderers.scene_exchange import as_arrays, as_json
from raytwin.sandbox.lock import HELD
from raytwin.sandbox.sandbox import Answer, Code, Sandbox, probe
from raytwin.scene import Scene, Tolerance
from raytwin.viewer import pack

CODE = (".py", ".ipynb")
MOST_VIEWS = 3
"""Wrong pictures of a submission that can be looked at pixel by pixel; of the others there is a small one."""
MOST_PIXELS = 40_000
SAMPLE = 12, 16
LARGER = 6.0
"""Every second drawn scene is so many times as large: a length that is taken for 1 shows."""


class Job(msgspec.Struct, frozen=True):
    """What a worker is given. `key`: of content, rubric, seed and program: a result has it as its name."""

    student: str
    path: str
    rubric: str
    seed: int
    key: str


@dataclass(eq=False)
class _Asked:
    """One call: of the exercise, its case; of a picture its scene, too. `answer`, once there is one.

    `before`: what its process was given earlier.
    """

    exercise: Exercise
    case: Case
    scene: Scene | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    answer: Answer = field(default_factory=Answer)
    before: Before = FIRST
    made_of: str = ""


@dataclass(frozen=True, eq=False)
class _Held:
    """A picture, held to what it should be; `got`: where it is wrong and can be shown; `scale`: of its values."""

    part: Part
    view: View | None
    got: np.ndarray | None
    scale: float = 1.0


class _PartFailed(Exception):
    """Of a submission's function that a picture is made with: its answer is the picture's."""

    def __init__(self, answer: Answer) -> None:
        self.answer = answer


def job_of(student: str, path: Path, rubric_path: Path, rubric: Rubric) -> Job:
    content = hashlib.sha256()
    for file in sorted(_files(path)):
        content.update(f"{file.relative_to(path) if file != path else file.suffix} ".encode())
        content.update(hashlib.sha256(file.read_bytes()).digest())
    seed = rubric.seed_of(content.digest())
    told = [content.hexdigest(), rubric_path.read_text(encoding="utf-8"), str(seed), files.made_by(GRADER, ()), student]
    return Job(student, str(path), str(rubric_path), seed, hashlib.sha256("\0".join(told).encode()).hexdigest()[:24])


GRADER = (Path(__file__).parents[1],)
"""What grades: results of other code are not taken for its own."""


def _files(path: Path) -> Iterator[Path]:
    if path.is_file():
        yield path
    for where, folders, names in os.walk(path, followlinks=False):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        yield from (p for n in names if (p := Path(where, n)).is_file() and not p.is_symlink())


def assess(job: Job) -> Result:
    """The whole of it. Whatever a submission does, there is a result; InputError is for the rubric's faults."""
    began = time.perf_counter()
    rubric = read_rubric(job.rubric)
    result = Result(job.student, job.key, rubric.title, (), seed=job.seed)
    asked = list(_asked(rubric, job.seed))
    try:
        code = code_of(Path(job.path), rubric)
    except InputError as error:
        for one in asked:
            one.answer = Answer(problem=f"expected {error.expected}, got {error.got}", sort="missing")
        return _marked(result, rubric, asked, began, problem=str(error))
    result, problem = _called(result, code, rubric, asked)
    return _marked(result, rubric, asked, began, problem, timed=code.kind != "images")


def _called(result: Result, code: Code, rubric: Rubric, asked: list[_Asked]) -> tuple[Result, str]:
    """All calls, in an order shuffled by the seed, in one process. Where a stage ends it, it is begun again without
    that stage: a mistake sinks no other. A process that others have killed (for their memory) has a second chance.
    """
    hidden = (Path(rubric.folder), Path.cwd())
    left = [asked[i] for i in np.random.default_rng(result.seed).permutation(len(asked))]
    seconds, killed, printed, problem = rubric.limits.seconds, False, "", ""
    while left:
        limits = msgspec.structs.replace(rubric.limits, seconds=max(0.1, seconds))
        calls: list[tuple[str, Scene]] = []
        with Sandbox(code, limits, hidden) as child:
            while left and not child.problem.problem:
                one = left.pop()
                one.before = Before(one.exercise.stage, tuple(calls))
                _ask(one, child, code)
                if code.kind == "python" and one.scene is not None:
                    calls.append((one.exercise.stage, one.scene))
        seconds -= child.spent
        printed = (printed + child.printed)[:16_384]
        ended = child.problem
        if not ended.problem:
            break
        if not child.functions:  # it did not even begin
            problem = ended.problem
            for other in left:
                other.answer = ended
            break
        if "SIGKILL" in ended.problem and not killed:
            killed = True
            left.append(one)
            continue
        for other in (o for o in left if o.exercise.stage == one.exercise.stage):
            other.answer = ended
        left = [o for o in left if o.exercise.stage != one.exercise.stage]
    locks = tuple(f"{n}: {why}" for n, why in probe().items() if why != HELD)
    return msgspec.structs.replace(result, printed=printed, notes=child.notes, open_locks=locks), problem


def _ask(one: _Asked, child: Sandbox, code: Code) -> None:
    stage, parts = one.exercise.stage, NEEDED.get(one.exercise.stage, ())
    if code.kind == "command":
        one.answer = child.call(stage, as_json(one.case.args[0]))
    elif stage in child.functions or not parts or not set(parts) <= set(child.functions):
        one.answer = child.call(stage, *one.case.args)
    else:
        one.answer, one.made_of = _composed(child, stage, one.case.args[0]), made_of(parts, stage)


def _composed(child: Sandbox, stage: str, scene: dict[str, Any]) -> Answer:
    """End to end without a function for it: our tracer with the submission's parts, each called in its process."""
    seconds = 0.0

    def part(name: str) -> Function:
        def call(*arguments: Any) -> np.ndarray:
            nonlocal seconds
            answer = child.call(name, *arguments)
            seconds += answer.seconds
            if len(answer.arrays) > 1:
                answer = Answer(problem=f"it returned {len(answer.arrays)} arrays, where one is wanted", sort="error")
            if answer.problem:
                raise _PartFailed(replace(answer, problem=f"{name}: {answer.problem}"))
            return answer.arrays[0]

        return call

    try:
        with np.errstate(all="ignore"):
            picture = getattr(compose({name: part(name) for name in NEEDED[stage]}), stage)(scene)
        return Answer((np.asarray(picture, float),), seconds)
    except _PartFailed as failed:
        return replace(failed.answer, seconds=seconds)
    except (ValueError, TypeError, IndexError) as error:  # arrays that do not fit one another
        return Answer((), seconds, f"its {' and '.join(NEEDED[stage])} do not fit together: {error}", "error")


def code_of(path: Path, rubric: Rubric) -> Code:
    """What a submission's file or folder holds: Python, a notebook, a program (the rubric's command), or images."""
    asked, inside = rubric.functions, list(_files(path))
    found = sorted(p for p in inside if p.suffix in CODE and p.parent == path)
    shown = sum(p.suffix.lower() in ENDINGS for p in inside)
    if path.is_dir() and shown and (shown == len(inside) or not (found or rubric.command)):
        return Code("images", folder=path, asked=asked)
    if path.is_dir() and rubric.command:
        return Code("command", command=tuple(shlex.split(rubric.command)), folder=path, asked=asked)
    file = path
    if path.is_dir():
        named = [p for p in found if p.stem == rubric.file]
        if len(named or found) != 1:
            got = ", ".join(p.name for p in found) or "none"
            raise InputError(path, f"one file of Python, or {rubric.file}.py beside others", got)
        file = (named or found)[0]
    files.check_file(file, "a Python file, a notebook, or a folder")  # a pipe would be waited for without end
    if file.suffix not in CODE:
        raise InputError(path, "a Python file, a notebook, or a folder", file.suffix or "a file of another kind")
    folder = path if path.is_dir() else None
    if file.suffix == ".ipynb":
        return Code(
            file=file.name, cells=tuple((f"cell {n}", text) for n, text in cells(file)), folder=folder, asked=asked
        )
    try:
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(file, "UTF-8 text", type(error).__name__) from None
    return Code(source=text or "\n", file=file.name, folder=folder, asked=asked)


# ------------------------------------------------------------------------------------------ what is asked


def _asked(rubric: Rubric, seed: int) -> Iterator[_Asked]:
    drawn = itertools.count(1)
    for number, exercise in enumerate(rubric.exercises):
        own = seed + 1000 * number
        if not (exercise.scenes or exercise.drawn):
            yield from (_Asked(exercise, case) for case in LESSONS[exercise.stage].cases(own))
        for name in exercise.scenes:
            yield _reference(rubric, exercise, name)
        for i in range(exercise.drawn):
            scale = LARGER if exercise.stage == "render" and i % 2 else 1.0
            scene = draw_scene(own + i, name=f"drawn {next(drawn)}", scale=scale)
            yield _shown(exercise, scene, np.asarray(traced_once(scene, exercise.rung).mean, float), Tolerance())


def _reference(rubric: Rubric, exercise: Exercise, name: str) -> _Asked:
    """A scene by name: the reference beside the rubric, or the shipped one, has its camera and its picture."""
    own = references.path_of(Path(rubric.folder) / "reference", name, exercise.rung)
    path = own if own.is_file() else references.path_of(references.SHIPPED, name, exercise.rung)
    held = _loaded(path)
    return _shown(exercise, held.origin(), np.asarray(held.image.mean, float), held.tolerance)


@functools.cache
def _loaded(path: Path) -> references.Reference:
    """Read once for all the submissions of a process."""
    return references.load(path)


def _shown(exercise: Exercise, scene: Scene, picture: np.ndarray, tolerance: Tolerance) -> _Asked:
    told = as_arrays(scene, exercise.rung)
    if exercise.stage == "hit_points":
        picture = np.asarray(LESSONS["hit_points"].reference(told))
    if exercise.tolerance is not None:
        tolerance = msgspec.structs.replace(tolerance, p999_abs=exercise.tolerance)
    case = Case(f"{scene.name}, {exercise.rung}" if exercise.stage == "render" else scene.name, (told,), (picture,))
    return _Asked(exercise, case, scene, tolerance)


# ------------------------------------------------------------------------------------------ what it is worth


def _marked(
    result: Result, rubric: Rubric, asked: list[_Asked], began: float, problem: str, timed: bool = True
) -> Result:
    """`timed`: what was asked was computed here, so its seconds count."""
    exercises, pictures, speed = [], [], []
    held = {id(a): _hold(a) for a in asked if a.scene is not None}
    # One tracer made all pictures, so one cause is looked for in all; where there is none, in an exercise's own.
    together = _cause(list(held.values()), result.seed)
    for exercise in rubric.exercises:
        mine = [a for a in asked if a.exercise is exercise]
        if mine[0].scene is None:
            marked = _stage(exercise, mine)
        else:
            marked, wrong = _pictures(exercise, mine, [held[id(a)] for a in mine], together, result.seed)
            pictures += wrong
        exercises.append(marked)
        if timed and rubric.speed is not None and rubric.speed.of == exercise.name and marked.error is not None:
            speed.append((exercise.name, marked.seconds, marked.error))
    bonus = 0.0
    if rubric.speed is not None and speed and all(e.status == "pass" for e in exercises if e.name == rubric.speed.of):
        bonus = rubric.speed.earned(speed[0][1])
    return msgspec.structs.replace(
        result,
        exercises=tuple(exercises),
        pictures=tuple(pictures),
        speed=tuple(speed),
        bonus=bonus,
        problem=problem,
        own_seconds=round(sum(a.answer.seconds for a in asked), 4),
        seconds=round(time.perf_counter() - began, 4),
    )


def _status(parts: list[Part], asked: list[_Asked]) -> Status:
    """The most telling of what became of the calls."""
    sorts = [a.answer.sort for a in asked]
    for sort in ("limit", "broken", "missing", "error"):
        if sort in sorts:
            return sort
    return (
        "pass"
        if all(p.passed for p in parts)
        else "error"
        if all(p.problem and p.wrong is None for p in parts)
        else "fail"
    )


def _stage(exercise: Exercise, asked: list[_Asked]) -> Marked:
    stage = LESSONS[exercise.stage]
    if exercise.tolerance is not None:
        stage = replace(stage, tolerance=exercise.tolerance)
    outcomes = [a.answer.problem or tuple(x.astype(float) for x in a.answer.arrays) for a in asked]
    found = judge(stage, [a.case for a in asked], outcomes)
    parts = [
        Part(
            c.shows,
            c.passed,
            exercise.share(c.passed, c.error, c.wrong),
            c.error,
            c.wrong,
            a.answer.seconds,
            a.answer.problem,
        )
        for c, a in zip(found.cases, asked, strict=True)
    ]
    return Marked(
        name=exercise.name,
        stage=exercise.stage,
        status=_status(parts, asked),
        points=round(exercise.points * sum(p.share for p in parts) / len(parts), 4),
        of=exercise.points,
        visibility=exercise.visibility,
        unit=found.unit,
        tolerance=found.tolerance,
        sentences=(found.sentence,),
        causes=found.causes,
        sureness="sure" if len(found.causes) == 1 else "likely" if found.causes else "",
        inputs=found.inputs,
        expected=found.expected,
        got=found.got,
        parts=tuple(parts),
    )


def _cause(held: list[_Held], seed: int, most: int = 2) -> Diagnosis | None:
    """Of pictures together, those that are right included: None where nothing is wrong, or there are no numbers."""
    views = [h.view for h in held if h.view is not None]
    return diagnose(views, seed, most=most) if any(h.view is not None and not h.part.passed for h in held) else None


def _pictures(
    exercise: Exercise, asked: list[_Asked], held: list[_Held], together: Diagnosis | None, seed: int
) -> tuple[Marked, list[Picture]]:
    parts = [h.part for h in held]
    status = _status(parts, asked)
    sentences: tuple[str, ...] = tuple(dict.fromkeys(p.problem for p in parts if p.problem))
    found = None
    if any(not h.part.passed and h.view is not None for h in held):
        found = together
        if together is not None and not together.causes:
            found = _cause(held, seed, most=1)
            # What other pictures speak against is not sure.
            found = found and replace(found, sureness="likely" if found.causes else "unknown")
    if found is not None:
        sentences = (*found.words, *sentences)
    elif status == "pass":
        sentences = (f"right in all {len(parts)} pictures",)
    sentences = (*sentences, *dict.fromkeys(a.made_of for a in asked if a.made_of))
    # Pixel by pixel the worst; the others stay small.
    wrong = [(a, h.got, h) for a, h in zip(asked, held, strict=True) if h.got is not None]
    wrong.sort(key=lambda w: -(w[2].part.error or 0))
    pictures = [_drawn(a, got, h.scale, whole=i < MOST_VIEWS) for i, (a, got, h) in enumerate(wrong)]
    marked = Marked(
        name=exercise.name,
        stage=exercise.stage,
        status=status,
        points=round(exercise.points * sum(p.share for p in parts) / len(parts), 4),
        of=exercise.points,
        visibility=exercise.visibility,
        unit="of the picture's scale" if exercise.stage == "render" else "m",
        tolerance=asked[0].tolerance.p999_abs,
        sentences=sentences or ("wrong, by no typical mistake",),
        causes=tuple(c.name for c in found.causes) if found else (),
        sureness=found.sureness if found and found.causes else "",
        parts=tuple(parts),
    )
    return marked, pictures


def _hold(asked: _Asked) -> _Held:
    """A picture beside what it should be: numbers decide, never a claim of the submission's own."""
    exercise, case, answer = asked.exercise, asked.case, asked.answer
    (right,), shows = case.expected, case.shows
    if answer.problem:
        return _Held(Part(shows, False, seconds=answer.seconds, problem=answer.problem), None, None)
    got, half, clipped = _picture_of(answer)
    if got.shape != right.shape:
        problem = f"it returned an array {got.shape}, where {right.shape} is wanted"
        return _Held(Part(shows, False, seconds=answer.seconds, problem=problem), None, None)
    points = exercise.stage == "hit_points"
    assert asked.scene is not None
    if not points:
        got = forgiven(got, np.clip(right, 0, 1) if clipped else right, asked.scene, exercise.rung)
    scale = 1.0 if points else scale_of(Image(right.astype(np.float32)))
    passed, error, wrong = (
        _points(right, got, asked.tolerance) if points else _radiance(right, got, asked, half, clipped, scale)
    )
    part = Part(shows, passed, exercise.share(passed, error, wrong), error, wrong, answer.seconds)
    if not points and (bad := ~np.isfinite(got).all(axis=-1)).any():
        (y, x), count = np.argwhere(bad)[0], int(bad.sum())
        problem = f"{count} pixel{'s are' if count > 1 else ' is'} NaN or infinite, the first at (x={x}, y={y})"
        part = msgspec.structs.replace(part, problem=problem)
        return _Held(part, None, got, scale)
    ours = bool(asked.made_of)
    common, before = bool(exercise.scenes) and not ours, asked.before
    view = View(asked.scene, got, right, exercise.rung, points, half, clipped, None, common, before, composed=ours)
    return _Held(part, view, None if passed else got, scale)


def _picture_of(answer: Answer) -> tuple[np.ndarray, np.ndarray | None, bool]:
    """Radiance; of an image file what its format rounds off: half a step of each value, and whether it is clipped."""
    got = np.asarray(answer.arrays[0], np.float64)
    if len(answer.arrays) != 2 or answer.arrays[1].dtype != np.uint8:
        return got, None, False
    with TemporaryDirectory() as folder:
        start = Path(folder, "start")
        start.write_bytes(answer.arrays[1].tobytes())
        rounding = files.rounding_of(start, got.astype(np.float32))
    return got, rounding.half, rounding.clipped


def _radiance(
    right: np.ndarray, got: np.ndarray, asked: _Asked, half: np.ndarray | None, clipped: bool, scale: float
) -> tuple[bool, float | None, float]:
    """(passed, error by its scale, share of pixels that are off)."""
    should = np.clip(right, 0, 1) if clipped else right
    with np.errstate(over="ignore"):
        test, reference = (Image(x.astype(np.float32)) for x in (got, should))
    made = compare(test, reference, tolerance=asked.tolerance, noise="none", half_steps=(half, None))
    error = made.radiance.p999_abs
    finite = error is not None and bool(np.isfinite(got).all())
    with np.errstate(invalid="ignore"):
        slack = asked.tolerance.p999_abs * np.maximum(scale, np.abs(should)) + (0 if half is None else half)
        off = float((~(np.abs(got - should) <= slack)).any(axis=-1).mean())
    return made.passed, error / scale if finite and error is not None else None, off


def _points(right: np.ndarray, got: np.ndarray, tolerance: Tolerance) -> tuple[bool, float | None, float]:
    """Of points, NaN for none: the 99.9 % quantile of the distance where both have one, and the share that is off."""
    seen, there = (np.isfinite(x).all(axis=-1) for x in (right, got))
    apart = np.linalg.norm(np.where((seen & there)[..., None], got - right, 0.0), axis=-1)
    held = max(tolerance.p999_abs, 1e-6) * max(1.0, float(np.abs(right[seen]).max(initial=0.0)))
    wrong = (apart > held) | (seen != there)
    error = float(np.quantile(apart[seen & there], 0.999)) if (seen & there).any() else None
    allowed = max(tolerance.mask_pixels, int(1e-3 * wrong.size))
    return int(wrong.sum()) <= allowed and bool((seen & there).any()), error, float(wrong.mean())


# ------------------------------------------------------------------------------------------ what is shown of it


def _drawn(asked: _Asked, got: np.ndarray, scale: float, whole: bool) -> Picture:
    """A wrong picture beside the right one; `whole`: with every value, for the viewer."""
    (right,), points = asked.case.expected, asked.exercise.stage == "hit_points"
    if points:  # x, y, z as red, green, blue, from the least to the largest that there is
        seen = np.isfinite(right).all(axis=-1)
        low, high = (f(right[seen], axis=0, initial=0.0) for f in (np.min, np.max))
        right, got = (np.where(np.isfinite(x), (x - low) / np.maximum(high - low, 1e-9), 0.0) for x in (right, got))
    with np.errstate(over="ignore", invalid="ignore"):
        test, reference = (Image(np.nan_to_num(x, nan=np.nan, posinf=np.inf).astype(np.float32)) for x in (got, right))
    brightest = np.quantile(reference.mean.max(axis=-1), 0.995)
    rows, columns = (np.linspace(0, n - 1, k).astype(int) for n, k in zip(right.shape[:2], SAMPLE, strict=True))
    sample = np.nan_to_num((got - right)[np.ix_(rows, columns)].sum(axis=-1) / scale, posinf=1e6, neginf=-1e6)
    return Picture(
        exercise=asked.exercise.name,
        shows=asked.case.shows,
        thumb=_thumb(test, reference),
        planes=_planes(test, reference) if whole else "",
        stops=round(-float(np.log2(brightest)), 2) if brightest > 0 else 0.0,
        share=asked.tolerance.p999_abs,
        scale=scale,
        sample=tuple(float(f"{x:.4g}") for x in np.clip(sample, -1e6, 1e6).ravel()),
    )


def _planes(test: Image, reference: Image) -> str:
    packed = pack(test, reference, surfaces=False, most_pixels=MOST_PIXELS)
    return msgspec.json.encode(packed.for_page()).decode()


def _thumb(test: Image, reference: Image) -> str:
    """Expected, got, error, side by side, in 64 colours: some 5 kB."""
    from PIL import Image as Pillow

    step = max(1, reference.shape[1] // 160)
    gain = np.float32(1 / max(1e-9, float(np.quantile(reference.mean, 0.995))))
    shown = [files.to_bytes(np.nan_to_num(i.mean[::step, ::step]) * gain) for i in (reference, test)]
    shown.append(files.to_bytes(error_map(test, reference)[::step, ::step]))
    gap = np.full((shown[0].shape[0], 4, 3), 255, np.uint8)
    row = np.concatenate([shown[0], gap, shown[1], gap, shown[2]], axis=1)
    buffer = io.BytesIO()
    Pillow.fromarray(row).quantize(64).save(buffer, "png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
