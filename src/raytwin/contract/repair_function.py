"""The line to look at: a student's function of a stage, repaired by one change of its text, in this process."""

import contextlib
import inspect
import marshal
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.contract.stage import Case, Function, Stage
from raytwin.diagnose.attempt import attempt, local_values, places_reached
from raytwin.diagnose.draw_scene import LARGER, draw_scene
from raytwin.diagnose.repair import A_CALL, VALUES_SECONDS, Answers, Candidate, Cells, Repair, Rows, Runner, repair
from raytwin.renderers.scene_exchange import as_arrays

SECONDS = 2.5
"""Seconds of computing, after which no further change is tried."""
MEMORY = 1 << 29
"""Bytes that a change may take."""
_REPAIRING = ContextVar("_REPAIRING", default=False)
"""Whether a change is being tried: a text that checks itself, as a decorator does, must not be repaired within it."""


def repair_here(
    function: Function,
    cases: Sequence[Case],
    is_right: Callable[[Case, Any], bool],
    source: str = "",
    further: Callable[[], Sequence[Case]] = tuple,
    innocent: Sequence[str] = (),
    right: Sequence[Case] = (),
) -> Repair | None:
    """The change that makes the function right in all `cases`, of which the first is wrong; None where none is found.

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
    began = time.process_time()

    loaded: dict[bytes, Any] = {}

    def prepared(chosen: Sequence[Candidate]) -> tuple[list[list[Any]], list[tuple[str, ...]]]:
        for code in {code for c in chosen for code in c.codes} - set(loaded):
            loaded[code] = marshal.loads(code)
        return [[loaded[code] for code in c.codes] for c in chosen], [c.names for c in chosen]

    def run(chosen: Sequence[Candidate], arguments: Sequence[Any], changed: bool) -> Answers:
        with _bounded_memory():
            settings = [c.setting for c in chosen]
            made: Answers = attempt(space, name, *prepared(chosen), settings, arguments, A_CALL, changed, innocent)
        return made

    def places(chosen: Sequence[Candidate], arguments: Sequence[Any]) -> frozenset[int]:
        one_each = list({c.codes: c for c in chosen}.values())
        return frozenset(places_reached(space, name, *prepared(one_each), arguments, A_CALL))

    def values(chosen: Sequence[Candidate], arguments: Sequence[Any]) -> Rows:
        settings = [c.setting for c in chosen]
        rows: Rows = local_values(space, name, *prepared(chosen), settings, arguments, VALUES_SECONDS)
        return rows

    def reached_by_right(chosen: Sequence[Candidate]) -> frozenset[int]:
        return frozenset().union(*(places(chosen, case.args) for case in right))

    token = _REPAIRING.set(True)
    try:
        more_time = lambda: time.process_time() - began < SECONDS  # noqa: E731
        runner = Runner(run, places, reached_by_right, values)
        return repair(cells, name, cases, is_right, runner, more_time, innocent, further=further)
    finally:
        _REPAIRING.reset(token)


@contextlib.contextmanager
def _bounded_memory() -> Iterator[None]:
    """A change may ask for arrays without end: more than MEMORY beyond what is there is refused, where that can be."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        most = pages * resource.getpagesize() + MEMORY
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


def probes(stage: Stage, cases: Sequence[Case], is_wrong: Callable[[Case], bool]) -> list[Case]:
    """The cases in the order that dismisses most changes soonest: small wrong ones, other wrong ones, right ones.

    Of the pictures that are wrong the smaller ones come first that are wrong as well. Empty where all is right.
    """
    wrong = sorted((case for case in cases if is_wrong(case)), key=_size)
    small = (smaller(stage, case, step) for step in (*STEPS, FINEST) for case in wrong[:2])
    rest = [case for case in cases if not any(case is one for one in wrong)]
    return [*[case for case in small if case is not None and is_wrong(case)][:1], *wrong, *rest] if wrong else []


def right_ones(stage: Stage, cases: Sequence[Case], is_wrong: Callable[[Case], bool]) -> list[Case]:
    """Those of the cases that are right, pictures thinned: what runs in these is less likely to be wrong."""
    return [smaller(stage, case, STEPS[0]) or case for case in cases if not is_wrong(case)]


def further_probes(stage: Stage, seed: int) -> list[Case]:
    """Inputs that no test has, of other seeds: a change that is right by chance in the test's own fails in these.

    Pictures of scenes that are blind to nothing; rays and points of all kinds together.
    """
    if stage.name in ("hit_points", "render"):
        scenes = (draw_scene(seed + 1000 * k, SIZE, scale=LARGER if k % 2 else 1.0) for k in range(1, DRAWN + 1))
        each = (as_arrays(scene, "lambert" if k % 3 == 2 else "shadow") for k, scene in enumerate(scenes))
        return [_case(stage, Case("", (scene,), ()), (scene,)) for scene in each]
    cases = [case for k in range(1, FURTHER + 1) for case in stage.cases(seed + 1000 * k)]
    return [*_mixed(stage, cases), *(smaller(stage, case, STEPS[-1]) or case for case in cases)]


FURTHER, DRAWN = 2, 6
"""Seeds whose cases a repair has to pass beyond the test's own; or scenes."""
SIZE = 20, 15
"""Pixels of such a scene."""
PROOF = 0.004
"""Share of the values that may be off after a repair: one pixel of such a scene, at a shadow's edge."""


def _mixed(stage: Stage, cases: Sequence[Case]) -> Iterator[Case]:
    """Cases of the same settings in one, their rows in another order: all rows of a case may be alike."""
    alike: dict[Any, list[Case]] = {}
    for case in cases:
        each = [k for k, a in enumerate(case.args) if np.ndim(a) > 1 and len(a) == len(case.expected[0])]
        same = [None if k in each else np.asarray(a).tobytes() for k, a in enumerate(case.args)]
        alike.setdefault(tuple(same), []).append(case)
    for same, some in alike.items():
        if None in same and len(some) > 1:
            order = np.random.default_rng(0).permutation(sum(len(case.expected[0]) for case in some))
            rows = [np.concatenate([case.args[k] for case in some])[order] if one is None else some[0].args[k]
                    for k, one in enumerate(same)]  # fmt: skip
            yield _case(stage, some[0], tuple(rows))


FINEST = 2
"""Every how many pixels where no coarser picture is wrong: a mistake beyond a first block of pixels shows."""
STEPS = 12, 7, 4
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
        return Case(case.shows, args, (np.asarray(stage.reference(*args)),))


def _thinned(K: Any, step: int) -> np.ndarray:
    """Return K of a camera whose pixel (u, v) is the other's (step u, step v)."""
    return np.concatenate([np.asarray(K)[:2] / step, np.asarray(K)[2:]])


def _size(case: Case) -> float:
    """Sort small cases first, since they are fast, but those of 12 numbers or fewer last: they rule out little."""
    numbers = sum(np.size(a) for a in case.expected)
    return float(numbers if numbers > 12 else 1e6)
