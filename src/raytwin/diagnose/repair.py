"""A slip found in a student's own text: the change of one place that makes every value right, its line, and the way.

The same operators that make mistakes of the textbook make repairs of a text. Candidates are compiled here, run where
the student's code may run (`attempt`, in the sandbox or in this process), and judged here again. One that makes every
case right is a proof: it needs no catalogue.
"""

import ast
import itertools
import math
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from raytwin.diagnose.edit import Edit
from raytwin.diagnose.function_text import Cells, file_of, names_bound, statements_of
from raytwin.diagnose.local_values import values_text
from raytwin.diagnose.operators import edits, edits_of_right
from raytwin.diagnose.rewritings import is_setting
from raytwin.diagnose.schemata import Setting, schemata

Answers = list[tuple[np.ndarray, ...] | None]
Rows = Sequence[Sequence[int]]
NONE_SEEN: Mapping[str, int] = {}
COMMON = 0.5
"""By so much less far-fetched is a slip that was seen ten times as often."""
CLEARED = 0.6
"""By so much more far-fetched is a change of a statement that runs in functions that are right, too."""
SHARE = 0.3
"""By so much more far-fetched is each of ten changes of one kind than a single one: they share the kind's chance."""
AT_ONCE = 48
"""Candidates that are compiled together and tried in one call: a text with thousands of them runs many times slower."""
NEARER = 0.1
"""By so many powers of ten the errors have to become smaller, where none vanishes."""
BEAM = 8
"""Changes that make part of the numbers right, beside which second ones are tried."""
ABOUT = 0.3
"""By so much more far-fetched may be what makes doubtful which change is meant."""
LOOK_ON = 0.5
"""Seconds of computing, at most, for other changes once one fits."""
FIRST = 96
"""Changes that are tried at once; of the others it is asked first what they do where they stand."""
ASKED_AT_ONCE = 480
"""Changes of which this is asked in one run."""
VALUES_SECONDS = 0.5
"""Seconds of computing, for one such run."""
MOST_SHOWN = 100
"""Characters of a line that a message shows."""
A_CALL = 0.25
"""Seconds of computing after which a candidate is given up; or so many times what the student's own function takes."""


@dataclass(frozen=True)
class Repair:
    """`line` of `cell` has `before`; `after` in its place makes everything right. `operator`: what was wrong.

    `beside`: the other of two changes that are needed both. `sure`: whether it helps all that fails and runs it, too,
    and no other line can be changed as well. `rivals`: changes of other lines that make everything right, too.
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
            return f"two changes make everything right: {self._alone(level)}; and {self.beside.hint(level)}"
        return self._alone(level)

    def _alone(self, level: int) -> str:
        where = f"{self.cell + ', ' if self.cell.startswith('cell ') else ''}line {self.line}"
        if level == 1:
            return f"look at {where}: a change there makes everything right"
        if level == 2:
            return f"{where}: {self.operator} in `{self.before}`"
        return f"{where}: {self.operator}; `{self.after}` in place of `{self.before}` makes everything right"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A change: `codes` bind `names` anew, with the change in them where the switch has this `setting`.

    `beside`: the change of which this is made besides.
    """

    cell: str
    statement: ast.stmt
    edit: Edit
    codes: tuple[bytes, ...]
    names: tuple[str, ...]
    setting: Setting
    beside: "Candidate | None" = None


Values = Callable[[Sequence[Candidate]], Rows]


@dataclass(frozen=True)
class Runner:
    """Where candidates run.

    `run(candidates, arguments, changed)`: what the function returns with each; None: it raised, it took too long, or,
    if `changed`, it returns what it does without.
    `places(candidates, arguments)`: the places of their codes that a call reaches; None: unknown.
    `right(candidates)`: those that calls of functions reach that are right; None: unknown.
    `values(candidates, arguments)`: what `local_values` tells of their codes.
    """

    run: Callable[[Sequence[Candidate], Sequence[Any], bool], Answers]
    places: Callable[[Sequence[Candidate], Sequence[Any]], frozenset[int] | None]
    right: Callable[[Sequence[Candidate]], frozenset[int] | None] = lambda candidates: None
    values: Callable[[Sequence[Candidate], Sequence[Any]], Rows] = lambda candidates, arguments: ()

    def alone(self, candidate: Candidate, case: Any) -> tuple[np.ndarray, ...] | None:
        return self.run([candidate], case.args, False)[0]

    def places_in(self, case: Any) -> Callable[[Sequence[Candidate]], frozenset[int] | None]:
        return lambda candidates: self.places(candidates, case.args)

    def values_in(self, case: Any) -> Values:
        return lambda candidates: self.values(candidates, case.args)


