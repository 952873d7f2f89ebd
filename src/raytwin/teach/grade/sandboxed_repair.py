"""The line to look at, found by changing the submission's text.

Runs after grading, in a sandbox of its own, and changes no points. Numbers alone leave the sandbox, to be judged here.
"""

import contextlib
import dataclasses
import inspect
import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin.explain import attempt
from raytwin.explain.catalogue import FACTS
from raytwin.explain.edit import Edit
from raytwin.explain.repair import (
    SECONDS_A_TRY,
    Answers,
    Candidate,
    Cells,
    Lines,
    Repair,
    Runner,
    Work,
    kind_of,
    repair,
)
from raytwin.teach.contract.check_function import is_repaired, is_right
from raytwin.teach.contract.repair_function import STRIDES, further_probes, probes, right_ones, smaller, words_of
from raytwin.teach.contract.stage import Case, Stage
from raytwin.teach.contract.stage_result import says_why, with_hint
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.follow_through import REPLACE, REPLACE_DRIVER, source_of
from raytwin.teach.grade.result import Marked
from raytwin.teach.grade.rubric import PICTURES, Rubric
from raytwin.teach.sandbox.sandbox import Code, Sandbox

WORK_PROVED, WORK_UNNAMED, WORK_IN_ALL = 1.2e6, 3e6, 6e6
"""Most lines of Python that a search runs: for a function with a proved cause, for one without, for a submission."""
MAX_TEXT = 100_000
"""Characters of the longest text that is searched: one of megabytes takes minutes to parse."""
PROBE_SEED = 1_618_033
"""Draws the cases that changes are tried in; no points depend on them, so anyone may know it."""
MOST_RETURNED = 8
"""Arrays that are taken of what a function returns."""
CALLED, LINES = "raytwin_attempt", "raytwin_lines"
REPAIR_DRIVER = f"""
{REPLACE_DRIVER}

{inspect.getsource(attempt)}

def {CALLED}(function, codes, lengths, names, arguments, seconds, changed):
    import marshal
    import numpy
    ends = numpy.cumsum(lengths).astype(int)
    chosen = [marshal.loads(codes[end - n : end].tobytes()) for end, n in zip(ends, lengths)]
    made = attempt(globals(), function, chosen, names, arguments, seconds, changed)
    some = [() if one is None else one[:{MOST_RETURNED}] for one in made]
    counts = numpy.array([-1 if one is None else len(each) for one, each in zip(made, some)], int)
    return (counts, *(array for each in some for array in each))

def {LINES}(function, arguments, seconds):
    import numpy
    found = lines_run(globals(), function, arguments, seconds)
    names = "\\n".join(name for name, _ in found)
    lines = numpy.array([(line, times) for (_, line), times in found.items()], int)
    return numpy.frombuffer(names.encode(), numpy.uint8), lines
"""
"""Runs in the sandbox, behind the submission's own text and in its module."""


