"""A second look at what is wrong: the line to look at, found by repairing the text, and the fingerprint of the numbers.

It runs after grading, in a sandbox of its own, and changes no points. What the sandbox answers is compared here with
what is right.
"""

import contextlib
import dataclasses
import inspect
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin.contract.check_function import is_repaired, is_right
from raytwin.contract.repair_function import STEPS, further_probes, probes, right_ones, smaller
from raytwin.contract.stage import Case, Stage
from raytwin.contract.stage_result import says_why, with_hint
from raytwin.contract.stage_table import LESSONS
from raytwin.diagnose import attempt
from raytwin.diagnose.repair import (
    A_CALL,
    VALUES_SECONDS,
    Answers,
    Candidate,
    Cells,
    Repair,
    Rows,
    Runner,
    kind_of,
    repair,
)
from raytwin.grade.fingerprint import PROBE_SEED, fingerprint
from raytwin.grade.follow_through import DRIVER as REPLACER
from raytwin.grade.follow_through import REPLACE, source_of
from raytwin.grade.result import Marked
from raytwin.grade.rubric import Rubric
from raytwin.sandbox.sandbox import Code, Sandbox

SECONDS, UNNAMED, IN_ALL = 2.0, 5.0, 8.0
"""Seconds of computing: for one function, for one of which no mistake is proved, and for a submission."""
LONGEST = 100_000
"""Characters of a text that is repaired: to read one of megabytes takes the grader minutes."""
CALLED, PLACES, VALUES = "raytwin_attempt", "raytwin_places", "raytwin_local_values"
DRIVER = f"""
{REPLACER}

{inspect.getsource(attempt)}

raytwin_codes = []

def raytwin_chosen(codes, lengths, which):
    import marshal
    import numpy
    ends = numpy.cumsum(lengths).astype(int)
    raytwin_codes.extend(marshal.loads(codes[end - n : end].tobytes()) for end, n in zip(ends, lengths))
    return [[raytwin_codes[k] for k in some] for some in which]

def {CALLED}(function, codes, lengths, which, names, settings, arguments, seconds, changed, innocent):
    import numpy
    chosen = raytwin_chosen(codes, lengths, which)
    shapes, numbers = [], []
    for made in attempt(globals(), function, chosen, names, settings, arguments, seconds, changed, innocent):
        shapes.append(-1 if made is None else len(made))
        for array in made or ():
            shapes += [array.ndim, *array.shape]
            numbers.append(array.ravel())
    return numpy.array(shapes, int), numpy.concatenate([numpy.zeros(0), *numbers])

def {PLACES}(function, codes, lengths, which, names, arguments, seconds):
    import numpy
    chosen = raytwin_chosen(codes, lengths, which)
    return numpy.array(places_reached(globals(), function, chosen, names, arguments, seconds), int)

def {VALUES}(function, codes, lengths, which, names, settings, arguments, seconds):
    import numpy
    chosen = raytwin_chosen(codes, lengths, which)
    return numpy.array(local_values(globals(), function, chosen, names, settings, arguments, seconds), int)
"""
"""Runs in the sandbox, behind the submission's own text and in its module."""