def repair(
    cells: Cells, function: str, cases: Sequence[Any], is_right: Callable[[Any, Any], bool], runner: Runner,
    more_time: Callable[[], bool], innocent: Sequence[str] = (), known: Sequence["Candidate"] = (),
    further: Callable[[], Sequence[Any]] = tuple, seen: Mapping[str, int] = NONE_SEEN,
    keeps: Callable[[Candidate], bool] = lambda candidate: True,
    helps: Callable[[Candidate], bool] = lambda candidate: True,
    errors: Callable[[Any, Any], np.ndarray | None] = lambda case, got: None,
    clock: Callable[[], float] = time.process_time,
) -> Repair | None:  # fmt: skip
    """The least far-fetched change of one place after which `function` is right in all cases; None where none is found.

    `cases` have `args`; the first is one that is wrong. `is_right(case, arrays)`. `innocent`: functions that are right
    by their own tests. `more_time()`: whether to go on; `clock()`: seconds. `known`: what has made other functions
    right is tried first. Where one fits, others are looked for that are hardly more far-fetched: a change of another
    line that does as well leaves open which of them is meant.
    `further()`: cases that a change must make right as well before it counts as proved: by chance it may fit `cases`.
    `seen`: how often each kind of slip was made: what is common is tried first. `keeps(candidate)`: whether what is
    right beside the function stays right. `helps(candidate)`: whether other functions that fail and run the changed
    place become right in a case; a change that does not may fit by chance, and others are tried before it.
    `errors(case, arrays)`: by how much of what is allowed numbers are off; None: of other shapes. Where no change alone
    does, second ones are tried beside those that make most numbers right.
    """
    tried = 0
    unsure: Repair | None = None
    first = cases[0]
    partial = _Partial(lambda got: errors(first, got))

    def passing(left: list[Candidate], some: Sequence[Any]) -> list[Candidate]:
        for k, case in enumerate(some):
            if not left:
                break
            answers = runner.run(left, case.args, case is first)
            if case is first:
                partial.add(left, answers, lambda one: runner.alone(one, first))
            left = [c for c, got in zip(left, answers, strict=True) if got is not None and is_right(case, got)]
            if k == 0:
                search.passed(left)
        return left

    def searched(sources: Iterable[tuple[Sequence[Any], Iterable[list[Candidate]]]]) -> Repair | None:
        nonlocal tried, unsure
        fits = _Fits(search.weight, clock)
        for order, source in sources:
            for chunk in source:
                if not more_time() or fits.are_all(chunk):
                    return fits.best()
                tried += len(chunk)
                left = passing(chunk, order)
                fitting = [c for c in passing(left, further() if left else ()) if keeps(c)]
                helpful = [c for c in fitting if helps(c)]
                fits.add(helpful, tried)
                if fitting and not helpful:
                    unsure = unsure or replace(_as_repair(fitting[0]), tried=tried, candidate=fitting[0], sure=False)
            if found := fits.best():
                return found
        return None

    reached, every = (statements_of(cells, function, names) for names in (innocent, ()))
    known_lines = {(cell, statement.lineno) for cell, statement in reached}
    aside = [(cell, statement) for cell, statement in every if (cell, statement.lineno) not in known_lines]
    search = _Search(cells, reached, seen, runner.places_in(first), runner.right, aside, more_time,
                     lambda some: runner.run(some, first.args, False))  # fmt: skip
    values = runner.values_in(first)

    single = (search.candidates(rare, values) for rare in (False, True))
    alone = [(cases, source) for source in ([list(known)], *single)]
    usual, rare = (_beside(search, partial, cases, is_right, runner, rare) for rare in (False, True))
    return searched(itertools.chain(alone[:2], usual, alone[2:], rare)) or unsure