class LineSearch:
    """Finds the lines to look at in one submission, within WORK_IN_ALL and up to the rubric's level of `hints`.

    `found`: function -> the change that corrects it. One process serves all further calls of the submission, since a
    start costs as much as many calls. A text that is nested too deeply for Python to read is not changed.
    """

    def __init__(self, rubric: Rubric, code: Code | None) -> None:
        self.rubric, self.code, self.left = rubric, code if code and code.kind == "python" else None, WORK_IN_ALL
        self.found: dict[str, Repair] = {}
        self.cells: Cells = code.cells or (("", code.source),) if code else ()
        self.hints = rubric.hints if self.code and sum(len(text) for _, text in self.cells) <= MAX_TEXT else 0
        self.trials: _Trials | None = None
        self.replaced: tuple[str, ...] = ()

    def __enter__(self) -> "LineSearch":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def child_with(self, names: Sequence[str] = ()) -> Sandbox:
        """The process, with correct functions of these names in place of the student's; a new one if it ended."""
        assert self.code is not None
        if self.trials is None or self.trials.child.problem.problem:
            self.close()
            asked = (*self.rubric.functions, CALLED, LINES, REPLACE)
            own = dataclasses.replace(self.code.followed_by(REPAIR_DRIVER), asked=asked)
            child = Sandbox(own, self.rubric.limits, (Path(self.rubric.folder), Path.cwd())).__enter__()
            self.trials, self.replaced = _Trials(child), ()
        if self.replaced != tuple(names):
            self.replaced = tuple(names)
            self.trials.child.call(REPLACE, source_of(names), list(names))
        return self.trials.child

    def with_mistake(self, m: Marked) -> Marked:
        """The exercise with the change that repairs it, if one does, as its mistake."""
        found = self.found.get(m.stage)
        if found is None or m.status == "pass" or m.because:
            return m
        return msgspec.structs.replace(m, mistakes=(*m.mistakes, found.hint(3)))

    def close(self) -> None:
        """End the process."""
        if self.trials is not None:
            self.trials.child.close()

    def with_lines(
        self,
        exercises: Sequence[Marked],
        right: Sequence[str],
        replaced: Sequence[str] = (),
        beside: Sequence[str] = (),
        pictures: Sequence[tuple[str, Case]] = (),
    ) -> list[Marked]:
        """Return the exercises, wrong ones with the line to look at.

        `right`: functions that pass their own tests; they are not changed. `replaced`: failed functions that run as
        correct ones instead. `beside`: further wrong functions; a change that corrects one of them, too, is its line.
        `pictures`: (function, case) of wrong pictures, for mistakes that the fixed cases are too small to show.
        """
        wrong = [e for e in exercises if e.status in ("fail", "error")]
        tried = [e for e in wrong if self.hints and e.stage not in self.found]
        if tried and CALLED in self.child_with(replaced).functions and self.trials is not None:
            self._repair(tried, right, replaced, beside, pictures, self.trials)
        return [
            _with_hint(e, self.found[e.stage], self.hints) if e in wrong and e.stage in self.found else e
            for e in exercises
        ]

    def _repair(
        self, tried: Sequence[Marked], right: Sequence[str], replaced: Sequence[str], beside: Sequence[str],
        pictures: Sequence[tuple[str, Case]], trials: "_Trials",
    ) -> None:  # fmt: skip
        for stage in dict.fromkeys(e.stage for e in tried):
            if stage in trials.child.functions:
                most = WORK_PROVED if all(_is_proved(e) for e in tried if e.stage == stage) else WORK_UNNAMED
                before = min(most, self.left)
                work = Work(before)
                fitting = [(r.candidate, *r.rivals) for r in self.found.values() if r.candidate and not replaced]
                known = list(dict.fromkeys(itertools.chain(*fitting)))
                others = [LESSONS[e.stage] for e in tried if e.stage != stage]
                asked = [case for name, case in pictures if name == stage]
                with contextlib.suppress(RecursionError, MemoryError):
                    made = _repair(LESSONS[stage], self.cells, trials, work, right, replaced, known, others, asked)
                    if made is not None:
                        self.found[stage] = made
                self.left -= before - work.left
        for stage in (name for name in beside if name in trials.child.functions):
            some = (r for r in self.found.values() if (r.sure or r.rivals) and _makes_right(r, stage, trials))
            if one := next(some, None):
                self.found[stage] = one
        if any(e.stage in PICTURES and e.stage not in self.found for e in tried):
            # A change in what only some pictures are made of, where others stay wrong, may hide what is wrong in all.
            unsure = {k: dataclasses.replace(r, sure=False) for k, r in self.found.items() if k in PICTURES}
            self.found |= unsure


def _makes_right(found: Repair, stage: str, trials: "_Trials") -> bool:
    """Whether the change also corrects another function, which is wrong without it."""

    def right_with(change: Candidate) -> bool:
        each = ((case, trials.run(stage, [change], case.args, False)[0]) for case in (*_cases(stage), *_further(stage)))
        return all(got is not None and is_repaired(LESSONS[stage], case, got) for case, got in each)

    change = found.candidate
    if change is None:
        return False
    nothing = Candidate(change.cell, change.statement, Edit("", 0.0, change.statement, [change.statement]))
    return not right_with(nothing) and right_with(change)


@cache
def _cases(stage: str) -> list[Case]:
    """Cases that are the same for all: no points depend on them."""
    return LESSONS[stage].cases(PROBE_SEED)


@cache
def _further(stage: str) -> list[Case]:
    return further_probes(LESSONS[stage], PROBE_SEED)


def _is_proved(exercise: Marked) -> bool:
    return says_why(exercise.sureness, exercise.faults)


def _with_hint(exercise: Marked, repair: Repair, level: int) -> Marked:
    """The exercise with a repair in its place among the sentences."""
    raised = exercise.status == "error"
    sentences = with_hint(exercise.sentences, repair.hint(level), exercise.sureness, exercise.faults, raised)
    # A likely cause of pictures, which saw no text, may say something else than the line: then neither is proved.
    other = (
        exercise.stage in PICTURES and exercise.sureness == "likely" and any(n not in FACTS for n, _ in exercise.faults)
    )
    sureness = "proved" if _is_proved(exercise) or (repair.sure and not other) else "likely"
    return msgspec.structs.replace(exercise, sentences=sentences, sureness=sureness, repair=kind_of(repair.operator))