class SecondLook:
    """Lines to look at in a submission, within IN_ALL seconds, as far as the rubric's `hints` go.

    A text that is nested too deeply to be read is not repaired. `found`: by the name of the function. All that is asked
    for again once a submission was called is asked of one process, since to start one takes as long as many calls.
    """

    def __init__(self, rubric: Rubric, code: Code | None) -> None:
        self.rubric, self.code, self.left = rubric, code if code and code.kind == "python" else None, IN_ALL
        self.found: dict[str, Repair] = {}
        self.cells: Cells = code.cells or (("", code.source),) if code else ()
        self.hints = rubric.hints if self.code and sum(len(text) for _, text in self.cells) <= LONGEST else 0
        self.trials: _Trials | None = None
        self.replaced: tuple[str, ...] = ()

    def __enter__(self) -> "SecondLook":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def child_with(self, names: Sequence[str] = ()) -> Sandbox:
        """The process, with right functions of these names in place of the submission's own; a new one if it ended."""
        assert self.code is not None
        if self.trials is None or self.trials.child.problem.problem:
            self.close()
            asked = (*self.rubric.functions, CALLED, PLACES, VALUES, REPLACE)
            own = dataclasses.replace(self.code.followed_by(DRIVER), asked=asked)
            child = Sandbox(own, self.rubric.limits, (Path(self.rubric.folder), Path.cwd())).__enter__()
            self.trials, self.replaced = _Trials(child), ()
        if self.replaced != tuple(names):
            self.replaced = tuple(names)
            self.trials.child.call(REPLACE, source_of(names), list(names))
        return self.trials.child

    def close(self) -> None:
        """End the process."""
        if self.trials is not None:
            self.trials.child.close()

    def at(
        self,
        exercises: Sequence[Marked],
        right: Sequence[str],
        replaced: Sequence[str] = (),
        beside: Sequence[str] = (),
        pictures: Sequence[tuple[str, Case]] = (),
    ) -> list[Marked]:
        """The exercises, those that are wrong with the line to look at, and with a fingerprint if no cause is named.

        `right`: functions that are right by their own tests, and are not tried. `replaced`: functions that failed, of
        which right ones take the place. `beside`: others that are wrong; a change that makes them right, too, is
        `found` of them. `pictures`: (function, case) of those that are wrong: cases that are the same for all may be
        too small to show it.
        """
        wrong = [e for e in exercises if e.status in ("fail", "error")]
        unnamed = {e.stage for e in wrong if self.code and not (e.faults or e.fingerprint)}
        tried = [e for e in wrong if self.hints and e.stage not in self.found]
        prints: dict[str, str] = {}
        if tried or unnamed - set(self.found):
            child = self.child_with(replaced)
            if not replaced:
                prints = {stage: _fingerprint(child, stage) for stage in unnamed}
            if CALLED in child.functions and self.trials is not None:
                self._repair(tried, right, replaced, beside, pictures, self.trials)
        return [
            _with_hint(e, self.found.get(e.stage), self.hints, e.fingerprint or prints.get(e.stage, ""))
            if e in wrong else e for e in exercises
        ]  # fmt: skip

    def _repair(
        self, tried: Sequence[Marked], right: Sequence[str], replaced: Sequence[str], beside: Sequence[str],
        pictures: Sequence[tuple[str, Case]], trials: "_Trials",
    ) -> None:  # fmt: skip
        began = _clock(trials.child)
        for stage in dict.fromkeys(e.stage for e in tried):
            if stage in trials.child.functions:
                seconds = SECONDS if all(_is_proved(e) for e in tried if e.stage == stage) else UNNAMED
                until = min(_clock(trials.child) + seconds, began + self.left)
                fitting = [(r.candidate, *r.rivals) for r in self.found.values() if r.candidate and not replaced]
                known = list(dict.fromkeys(itertools.chain(*fitting)))
                others = [LESSONS[e.stage] for e in tried if e.stage != stage]
                asked = [case for name, case in pictures if name == stage]
                with contextlib.suppress(RecursionError, MemoryError):
                    made = _repair(LESSONS[stage], self.cells, trials, until, right, replaced, known, others, asked)
                    if made is not None:
                        self.found[stage] = made
        for stage in (name for name in beside if name in trials.child.functions):
            some = (r for r in self.found.values() if (r.sure or r.rivals) and _makes_right(r, stage, trials))
            if one := next(some, None):
                self.found[stage] = one
        if any(e.stage in PICTURES and e.stage not in self.found for e in tried):
            # A change in what only some pictures are made of, where others stay wrong, may hide what is wrong in all.
            unsure = {k: dataclasses.replace(r, sure=False) for k, r in self.found.items() if k in PICTURES}
            self.found |= unsure
        self.left -= _clock(trials.child) - began


def _makes_right(found: Repair, stage: str, trials: "_Trials") -> bool:
    """Whether the change makes another function right, too, that is wrong without."""

    def right_with(change: Candidate) -> Iterator[bool]:
        for case in (*_cases(stage), *_further(stage)):
            (got,) = trials.run(stage, (), [change], case.args, False)
            yield got is not None and is_repaired(LESSONS[stage], case, got)

    change = found.candidate
    return (
        change is not None and not all(right_with(dataclasses.replace(change, setting=()))) and all(right_with(change))
    )