def _beside(
    search: "_Search", partial: "_Partial", cases: Sequence[Any], is_right: Callable[[Any, Any], bool], runner: Runner,
    rare: bool,
) -> Iterator[tuple[Sequence[Any], Iterator[list[Candidate]]]]:  # fmt: skip
    """Second changes beside each of the best first ones, and the cases, first one that is wrong with the first."""
    for one in partial.best():
        wrong = [case for case in cases if (got := runner.alone(one, case)) is None or not is_right(case, got)]
        if wrong:
            order = [wrong[0], *(case for case in cases if case is not wrong[0])]
            yield order, search.beside(one, rare, runner.places_in(wrong[0]), runner.values_in(wrong[0]))


class _Fits:
    """The changes that make everything right: the least far-fetched one, and those that are hardly more so."""

    def __init__(self, weight: Callable[[Candidate], float], clock: Callable[[], float]) -> None:
        self.weight, self.clock = weight, clock
        self.some: list[Candidate] = []
        self.tried, self.limit, self.until = 0, math.inf, math.inf

    def add(self, some: Sequence[Candidate], tried: int) -> None:
        if some and not self.some:
            self.tried, self.limit, self.until = tried, self.weight(some[0]) + ABOUT, self.clock() + LOOK_ON
        self.some += [c for c in some if self.weight(c) <= self.limit]

    def are_all(self, following: Sequence[Candidate]) -> bool:
        """Whether what follows is more far-fetched, or it was looked for long enough."""
        farther = bool(following) and self.weight(following[0]) > self.limit
        return bool(self.some) and (farther or self.clock() > self.until)

    def best(self) -> Repair | None:
        """The first; sure where no other stands on other lines, and it is no other size of a block, or the like."""
        if not self.some:
            return None
        first, *others = self.some
        rivals = tuple(c for c in others if not _lines(c) & _lines(first))
        sure = not rivals and not _is_setting(first)
        return replace(_as_repair(first), tried=self.tried, candidate=first, sure=sure, rivals=rivals)


def _is_setting(c: Candidate) -> bool:
    """Whether it changes a large whole number that is no index."""
    indices = (n.slice for n in ast.walk(c.statement) if isinstance(n, ast.Subscript))
    old = c.edit.old
    return isinstance(old, ast.Constant) and is_setting(old) and all(old is not n for i in indices for n in ast.walk(i))


def _lines(c: Candidate) -> set[tuple[str, int]]:
    """Where it changes the text: (cell, line)."""
    places = [old for old, _ in c.edit.parts] + ([c.edit.moved] if c.edit.moved is not None else [])
    mine = {(c.cell, _as_repair(replace(c, beside=None)).line), *((c.cell, getattr(p, "lineno", 0)) for p in places)}
    return mine | _lines(c.beside) if c.beside is not None else mine


def _as_repair(best: Candidate) -> Repair:
    """The statement on one line, before and after; of what spans more, the expression that differs."""
    if best.beside is not None:
        return replace(_as_repair(best.beside), beside=_as_repair(replace(best, beside=None)))
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
    """The largest part of a simple statement that has all that changes, and fits on a line."""
    for one in ast.walk(tree):
        if isinstance(one, ast.expr) or (isinstance(one, ast.stmt) and not hasattr(one, "body")):
            inside = set(map(id, ast.walk(one)))
            text = ast.unparse(one) if all(id(old) in inside for old, _ in edit.parts) else "\n"
            if len(text) <= MOST_SHOWN and "\n" not in text:
                return one
    return None


# ------------------------------------------------------------------------------------------ candidates


@cache
def kind_of(operator: str) -> str:
    """An operator's words without the student's own names.

    >>> kind_of("`u` stands for `v`"), kind_of("the divisor dd is missing")
    ('... stands for ...', 'the divisor ... is missing')
    """
    return re.sub(r"`[^`]*`|(?<=factor )\w+|(?<=divisor )\w+|(?<=term )\w+", "...", operator)


def candidates(
    cells: Cells, function: str, innocent: Sequence[str] = (), seen: Mapping[str, int] = NONE_SEEN,
    places: Callable[[Sequence[Candidate]], frozenset[int] | None] = lambda some: None,
    right: Callable[[Sequence[Candidate]], frozenset[int] | None] = lambda some: None,
) -> Iterator[Candidate]:  # fmt: skip
    """Single changes of what `function` is made of, the least far-fetched first.

    `places(candidates)`: those that a wrong case reaches. Statements that do not run there are left as they are.
    `right(candidates)`: those that functions reach that are right: a mistake there is less likely.
    """
    search = _Search(cells, statements_of(cells, function, innocent), seen, places, right)
    for some in (*search.candidates(False), *search.candidates(True)):
        yield from some