def _repair(
    stage: Stage, cells: Cells, trials: "_Trials", work: Work, right: Sequence[str], ours: Sequence[str],
    known: Sequence[Candidate], others: Sequence[Stage], asked: Sequence[Case],
) -> Repair | None:  # fmt: skip
    child = trials.child

    def is_wrong(case: Case, of: Stage = stage) -> bool:
        answer = child.call(of.name, *case.args)
        return bool(answer.problem or of.changes(answer.changed)) or not is_right(of, case, answer.arrays)

    @cache
    def right_beside() -> list[tuple[Stage, Case]]:
        rights = [LESSONS[name] for name in right]
        return _some_cases(rights, lambda case, of: not is_wrong(case, of), CASES_OF_RIGHT)

    def keeps(candidate: Candidate) -> bool:
        """Whether it leaves right what is: a change that mends one function and spoils another is none."""
        for other, case in right_beside():
            (got,) = trials.run(other.name, [candidate], case.args, False)
            if got is None or not is_right(other, case, got):
                return False
        return True

    def run(chosen: Sequence[Candidate], arguments: Sequence[Any], changed: bool) -> Answers:
        if child.problem.problem:  # the process has ended
            work.left = 0
        return trials.run(stage.name, chosen, arguments, changed)

    def correct_lines() -> Lines:
        others = [LESSONS[name] for name in right if name not in ours]
        firsts = [
            (other.name, smaller(other, _cases(other.name)[0], STRIDES[0]) or _cases(other.name)[0]) for other in others
        ]
        firsts += [(stage.name, case) for case in right_ones(stage, tried, is_wrong)]
        return frozenset().union(*(trials.lines(name, case.args) or () for name, case in firsts))

    each = (probes(stage, some, is_wrong) for some in (_cases(stage.name), _further(stage.name), asked))
    if not (tried := next(filter(None, each), [])):
        return None
    innocent = [*(name for name in right if name not in PICTURES), *ours]
    runner = Runner(run, partial(trials.lines, stage.name), correct_lines, work)
    wrong_beside = cache(lambda: _some_cases(others, is_wrong, CASES_OF_WRONG))
    helps = lambda candidate: _helps(candidate, trials, wrong_beside())  # noqa: E731
    return repair(cells, stage.name, tried, partial(is_repaired, stage), runner, innocent, known,
                  partial(_further, stage.name), keeps, helps, words_of(stage.name))  # fmt: skip


def _some_cases(stages: Sequence[Stage], wanted: Callable[[Case, Stage], bool], most: int) -> list[tuple[Stage, Case]]:
    """The first cases of each stage that are wanted, pictures thinned."""
    some: list[tuple[Stage, Case]] = []
    for stage in stages:
        cases = (smaller(stage, case, STRIDES[-1]) or case for case in _cases(stage.name))
        some += itertools.islice(((stage, case) for case in cases if wanted(case, stage)), most)
    return some


def _helps(candidate: Candidate, trials: "_Trials", beside: Sequence[tuple[Stage, Case]]) -> bool:
    """Whether one of these cases becomes right, or none runs what the change is in."""
    runs_it = False
    for stage, case in beside:
        if candidate.runs_in((trials.lines(stage.name, case.args) or {}).keys()):
            (got,) = trials.run(stage.name, [candidate], case.args, False)
            if got is not None and is_right(stage, case, got):
                return True
            runs_it = True
    return not runs_it


CASES_OF_RIGHT = 2
"""Cases of each function that is correct, in which a change has to leave it correct."""
CASES_OF_WRONG = 3
"""Cases of each other function that is wrong, of which a change that it runs too has to make one right."""


class _Trials:
    """Candidates that run in the sandbox."""

    def __init__(self, child: Sandbox) -> None:
        self.child = child

    def run(self, function: str, chosen: Sequence[Candidate], arguments: Sequence[Any], changed: bool) -> Answers:
        if not chosen:
            return []
        codes, lengths = np.frombuffer(b"".join(c.code for c in chosen), np.uint8), [len(c.code) for c in chosen]
        answer = self.child.call(CALLED, function, codes, lengths, [list(c.names) for c in chosen], list(arguments),
                                 SECONDS_A_TRY, changed, most_arrays=1 + MOST_RETURNED * len(chosen))  # fmt: skip
        counts, *arrays = answer.arrays or (np.zeros(0),)
        if counts.shape != (len(chosen),) or counts.dtype.kind != "i":  # a problem, or the submission's own doing
            return [None] * len(chosen)
        each = (array.astype(float) for array in arrays)
        return [None if n < 0 else tuple(itertools.islice(each, int(n))) for n in counts.tolist()]

    def lines(self, function: str, arguments: Sequence[Any]) -> Counter[tuple[str, int]] | None:
        answer = self.child.call(LINES, function, list(arguments), 10 * SECONDS_A_TRY)
        if answer.problem or len(answer.arrays) != 2:
            return None
        names, places = answer.arrays
        try:
            read = names.astype(np.uint8).tobytes().decode(errors="replace").split("\n")
            return Counter({(name, int(line)): int(n) for name, (line, n) in zip(read, places, strict=False)})
        except (ValueError, TypeError):  # the submission's own doing
            return None