@cache
def _cases(stage: str) -> list[Case]:
    """Cases that are the same for all: no points depend on them."""
    return LESSONS[stage].cases(PROBE_SEED)


@cache
def _further(stage: str) -> list[Case]:
    return further_probes(LESSONS[stage], PROBE_SEED)


PICTURES = ("hit_points", "render")
MOST_PROBES = 3
"""Cases that a fingerprint is taken of."""


def _is_proved(exercise: Marked) -> bool:
    return says_why(exercise.sureness, exercise.faults)


def _fingerprint(child: Sandbox, stage: str) -> str:
    """A fingerprint of the wrong numbers in cases that are the same for all."""
    cases = _cases(stage)[:MOST_PROBES]
    answers = [child.call(stage, *case.args) for case in cases]
    got = [a.astype(float) for answer in answers for a in answer.arrays]
    return fingerprint([a for case in cases for a in case.expected], got)


def _with_hint(exercise: Marked, repair: Repair | None, level: int, found: str) -> Marked:
    """The exercise with a repair in its place among the sentences."""
    exercise = msgspec.structs.replace(exercise, fingerprint=found)
    if repair is None:
        return exercise
    raised = exercise.status == "error"
    sentences = with_hint(exercise.sentences, repair.hint(level), exercise.sureness, exercise.faults, raised)
    sureness = "proved" if repair.sure or _is_proved(exercise) else "likely"
    return msgspec.structs.replace(exercise, sentences=sentences, sureness=sureness, repair=kind_of(repair.operator))


def _clock(child: Sandbox) -> float:
    """Seconds that were computed there and here."""
    return child.spent + time.process_time()


def _repair(
    stage: Stage, cells: Cells, trials: "_Trials", until: float, right: Sequence[str], ours: Sequence[str],
    known: Sequence[Candidate], others: Sequence[Stage], asked: Sequence[Case],
) -> Repair | None:  # fmt: skip
    child = trials.child

    def is_wrong(case: Case, of: Stage = stage) -> bool:
        answer = child.call(of.name, *case.args)
        return bool(answer.problem) or not is_right(of, case, answer.arrays)

    @cache
    def right_beside() -> list[tuple[Stage, Case]]:
        rights = [LESSONS[name] for name in right]
        return _some_cases(rights, lambda case, of: not is_wrong(case, of), CASES_OF_RIGHT)

    def keeps(candidate: Candidate) -> bool:
        """Whether it leaves right what is: a change that mends one function and spoils another is none."""
        for other, case in right_beside():
            (got,) = trials.run(other.name, (), [candidate], case.args, False)
            if got is None or not is_right(other, case, got):
                return False
        return True

    def reached_by_right(chosen: Sequence[Candidate]) -> frozenset[int]:
        some: set[int] = set()
        for other in (LESSONS[name] for name in right if name not in ours):
            case = _cases(other.name)[0]
            some |= trials.places(other.name, chosen, (smaller(other, case, STEPS[0]) or case).args) or frozenset()
        for case in right_ones(stage, tried, is_wrong):
            some |= trials.places(stage.name, chosen, case.args) or frozenset()
        return frozenset(some)

    each = (probes(stage, some, is_wrong) for some in (_cases(stage.name), _further(stage.name), asked))
    if not (tried := next(filter(None, each), [])):
        return None
    innocent = [*(name for name in right if name not in PICTURES), *ours]
    run, values = partial(trials.run, stage.name, innocent), partial(trials.values, stage.name)
    runner = Runner(run, partial(trials.places, stage.name), reached_by_right, values)
    further = partial(_further, stage.name)
    right_in: Callable[[Case, Any], bool] = partial(is_repaired, stage)
    more_time = lambda: _clock(child) < until  # noqa: E731
    wrong_beside = cache(lambda: _some_cases(others, is_wrong, CASES_OF_WRONG))
    helps = lambda candidate: _helps(candidate, trials, innocent, wrong_beside())  # noqa: E731
    return repair(cells, stage.name, tried, right_in, runner, more_time, innocent, known, further, keeps, helps,
                  partial(_clock, child))  # fmt: skip