class _Search:
    """All changes of some statements: alone, and beside another change.

    `aside`: what is right alone, but may change arrays that are not its own. `more_time()`: whether to go on making
    changes, of which a long text has so many that to make them takes minutes. `run(candidates)`: a wrong case's values.
    """

    def __init__(
        self, cells: Cells, reached: Sequence[tuple[str, ast.stmt]], seen: Mapping[str, int],
        places: Callable[[Sequence[Candidate]], frozenset[int] | None],
        right: Callable[[Sequence[Candidate]], frozenset[int] | None],
        aside: Sequence[tuple[str, ast.stmt]] = (), more_time: Callable[[], bool] = lambda: True,
        run: Callable[[Sequence[Candidate]], Answers] = lambda some: [None] * len(some),
    ) -> None:  # fmt: skip
        self.aside, self.more_time = aside, more_time
        self.reached, self.seen = reached, seen
        self.file = file_of(cells, [statement for _, statement in reached])
        self.end = 0
        self.made: dict[Any, list[_Change]] = {}
        self.many: Counter[str] = Counter()
        """Kind -> changes among those that are tried now."""
        self.compiled: dict[Edit, Candidate | None] = {}
        self.alike: dict[Edit, list[_Change]] = {}
        self.right: list[Edit] = []
        self.beside_running: dict[Candidate, set[ast.AST] | None] = {}
        self.alone: set[ast.stmt] = set()
        marks = self._marks(reached)
        self._without_what_differs(marks, run)
        self.running = None if self.alone else _nodes(marks, places(marks))
        self.cleared = {id(node) for one in _nodes(marks, right(marks)) or () for node in _own(one)}

    def candidates(self, rare: bool, values: Values = lambda runs: ()) -> Iterator[list[Candidate]]:
        """The usual ones, or the rare. `values(candidates)`: what `local_values` tells in a wrong case."""
        found = [c for cell, statement in self.reached for c in self._changes(cell, statement, rare, self.running)]
        for cell, statement in () if rare else self.aside:
            found += [_Change(cell, statement, edit) for edit in edits_of_right(statement)]
        yield from self._compiled(found, values)

    def beside(
        self, first: Candidate, rare: bool, places: Callable[[Sequence[Candidate]], frozenset[int] | None],
        values: Values,
    ) -> Iterator[list[Candidate]]:  # fmt: skip
        """The changes of the text that has `first` in it; `places` and `values` as for all."""
        made = first.edit.applied(first.statement)
        (statement,) = made if isinstance(made, list) else (made,)
        reached = [(cell, statement if one is first.statement else one) for cell, one in self.reached]
        if first not in self.beside_running:
            marks = self._marks(reached)
            self.beside_running[first] = None if self.alone else _nodes(marks, places(marks))
        running = self.beside_running[first]

        def both(c: Candidate) -> Candidate:
            if c.statement is statement:
                return replace(c, beside=first)
            together = (*first.codes, *c.codes), (*first.names, *c.names), (*first.setting, *c.setting)
            return replace(c, beside=first, codes=together[0], names=together[1], setting=together[2])

        found = [c for cell, one in reached for c in self._changes(cell, one, rare, running)]
        with_first = lambda runs: values([first, *runs])  # noqa: E731
        yield from (list(map(both, some)) for some in self._compiled(found, with_first))

    def weight(self, c: "Candidate | _Change") -> float:
        """How far-fetched it is."""
        shared = SHARE * math.log10(max(1, self.many[kind_of(c.edit.operator)]))
        return _weight(c.edit, self.seen) + shared + CLEARED * (id(c.edit.old) in self.cleared)

    def _changes(self, cell: str, statement: ast.stmt, rare: bool, running: set[ast.AST] | None) -> list["_Change"]:
        inside = running if running is None else frozenset(id(n) for n in ast.walk(statement) if n in running)
        key = statement, rare, inside
        if key not in self.made:
            some = edits(
                statement, self.file, rare, runs=lambda one: self.more_time() and (running is None or one in running)
            )
            self.made[key] = [_Change(cell, statement, edit) for edit in some]
        return self.made[key]

    def _compiled(self, some: Sequence["_Change"], values: Values) -> Iterator[list[Candidate]]:
        """Those that leave Python, AT_ONCE at a time, the least far-fetched first; but for the first ones, those that
        `values` does not dismiss."""
        self.many = Counter(kind_of(c.edit.operator) for c in some)
        ordered = sorted(some, key=self.weight)
        for chunk in itertools.chain(_parts(ordered[:FIRST], AT_ONCE), self._not_dismissed(ordered[FIRST:], values)):
            for (cell, statement), every in _by_statement(c for c in chunk if c.edit not in self.compiled):
                self.compiled |= dict.fromkeys(every)
                self.compiled |= {c.edit: c for c in self._candidates(cell, statement, every)}
            yield [one for c in chunk if (one := self.compiled[c.edit]) is not None]

    def _without_what_differs(self, marks: Sequence[Candidate], run: Callable[[Sequence[Candidate]], Answers]) -> None:
        """Find the statements that a switch alters: their changes are compiled one by one.

        Those of a text that differs even so, as it counts its calls or is wrapped behind its definition, are none.
        """

        def anew(some: Iterable[tuple[str, ast.stmt]]) -> list[Candidate]:
            return [c for cell, one in some for c in self._candidates(cell, one, [Edit("", 0.0, one, [one])])]

        marked = {c.statement for c in marks}
        self.alone = _differing([*marks, *anew(one for one in self.reached if one[1] not in marked)], run)
        gone = _differing(anew(one for one in self.reached if one[1] in self.alone), run)
        self.reached = [one for one in self.reached if one[1] not in gone]

    def _not_dismissed(self, ordered: Sequence["_Change"], values: Values) -> Iterator[Sequence["_Change"]]:
        """AT_ONCE at a time; last come those that did as others, or nothing, each time that was looked at."""
        later: list[_Change] = []
        for some in _parts(ordered, ASKED_AT_ONCE):
            dismissed = self._dismissed(some, values)
            for change in some:
                like, whole = dismissed.get(change.edit, (None, True))
                if not whole:
                    later.append(change)
                elif like is not None:
                    self.alike.setdefault(like, []).append(change)
            for chunk in _parts([c for c in some if c.edit not in dismissed], AT_ONCE):
                yield chunk
                yield from _parts(self._taken(), AT_ONCE)
        yield from _parts(later, AT_ONCE)

    def passed(self, some: Iterable[Candidate]) -> None:
        """These are right in the case that values were told of: so are those with the same values."""
        self.right += [c.edit for c in some]

    def _taken(self) -> list["_Change"]:
        """What was dismissed since it does as a change that turned out to be right in that case."""
        taken = [change for edit in self.right for change in self.alike.pop(edit, [])]
        self.right = []
        return taken

    def _dismissed(self, some: Sequence["_Change"], values: Values) -> dict[Edit, tuple[Edit | None, bool]]:
        """Those that raise, or do in their own statement as another change or nothing: the other, and whether each
        time was looked at."""
        runs: list[Candidate] = []
        at: dict[tuple[int, int], Edit] = {}
        for (cell, statement), every in _by_statement(some):
            code, numbers = values_text(statement, every, len(at))
            at |= {place: edit for edit, place in numbers.items()}
            if code:
                runs.append(Candidate(cell, statement, every[0], (code,), names_bound(statement), ()))
        return {
            at[place, number]: (at.get((place, group - 1)), group < 0 or bool(whole))
            for place, number, group, whole in (values(runs) if runs else ())
            if group != number + 1 and (place, number) in at
        }

    def _marks(self, reached: Sequence[tuple[str, ast.stmt]]) -> list[Candidate]:
        """A candidate for each statement within the reached ones: its place tells whether it runs."""
        marks: list[Candidate] = []
        for cell, statement in reached:
            inner = [n for n in ast.walk(statement) if isinstance(n, ast.stmt) and n is not statement]
            marks += self._candidates(
                cell, statement, [Edit("", 0.0, n, [ast.copy_location(ast.Pass(), n)]) for n in inner]
            )
        return marks

    def _candidates(self, cell: str, statement: ast.stmt, every: Sequence[Edit]) -> Iterator[Candidate]:
        names = names_bound(statement)
        for some, schema in schemata(statement, every, self.end, statement not in self.alone):
            self.end = schema.end
            for edit in some:
                yield Candidate(cell, statement, edit, (schema.code,), names, schema.settings[id(edit)])


