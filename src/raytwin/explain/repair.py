"""Find a slip in a student's own text: the change of one place that makes every value correct, and its line.

The operators that make mistakes of the textbook make repairs of a text. Each change is compiled here, run where the
student's code may run (`attempt`, in the sandbox or in this process), and judged here. One that makes every case
correct is a proof: it needs no catalogue. A search ends after a fixed amount of work, not of seconds: it finds the same
on a busy machine.
"""

import ast
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from raytwin.explain.edit import Edit, code_of
from raytwin.explain.edits import edits, is_setting
from raytwin.explain.function_text import Cells, file_of, names_bound, statements_of

Answers = list[tuple[np.ndarray, ...] | None]
Lines = Set[tuple[str, int]]
"""(name of the outermost function or class, line) of lines that run."""
CLEARED_WEIGHT = 0.6
"""Weight added to a change of a line that correct functions run, too."""
WEIGHT_PER_TENFOLD = 0.3
"""Weight added per factor of ten in the number of changes of one kind, which share the kind's probability."""
RIVALS_WITHIN = 0.3
"""Weight by which a rival may exceed the first change that fits and still leave open which one is meant."""
TRIED_FOR_RIVALS = 300
"""Changes tried after the first that fits, to find rivals."""
AT_ONCE = 48
"""Changes tried per call of the sandbox."""
LONGEST_SHOWN = 100
"""Characters of a line that a message shows."""
SECONDS_A_TRY = 0.25
"""Upper limit of CPU seconds per change, unless a multiple of the student's own time is more."""
LINES_A_TRY = 400
"""Fixed work per try, in lines: compiling the change and calling the function."""


@dataclass
class Work:
    """Work that a search has left, in executed lines of Python (about 1 µs each, 5 µs with NumPy)."""

    left: float


