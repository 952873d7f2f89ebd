"""The line to look at: a student's function of a stage, repaired by one change of its text, in this process."""

import contextlib
import inspect
import marshal
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence, Set
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.explain.attempt import attempt, lines_run
from raytwin.explain.draw_scene import LARGER, draw_scene
from raytwin.explain.repair import SECONDS_A_TRY, Answers, Candidate, Cells, Lines, Repair, Runner, Work, repair
from raytwin.explain.textbook import FUNCTIONS
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.teach.contract.loading import arrays_of
from raytwin.teach.contract.stage import PARTS_OF, Case, Function, Stage

WORK_LINES = 3e6
"""What is done for one function, in lines that run."""
MEMORY_BYTES = 1 << 29
"""Bytes that a change may take."""
_REPAIRING = ContextVar("_REPAIRING", default=False)
"""Whether a change is being tried: a text that checks itself, as a decorator does, must not be repaired within it."""


def repair_here(
    function: Function,
    cases: Sequence[Case],
    is_right: Callable[[Case, Any], bool],
    source: str = "",
    further: Callable[[], Sequence[Case]] = tuple,
    right: Sequence[Case] = (),
    words: Set[str] | None = None,
) -> Repair | None:
    """The change that makes the function correct in all `cases`, of which the first is wrong; None where none is found.

    `right`: cases that it has right. Nothing is tried on a function whose text is not known: `source`, its file, or a
    notebook's cells.
    """
    space, name = getattr(function, "__globals__", None), getattr(function, "__name__", "")
    if (
        _REPAIRING.get()
        or not cases
        or space is None
        or space.get(name) is not function
        or not (cells := _cells(function, source))
    ):
        return None

    def run(chosen: Sequence[Candidate], arguments: Sequence[Any], changed: bool) -> Answers:
        codes, names = [marshal.loads(c.code) for c in chosen], [c.names for c in chosen]
        with _bounded_memory():
            made: Answers = attempt(space, name, codes, names, arguments, SECONDS_A_TRY, changed)
        return made

    def lines(arguments: Sequence[Any]) -> Counter[tuple[str, int]]:
        return Counter(lines_run(space, name, arguments, 10 * SECONDS_A_TRY))

    def correct_lines() -> Lines:
        return frozenset().union(*(lines(case.args) for case in right))

    token = _REPAIRING.set(True)
    try:
        runner = Runner(run, lines, correct_lines, Work(WORK_LINES))
        return repair(cells, name, cases, is_right, runner, further=further, words=words)
    finally:
        _REPAIRING.reset(token)


@contextlib.contextmanager
def _bounded_memory() -> Iterator[None]:
    """Let a change allocate MEMORY_BYTES at most, on systems that can limit it."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        most = pages * resource.getpagesize() + MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most if soft == resource.RLIM_INFINITY else min(soft, most), hard))
    except (ImportError, OSError, ValueError):  # another system
        yield
        return
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _cells(function: Function, source: str) -> Cells:
    """The text that the function's names come from."""
    if source:
        return [("", source)]
    if isinstance(typed := function.__globals__.get("In"), list):  # a notebook's, or IPython's
        return [(f"cell {k}", text) for k, text in enumerate(typed) if isinstance(text, str)]
    try:
        return [("", "".join(inspect.findsource(function)[0]))]
    except (OSError, TypeError):
        return []


WITHOUT_MEANING = {
    "np", "axis", "keepdims", "dtype", "float", "None", "True", "False", "newaxis", "copy", "range", "len", "nan",
    "inf", "full", "full_like", "cv2", "undistortPointsIter",
}  # fmt: skip
"""Words that any function may have: layout, copies, kinds of numbers, marks of a miss."""
SYNONYMS = [
    set(words.split()) for words in ("argmin min minimum", "sum dot einsum", "sqrt norm linalg", "T inv linalg")
]
"""Words for one thing: where a correct form has one of them, any will do."""


