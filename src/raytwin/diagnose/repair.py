"""A slip found in a student's own text: the change of one place that makes every value right, its line, and the way.

The same operators that make mistakes of the textbook make repairs of a text. Candidates are compiled here, run where
the student's code may run (`attempt`, in the sandbox or in this process), and judged here again. One that makes every
case right is a proof: it needs no catalogue.
"""

import ast
import itertools
import marshal
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.diagnose.operators import Edit, edits, replaced

Cells = Sequence[tuple[str, str]]
"""(name, text): a Python file has one, a notebook several."""
Answers = list[tuple[np.ndarray, ...] | None]
NONE_SEEN: Mapping[str, int] = {}
COMMON = 0.5
"""By so much less far-fetched is a slip that was seen ten times as often."""
AT_ONCE = 48
"""Candidates that are tried in one call."""
A_CALL = 0.25
"""Seconds of computing after which a candidate is given up; or so many times what the student's own function takes."""


@dataclass(frozen=True)
class Repair:
    """`line` of `cell` has `before`; `after` in its place makes everything right. `operator`: what was wrong."""

    cell: str
    line: int
    operator: str
    before: str
    after: str
    tried: int = 0
    candidate: "Candidate | None" = field(default=None, compare=False)

    def hint(self, level: int) -> str:
        """1: where. 2: what is wrong there, too. 3: what to write, too. Empty for 0."""
        if level < 1:
            return ""
        where = f"{self.cell + ', ' if self.cell.startswith('cell ') else ''}line {self.line}"
        if level == 1:
            return f"look at {where}: a change there makes everything right"
        if level == 2:
            return f"{where}: {self.operator} in `{self.before}`"
        return f"{where}: {self.operator}; `{self.after}` in place of `{self.before}` makes everything right"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A change, compiled: `code` binds `names` anew."""

    cell: str
    statement: ast.stmt
    edit: Edit
    code: bytes
    names: tuple[str, ...]


Run = Callable[[Sequence[Candidate], Sequence[Any]], Answers]
"""(candidates, arguments) -> what the function returns with each of them; None: it raised, or took too long."""


def repair(
    cells: Cells, function: str, cases: Sequence[Any], is_right: Callable[[Any, Any], bool], run: Run,
    more_time: Callable[[], bool], innocent: Sequence[str] = (), known: Sequence["Candidate"] = (),
    further: Callable[[], Sequence[Any]] = tuple, seen: Mapping[str, int] = NONE_SEEN,
) -> Repair | None:  # fmt: skip
    """The least far-fetched change of one place after which `function` is right in all cases; None where none is found.

    `cases` have `args`; the first is one that is wrong. `is_right(case, arrays)`. `innocent`: functions that are right
    by their own tests. `more_time()`: whether to go on. `known`: what has made other functions right is tried first.
    `further()`: cases that a change must make right as well before it counts as proved: by chance it may fit `cases`.
    `seen`: how often each kind of slip was made: what is common is tried first.
    """
    tried = 0

    def passing(left: list[Candidate], some: Sequence[Any]) -> list[Candidate]:
        for case in some:
            if not left:
                break
            answers = run(left, case.args)
            left = [c for c, got in zip(left, answers, strict=True) if got is not None and is_right(case, got)]
        return left

    for chunk in itertools.chain([list(known)], _chunks(candidates(cells, function, innocent, seen))):
        if not more_time():
            return None
        tried += len(chunk)
        left = passing(chunk, cases)
        if left and (left := passing(left, further())):
            return replace(_as_repair(left[0]), tried=tried, candidate=left[0])
    return None


def _chunks(all_: Iterator[Candidate]) -> Iterator[list[Candidate]]:
    chunk: list[Candidate] = []
    for one in all_:
        chunk.append(one)
        if len(chunk) == AT_ONCE:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _as_repair(best: Candidate) -> Repair:
    """The statement on one line, before and after; of what spans more, the expression that differs."""
    edit = best.edit
    smallest = _simple_statement(best.statement, edit.old)
    if smallest is not None and not isinstance(edit.new, list):
        before, after = ast.unparse(smallest), ast.unparse(replaced(smallest, edit.old, edit.new))
        if len(before) <= 100 and "\n" not in before + after:
            return Repair(best.cell, edit.line, edit.operator, before, after)
    after = edit.after.splitlines()[-1] if edit.operator.startswith("the return") else edit.after
    before = after if edit.operator.startswith("the return") else edit.before.splitlines()[0]
    line = edit.line
    if edit.operator.startswith("the return") and isinstance(edit.old, ast.For | ast.While):
        line = edit.old.body[-1].lineno
        after = f"{after} (after the loop)"
    return Repair(best.cell, line, edit.operator, before, after.splitlines()[0])


def _simple_statement(tree: ast.AST, node: ast.AST) -> ast.stmt | None:
    """The innermost statement around the node that has no others in it."""
    for one in ast.walk(tree):
        if isinstance(one, ast.stmt) and not hasattr(one, "body") and any(n is node for n in ast.walk(one)):
            return one
    return None


# ------------------------------------------------------------------------------------------ candidates


def kind_of(operator: str) -> str:
    """An operator's words without the student's own names.

    >>> kind_of("`u` stands for `v`"), kind_of("the divisor dd is missing")
    ('... stands for ...', 'the divisor ... is missing')
    """
    return re.sub(r"`[^`]*`|(?<=factor )\w+|(?<=divisor )\w+|(?<=term )\w+", "...", operator)


def candidates(
    cells: Cells, function: str, innocent: Sequence[str] = (), seen: Mapping[str, int] = NONE_SEEN
) -> Iterator[Candidate]:
    """Single changes of what `function` is made of, the least far-fetched first."""
    reached = _statements(cells, function, innocent)
    words = sorted({w for _, s in reached for n in ast.walk(s) if (w := _word(n))})
    numpy = _numpy(cells)
    for rare in (False, True):
        found = [(e, cell, s) for cell, s in reached for e in edits(s, numpy, words, rare)]
        for edit, cell, statement in sorted(found, key=lambda f: _weight(f[0], seen)):
            code = _compiled(statement, edit)
            if code is not None:
                yield Candidate(cell, statement, edit, code, _bound(statement))


def _weight(edit: Edit, seen: Mapping[str, int]) -> float:
    """How far-fetched it is; ten times as often seen is worth COMMON."""
    return edit.weight - COMMON * math.log10(1 + seen.get(kind_of(edit.operator), 0)) if seen else edit.weight


def _word(node: ast.AST) -> str:
    text = node.value if isinstance(node, ast.Constant) else ""
    return text if isinstance(text, str) and text.isidentifier() else ""


def _numpy(cells: Cells) -> str:
    for _, text in cells:
        for node in ast.walk(_parsed(text)):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    if alias.name == "numpy":
                        return alias.asname or "numpy"
    return "np"


def _parsed(text: str) -> ast.Module:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text)
    except (SyntaxError, ValueError, RecursionError):
        return ast.Module([], [])


def _statements(cells: Cells, function: str, innocent: Sequence[str]) -> list[tuple[str, ast.stmt]]:
    """Those top-level statements that bind the function and whatever it, in turn, reads, but for what is innocent."""
    bound: dict[str, tuple[str, ast.stmt]] = {}
    for cell, text in cells:
        for statement in _parsed(text).body:
            for name in _bound(statement):
                # `f = check(f)` behind `def f` wraps the function, and is not its text.
                if isinstance(statement, ast.FunctionDef) or not isinstance(
                    bound.get(name, ("", None))[1], ast.FunctionDef
                ):
                    bound[name] = cell, statement
    found: dict[int, tuple[str, ast.stmt]] = {}
    todo = [function]
    bound = {name: one for name, one in bound.items() if name not in innocent}
    while todo:
        name = todo.pop(0)
        if name in bound and id(bound[name][1]) not in found:
            found[id(bound[name][1])] = bound[name]
            todo += [n.id for n in ast.walk(bound[name][1]) if isinstance(n, ast.Name)]
    return list(found.values())


def _bound(statement: ast.stmt) -> tuple[str, ...]:
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return (statement.name,)
    if isinstance(statement, ast.Assign):
        return tuple(n.id for target in statement.targets for n in ast.walk(target) if isinstance(n, ast.Name))
    return ()


def _compiled(statement: ast.stmt, edit: Edit) -> bytes | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            changed = ast.Module([replaced(statement, edit.old, edit.new)], [])
            return marshal.dumps(compile(changed, "<repair>", "exec", dont_inherit=True))
    except (SyntaxError, ValueError, TypeError, RecursionError):
        return None


# ------------------------------------------------------------------------------------------ running


def attempt(space: Any, function: Any, codes: Any, names: Any, arguments: Any, seconds: Any) -> Any:
    """What the function returns with each code run in `space`, its names put back after: a list of arrays or None.

    Its text is sent into the sandbox: it imports what it needs itself.
    """
    import contextlib
    import copy
    import io
    import marshal
    import signal
    import threading
    import warnings

    import numpy

    def stop(number: Any, frame: Any) -> None:
        raise TimeoutError

    timed = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    before_it = signal.signal(signal.SIGVTALRM, stop) if timed else None
    made = []
    for code, bound in zip(codes, names, strict=True):
        old = {name: space[name] for name in bound if name in space}
        answer = None
        try:
            with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), numpy.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                if timed:
                    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
                exec(marshal.loads(code), space)
                got = space[function](*copy.deepcopy(arguments))
                answer = tuple(numpy.array(a, dtype=float) for a in (got if isinstance(got, tuple) else (got,)))
        except (Exception, SystemExit):  # a change that does not run is none
            answer = None
        finally:
            if timed:
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            space.update(old)
        made.append(answer)
    if timed:
        signal.signal(signal.SIGVTALRM, before_it)
    return made