def _differing(some: Sequence[Candidate], run: Callable[[Sequence[Candidate]], Answers]) -> set[ast.stmt]:
    """The statements that do something else once they are compiled anew, though nothing is changed."""
    each = list({c.statement: replace(c, setting=()) for c in some}.values())
    if not each:
        return set()
    codes, names = [code for c in each for code in c.codes], [name for c in each for name in c.names]
    nothing = replace(each[0], codes=(), names=())
    as_it_is, made = run([nothing, replace(nothing, codes=tuple(codes), names=tuple(names))])
    if _same(as_it_is, made):
        return set()
    return {c.statement for c, got in zip(each, run(each), strict=True) if not _same(as_it_is, got)}


def _same(a: tuple[np.ndarray, ...] | None, b: tuple[np.ndarray, ...] | None) -> bool:
    if a is None or b is None:
        return a is b
    return len(a) == len(b) and all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


def _by_statement(some: Iterable["_Change"]) -> Iterable[tuple[tuple[str, ast.stmt], list[Edit]]]:
    """The changes of each statement together."""
    of: dict[tuple[str, ast.stmt], list[Edit]] = {}
    for cell, statement, edit in some:
        of.setdefault((cell, statement), []).append(edit)
    return of.items()


def _parts(every: Sequence["_Change"], most: int) -> Iterator[Sequence["_Change"]]:
    return (every[k : k + most] for k in range(0, len(every), most))