def _some_cases(stages: Sequence[Stage], wanted: Callable[[Case, Stage], bool], most: int) -> list[tuple[Stage, Case]]:
    """The first cases of each stage that are wanted, pictures thinned."""
    some: list[tuple[Stage, Case]] = []
    for stage in stages:
        cases = (smaller(stage, case, STEPS[-1]) or case for case in _cases(stage.name))
        some += itertools.islice(((stage, case) for case in cases if wanted(case, stage)), most)
    return some


def _helps(
    candidate: Candidate, trials: "_Trials", innocent: Sequence[str], beside: Sequence[tuple[Stage, Case]]
) -> bool:
    """Whether one of these cases becomes right, or none runs what the change is in."""
    runs_it = False
    for stage, case in beside:
        if trials.places(stage.name, [candidate], case.args):
            (got,) = trials.run(stage.name, innocent, [candidate], case.args, False)
            if got is not None and is_right(stage, case, got):
                return True
            runs_it = True
    return not runs_it


CASES_OF_RIGHT = 2
"""Cases of each function that is right, in which a change has to leave it right."""
CASES_OF_WRONG = 3
"""Cases of each other function that is wrong, of which a change that it runs too has to make one right."""


class _Trials:
    """Candidates that run in the sandbox: each code is sent once."""

    def __init__(self, child: Sandbox) -> None:
        self.child = child
        self.sent: dict[bytes, int] = {}

    def run(
        self, function: str, innocent: Sequence[str], chosen: Sequence[Candidate], arguments: Sequence[Any],
        changed: bool,
    ) -> Answers:  # fmt: skip
        if not chosen:
            return []
        settings = [[list(pair) for pair in c.setting] for c in chosen]
        answer = self.child.call(CALLED, function, *self._codes(chosen), settings, list(arguments), A_CALL, changed,
                                 list(innocent))  # fmt: skip
        if answer.problem or len(answer.arrays) != 2:
            return [None] * len(chosen)
        shapes, numbers = answer.arrays
        try:
            return _read([int(n) for n in shapes.ravel()], numbers.astype(float).ravel(), len(chosen))
        except (IndexError, ValueError, OverflowError):  # the submission's own doing
            return [None] * len(chosen)

    def places(self, function: str, chosen: Sequence[Candidate], arguments: Sequence[Any]) -> frozenset[int] | None:
        one_each = list({c.codes: c for c in chosen}.values())
        answer = self.child.call(PLACES, function, *self._codes(one_each), list(arguments), A_CALL)
        return None if answer.problem or not answer.arrays else frozenset(int(n) for n in answer.arrays[0].ravel())

    def values(self, function: str, chosen: Sequence[Candidate], arguments: Sequence[Any]) -> Rows:
        settings = [[list(pair) for pair in c.setting] for c in chosen]
        answer = self.child.call(VALUES, function, *self._codes(chosen), settings, list(arguments), VALUES_SECONDS)
        if answer.problem or not answer.arrays or answer.arrays[0].ndim != 2 or answer.arrays[0].shape[1] != 4:
            return ()
        return [[int(n) for n in row] for row in answer.arrays[0]]

    def _codes(self, chosen: Sequence[Candidate]) -> tuple[Any, ...]:
        """The codes that were not sent before, their lengths, and which of all each candidate has; its names."""
        new = [code for code in dict.fromkeys(code for c in chosen for code in c.codes) if code not in self.sent]
        for code in new:
            self.sent[code] = len(self.sent)
        codes, lengths = np.frombuffer(b"".join(new), np.uint8), np.array([len(code) for code in new], int)
        return codes, lengths, [[self.sent[code] for code in c.codes] for c in chosen], [list(c.names) for c in chosen]


def _read(shapes: list[int], numbers: np.ndarray, count: int) -> Answers:
    """The arrays of each candidate, from the numbers of all and their shapes."""
    made: Answers = []
    at = start = 0
    for _ in range(count):
        arrays = []
        number, at = shapes[at], at + 1
        for _ in range(min(number, 8)):
            shape, at = shapes[at + 1 : at + 1 + shapes[at]], at + 1 + shapes[at]
            size = int(np.prod(shape))
            arrays.append(numbers[start : start + size].reshape(shape))
            start += size
        made.append(None if number < 0 else tuple(arrays))
    return made