@dataclass(frozen=True)
class Repair:
    """`line` of `cell` has `before`; `after` in its place makes everything correct. `operator`: what was wrong.

    `beside`: the other place, where one change has two that no line shows together. `sure`: whether it helps all that
    fails and runs it, too, and no other line can be changed as well. `rivals`: changes of other lines that make
    everything correct, too.
    """

    cell: str
    line: int
    operator: str
    before: str
    after: str
    tried: int = 0
    candidate: "Candidate | None" = field(default=None, compare=False)
    beside: "Repair | None" = None
    sure: bool = True
    rivals: tuple["Candidate", ...] = field(default=(), compare=False)

    def hint(self, level: int) -> str:
        """1: where. 2: what is wrong there, too. 3: what to write, too. Empty for 0."""
        if level < 1:
            return ""
        if self.beside is not None:
            return f"two changes make everything correct: {self._alone(level)}; and {self.beside.hint(level)}"
        return self._alone(level)

    def _alone(self, level: int) -> str:
        where = f"{self.cell + ', ' if self.cell.startswith('cell ') else ''}line {self.line}"
        if level == 1:
            return f"look at {where}: a change there makes everything correct"
        if level == 2:
            return f"{where}: {self.operator} in `{self.before}`"
        return f"{where}: {self.operator}; `{self.after}` in place of `{self.before}` makes everything correct"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A top-level statement of `cell` with an edit in it."""

    cell: str
    statement: ast.stmt
    edit: Edit

    @property
    def names(self) -> tuple[str, ...]:
        """The names that its code binds anew."""
        return names_bound(self.statement)

    @cached_property
    def code(self) -> bytes:
        """Empty where it is no Python."""
        self.edit.locate()
        changed = self.edit.applied(self.statement)
        return code_of(changed if isinstance(changed, list) else [changed])

    def runs_in(self, lines: Lines) -> bool:
        """Whether a line that it changes is among these."""
        return any((name, getattr(old, "lineno", 0)) in lines for name in self.names for old, _ in self.edit.parts)


@dataclass(frozen=True)
class Runner:
    """Where candidates run.

    `run(candidates, arguments, changed)`: what the function returns with each; None: it raised, it took too long, or,
    if `changed`, it returns what it does without.
    `lines(arguments)`: the lines that a call runs, each as often; None: unknown.
    `correct_lines()`: those that correct functions and correct cases run.
    `work`: what may be done.
    """

    run: Callable[[Sequence[Candidate], Sequence[Any], bool], Answers]
    lines: Callable[[Sequence[Any]], Counter[tuple[str, int]] | None]
    correct_lines: Callable[[], Lines] = frozenset
    work: Work = field(default_factory=lambda: Work(math.inf))


def repair(
    cells: Cells, function: str, cases: Sequence[Any], is_right: Callable[[Any, Any], bool], runner: Runner,
    innocent: Sequence[str] = (), known: Sequence[Candidate] = (), further: Callable[[], Sequence[Any]] = tuple,
    keeps: Callable[[Candidate], bool] = lambda candidate: True,
    helps: Callable[[Candidate], bool] = lambda candidate: True,
    words: Set[str] | None = None,
) -> Repair | None:  # fmt: skip
    """Return the lightest change of one place after which `function` is correct in all cases; None if none is found.

    `cases` have `args`; the first is one that is wrong. `is_right(case, arrays)`. `innocent`: functions that are
    correct by their own tests. `known`: what has made other functions correct is tried first. Where one fits, others
    are looked for that weigh hardly more: a change of another line that does as well leaves open which of
    them is meant. `further()`: cases that a change must make correct as well before it counts as proved: by chance it
    may fit `cases`. `keeps(candidate)`: whether what is correct beside the function stays so. `helps(candidate)`:
    whether other functions that fail and run the changed place become correct in a case; a change that does not may
    fit by chance, and others are tried before it. `words`: those of the function's correct form. A change that brings
    in others than these and the text's own keeps no meaning, and is none. None: any.
    """
    search = _ChangeSearch(cells, function, innocent, runner, cases[0], words)

    def passing(left: list[Candidate], some: Sequence[Any]) -> list[Candidate]:
        for case in some:
            if not left:
                break
            runner.work.left -= len(left) * search.lines_a_try
            answers = runner.run(left, case.args, case is cases[0])
            left = [c for c, got in zip(left, answers, strict=True) if got is not None and is_right(case, got)]
        return left

    tried, fits = 0, _Fits(search.weight)
    unsure: Repair | None = None
    for chunks in ([list(known)], search.candidates(rare=False), search.candidates(rare=True)):
        for chunk in chunks:
            if runner.work.left <= 0 or fits.are_all(chunk, tried):
                return fits.best() or unsure
            tried += len(chunk)
            left = passing(chunk, cases)
            fitting = [c for c in passing(left, further() if left else ()) if keeps(c)]
            helpful = [c for c in fitting if helps(c)]
            fits.add(helpful, tried)
            if fitting and not helpful:
                unsure = unsure or replace(_as_repair(fitting[0]), tried=tried, candidate=fitting[0], sure=False)
        if found := fits.best():
            return found
    return unsure


class _Fits:
    """The changes that make everything correct: the lightest, and those that weigh hardly more."""

    def __init__(self, weight: Callable[[Candidate], float]) -> None:
        self.weight = weight
        self.some: list[Candidate] = []
        self.tried, self.limit = 0, math.inf

    def add(self, some: Sequence[Candidate], tried: int) -> None:
        if some and not self.some:
            self.tried, self.limit = tried, self.weight(some[0]) + RIVALS_WITHIN
        self.some += [c for c in some if self.weight(c) <= self.limit]

    def are_all(self, following: Sequence[Candidate], tried: int) -> bool:
        """Whether what follows weighs more, or enough was tried since."""
        farther = bool(following) and self.weight(following[0]) > self.limit
        return bool(self.some) and (farther or tried > self.tried + TRIED_FOR_RIVALS)

    def best(self) -> Repair | None:
        """The first. It is sure if no rival changes other lines, and if it is not only a different setting."""
        if not self.some:
            return None
        first, *others = self.some
        rivals = tuple(c for c in others if not _lines(c) & _lines(first))
        sure = not rivals and not _is_setting(first)
        return replace(_as_repair(first), tried=self.tried, candidate=first, sure=sure, rivals=rivals)


def _is_setting(c: Candidate) -> bool:
    """Whether it changes a large integer that is not an index, such as a number of steps."""
    indices = (n.slice for n in ast.walk(c.statement) if isinstance(n, ast.Subscript))
    old = c.edit.old
    return isinstance(old, ast.Constant) and is_setting(old) and all(old is not n for i in indices for n in ast.walk(i))


def _lines(c: Candidate) -> set[tuple[str, int]]:
    """The lines of the text that it changes: (cell, line)."""
    places = [old for old, _ in c.edit.parts] + ([c.edit.moved] if c.edit.moved is not None else [])
    return {(c.cell, _as_repair(c).line), *((c.cell, getattr(p, "lineno", 0)) for p in places)}


def _as_repair(best: Candidate) -> Repair:
    """The statement before and after, if it fits on a line; otherwise the expression that differs."""
    edit = best.edit
    if edit.moved is not None:
        text = ast.unparse(edit.moved).splitlines()[0]
        return Repair(best.cell, edit.moved.lineno, edit.operator, text, f"{text} (first in the loop)")
    if not isinstance(edit.new, list):
        if (whole := _shown(best.statement, edit)) is not None:
            return Repair(best.cell, edit.line, edit.operator, ast.unparse(whole), ast.unparse(edit.applied(whole)))
        if edit.also:
            (old, new), *also = edit.also
            rest = Edit(edit.operator, edit.weight, old, new, tuple(also))
            first = _as_repair(replace(best, edit=replace(edit, also=())))
            return replace(first, beside=_as_repair(replace(best, edit=rest)))
    if edit.operator.startswith(("the return", "the last line")) and isinstance(edit.old, ast.For | ast.While | ast.If):
        last = edit.old.body[-1]
        text, outer = ast.unparse(last).splitlines()[0], "condition" if isinstance(edit.old, ast.If) else "loop"
        return Repair(best.cell, last.lineno, edit.operator, text, f"{text} (after the {outer})")
    return Repair(best.cell, edit.line, edit.operator, edit.before.splitlines()[0], edit.after.splitlines()[0])


def _shown(tree: ast.AST, edit: Edit) -> ast.AST | None:
    """The largest part of a simple statement that contains all changes and fits on a line."""
    for one in ast.walk(tree):
        if isinstance(one, ast.expr) or (isinstance(one, ast.stmt) and not hasattr(one, "body")):
            inside = set(map(id, ast.walk(one)))
            text = ast.unparse(one) if all(id(old) in inside for old, _ in edit.parts) else "\n"
            if len(text) <= LONGEST_SHOWN and "\n" not in text:
                return one
    return None


# ------------------------------------------------------------------------------------------ candidates


@cache
def kind_of(operator: str) -> str:
    """An operator's words without the student's own names.

    >>> kind_of("`u` should be `v`"), kind_of("the divisor dd is missing")
    ('... should be ...', 'the divisor ... is missing')
    """
    return re.sub(r"`[^`]*`|(?<=factor )\w+|(?<=divisor )\w+|(?<=term )\w+", "...", operator)


class _ChangeSearch:
    """All changes of the statements that a function is made of. `wrong`: a case that it has wrong."""

    def __init__(
        self, cells: Cells, function: str, innocent: Sequence[str], runner: Runner, wrong: Any, words: Set[str] | None
    ) -> None:
        reached = statements_of(cells, function, innocent)
        self.reached = self._without_what_differs(reached, runner, wrong)
        self.file = file_of(cells, [statement for _, statement in reached])
        self.running = runner.lines(wrong.args)
        self.lines_a_try = LINES_A_TRY + sum((self.running or {}).values())
        self.cleared = runner.correct_lines()
        self.words = None if words is None else words | self.file.own_words
        self.many: Counter[str] = Counter()
        """Kind -> changes among those that are tried now."""

    def candidates(self, rare: bool) -> Iterator[list[Candidate]]:
        """Yield the usual changes or the rare ones, the lightest first, AT_ONCE at a time: those that compile."""
        found = [Candidate(cell, s, edit) for cell, s in self.reached
                 for edit in edits(s, self.file, rare, partial(self._runs, s))]  # fmt: skip
        self.many = Counter(kind_of(c.edit.operator) for c in found)
        found.sort(key=self.weight)
        for k in range(0, len(found), AT_ONCE):
            yield [c for c in found[k : k + AT_ONCE] if self._keeps_meaning(c.edit) and c.code]

    def weight(self, c: Candidate) -> float:
        """Larger for less likely changes."""
        shared = WEIGHT_PER_TENFOLD * math.log10(max(1, self.many[kind_of(c.edit.operator)]))
        cleared = bool(self.cleared) and c.runs_in(self.cleared)
        return c.edit.weight + shared + CLEARED_WEIGHT * cleared

    def _runs(self, outermost: ast.stmt, one: ast.stmt) -> bool:
        return self.running is None or _runs(outermost, one, self.running.keys())

    def _keeps_meaning(self, edit: Edit) -> bool:
        """Whether all that it brings in is a word of the text, or of the function's correct form."""
        if self.words is None:
            return True
        some = [one for _, new in edit.parts for one in (new if isinstance(new, list) else [new])]
        nodes = [n for one in some for n in ast.walk(one)]
        return {n.id if isinstance(n, ast.Name) else n.attr for n in nodes
                if isinstance(n, ast.Name | ast.Attribute)} <= self.words  # fmt: skip

    @staticmethod
    def _without_what_differs(
        reached: list[tuple[str, ast.stmt]], runner: Runner, wrong: Any
    ) -> list[tuple[str, ast.stmt]]:
        """Leave out statements that behave differently when compiled again unchanged.

        Such as a function that is wrapped after its definition, or that counts its calls.
        """
        anew = [Candidate(cell, one, Edit("", 0.0, one, [one])) for cell, one in reached]
        answers = runner.run(anew, wrong.args, True)
        return [one for one, got in zip(reached, answers, strict=True) if got is None]


def _runs(outermost: ast.stmt, one: ast.stmt, lines: Lines) -> bool:
    """Whether one of the statement's own lines, without those of statements in it, is among the lines."""
    last = min([one.end_lineno or one.lineno, *(s.lineno - 1 for s in getattr(one, "body", []))])
    names = (*names_bound(outermost), "<lambda>")
    return any((name, line) in lines for name in names for line in range(one.lineno, max(last, one.lineno) + 1))