@cache
def words_of(function: str) -> frozenset[str] | None:
    """The words of the function's correct form and of what that calls; None where the textbook has none."""
    found, todo = {*WITHOUT_MEANING}, [*PARTS_OF.get(function, (function,))]
    if not set(todo) <= set(FUNCTIONS):
        return None
    for name in todo:
        words = set(re.findall(r"[A-Za-z_]\w*", FUNCTIONS[name]))
        todo += [other for other in FUNCTIONS if other in words and other not in todo]
        found |= words
    return frozenset(found.union(*(some for some in SYNONYMS if found & some)))


def probes(stage: Stage, cases: Sequence[Case], is_wrong: Callable[[Case], bool]) -> list[Case]:
    """The cases in the order that dismisses most changes soonest: small wrong ones, other wrong ones, correct ones.

    Of the pictures that are wrong the smaller ones come first that are wrong as well. Empty where all is correct.
    """
    wrong = sorted((case for case in cases if is_wrong(case)), key=_size)
    small = (smaller(stage, case, step) for step in (*STRIDES, FINEST) for case in wrong[:2])
    rest = [case for case in cases if not any(case is one for one in wrong)]
    return [*[case for case in small if case is not None and is_wrong(case)][:1], *wrong, *rest] if wrong else []


def right_ones(stage: Stage, cases: Sequence[Case], is_wrong: Callable[[Case], bool]) -> list[Case]:
    """Those of the cases that are correct, pictures thinned: what runs in these is less likely to be wrong."""
    return [smaller(stage, case, STRIDES[0]) or case for case in cases if not is_wrong(case)]


def further_probes(stage: Stage, seed: int) -> list[Case]:
    """Inputs that no test has, of other seeds: a change that is correct by chance in the test's own fails in these.

    Pictures of scenes in which every mistake shows; other cases, pictures thinned.
    """
    if stage.name in ("hit_points", "render"):
        scenes = (
            draw_scene(seed + 1000 * k, PROBE_SIZE, scale=LARGER if k % 2 else 1.0)
            for k in range(1, FURTHER_SCENES + 1)
        )
        each = (as_arrays(scene, "lambert" if k % 3 == 2 else "shadow") for k, scene in enumerate(scenes))
        return [_case(stage, Case("", (scene,), ()), (scene,)) for scene in each]
    cases = [case for k in range(1, FURTHER_SEEDS + 1) for case in stage.cases(seed + 1000 * k)]
    return [smaller(stage, case, STRIDES[-1]) or case for case in cases]


FURTHER_SEEDS, FURTHER_SCENES = 2, 6
"""Seeds whose cases a repair has to pass beyond the test's own; or scenes."""
PROBE_SIZE = 20, 15
"""Pixels of such a scene."""
REPAIRED_OFF = 0.004
"""Share of the values that may be off after a repair: one pixel of such a scene, at a shadow's edge."""


FINEST = 2
"""Every how many pixels where no coarser picture is wrong: a mistake beyond a first block of pixels shows."""
STRIDES = 12, 7, 4
"""Every how many pixels along each side a whole picture is tried: fewer rays per trial, as long as some are wrong."""


def smaller(stage: Stage, case: Case, step: int) -> Case | None:
    """A picture of each `step`-th pixel of each such row; None where the stage makes no picture."""
    if stage.name == "back_project":
        K, dist, width, height = case.args
        return _case(stage, case, (_thinned(K, step), dist, -(-width // step), -(-height // step)))
    if stage.name not in ("hit_points", "render"):
        return None
    scene = case.args[0]
    size = {"width": -(-scene["width"] // step), "height": -(-scene["height"] // step), "K": _thinned(scene["K"], step)}
    return _case(stage, case, (scene | size,))


def _case(stage: Stage, case: Case, args: tuple[Any, ...]) -> Case:
    with np.errstate(all="ignore"):
        return Case(case.shows, args, arrays_of(stage.reference(*args)))


def _thinned(K: Any, step: int) -> np.ndarray:
    """Return K of a camera whose pixel (u, v) is the other's (step u, step v)."""
    return np.concatenate([np.asarray(K)[:2] / step, np.asarray(K)[2:]])


def _size(case: Case) -> float:
    """Sort small cases first, since they are fast, but those of 12 numbers or fewer last: they rule out little."""
    numbers = sum(np.size(a) for a in case.expected)
    return float(numbers if numbers > 12 else 1e6)