class _Change(NamedTuple):
    cell: str
    statement: ast.stmt
    edit: Edit


class _Partial:
    """The changes that make some of a case's numbers right, or all more nearly so, and spoil none."""

    def __init__(self, errors: Callable[[tuple[np.ndarray, ...]], np.ndarray | None]) -> None:
        self.errors = errors
        self.some: list[tuple[Candidate, bytes, float]] = []
        self.before: np.ndarray | None = None

    def add(
        self, tried: Sequence[Candidate], answers: Answers,
        run: Callable[[Candidate], tuple[np.ndarray, ...] | None],
    ) -> None:  # fmt: skip
        if self.before is None and (as_it_is := run(replace(tried[0], setting=()))) is not None:
            self.before = self.errors(as_it_is)
        for candidate, got in zip(tried, answers, strict=True):
            off = None if got is None or candidate.beside else self.errors(got)
            if off is not None and not (self.before is not None and np.any((self.before <= 1) & (off > 1))):
                self.some.append((candidate, np.packbits(off <= 1).tobytes(), _distance(off)))

    def best(self) -> list[Candidate]:
        """Those that make most right, then those that come nearest; the least far-fetched of those that do the same."""
        right = b"" if self.before is None else np.packbits(self.before <= 1).tobytes()
        least = math.inf if self.before is None else _distance(self.before)
        one_each: dict[tuple[bytes, float], Candidate] = {}
        for candidate, bits, distance in self.some:
            one_each.setdefault((bits, round(distance, 6)), candidate)
        gains = sorted((_ones(right) - _ones(bits), distance, k) for k, (bits, distance) in enumerate(one_each))
        changes = list(one_each.values())
        better = [changes[k] for gain, _, k in gains if gain < 0][:BEAM]
        nearer = [changes[k] for _, distance, k in sorted(gains, key=lambda one: one[1]) if distance < least - NEARER]
        return list(dict.fromkeys([*better, *nearer[: BEAM // 2]]))[:BEAM]


def _ones(bits: bytes) -> int:
    return int.from_bytes(bits, "big").bit_count()


def _distance(off: np.ndarray) -> float:
    """How far the numbers are from right ones, in powers of ten of what is allowed, on average."""
    return float(np.mean(np.log10(np.clip(off, 1, 1e12)))) if off.size else 0.0


def _own(statement: ast.AST) -> Iterator[ast.AST]:
    """The statement's nodes, without those of statements in it."""
    yield statement
    for child in ast.iter_child_nodes(statement):
        if not isinstance(child, ast.stmt):
            yield from _own(child)


def _nodes(marks: Sequence[Candidate], asked: frozenset[int] | None) -> set[ast.AST] | None:
    """The statements that run; None: unknown."""
    return None if asked is None else {c.edit.old for c in marks if c.setting[0][0] in asked}


def _weight(edit: Edit, seen: Mapping[str, int]) -> float:
    """How far-fetched it is; ten times as often seen is worth COMMON."""
    return edit.weight - COMMON * math.log10(1 + seen.get(kind_of(edit.operator), 0)) if seen else edit.weight
