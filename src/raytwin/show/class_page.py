"""A class's pages: the class as a matrix, a page per student, scripts and styles once for all.

write_class(results, rubric, folder)    # index.html, students/*.html, shared/*, results.csv, results.json
"""

import csv
import hashlib
import io
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from statistics import median
from typing import Any

from raytwin.safe_write import write_text
from raytwin.scene.toml_json import plain, write_json
from raytwin.show import viewer
from raytwin.show.page import asset, write_page
from raytwin.show.student_page import STATUS, SURENESS, of_points, seen_as, student_page, styles
from raytwin.teach.grade.result import SUREST, Marked, Result
from raytwin.teach.grade.rubric import Rubric

SHARED = "shared"
STUDENTS = "students"
FOR_STUDENTS = "for-students"
BINS = 10
"""Steps of the points' distribution."""


def write_class(results: Sequence[Result], rubric: Rubric, folder: Path, for_students: bool = False) -> list[str]:
    """Write every output of a class; return the students whose page could not be made, each of whom gets a plain one.

    Students' names are as they were handed in; files are named so that none escapes. `for_students`: also a page for
    each to hand out.
    """
    results = sorted(results, key=lambda r: (r.student.casefold(), r.student))
    shared = folder / SHARED
    write_text(shared / "viewer.js", viewer.script())
    write_text(shared / "grade.js", asset("table.js") + asset("grade.js"))
    write_text(shared / "grade.css", styles())
    names = {r.key: page_name(r) for r in results}
    handed_out = handout_names(results) if for_students else {}
    failed = []
    for result in results:
        for where, named in ((STUDENTS, names), (FOR_STUDENTS, handed_out)):
            if result.key in named:
                try:
                    text = student_page(result, rubric, where == FOR_STUDENTS)
                except Exception as error:  # ours: it costs this page and no other
                    failed.append(result.student)
                    why = f": {type(error).__name__}: {error}" if where == STUDENTS else ""
                    text = PLAIN_PAGE.format(escape(result.student), escape(why))
                write_text(folder / where / named[result.key], text)
    write_page(
        folder / "index.html",
        "grade_class.html.j2",
        results=results,
        columns=rubric.exercises,
        median=median(r.points for r in results) if results else 0.0,
        bins=histogram(r.points / r.of if r.of else 0 for r in results),
        by_exercise=by_exercise(results, rubric),
        faults=faults(results),
        crashed=[r for r in results if broken(r)],
        certainty=certainty,
        in_short=in_short,
        of_points=of_points,
        seen_as=seen_as,
        page=lambda result: names[result.key],
        rubric=rubric,
        STATUS=STATUS,
        SURENESS=SURENESS,
    )
    write_csv(folder / "results.csv", csv_rows(results, rubric))
    write_json(folder / "results.json", summary(results, rubric))
    return failed


PLAIN_PAGE = (
    '<!DOCTYPE html>\n<html lang="en"><meta charset="utf-8"><title>{0}</title>'
    "<h1>{0}</h1><p>The grader could not make this page{1}</p>\n"
)

CRASHED = ("limit", "broken", "error")


def broken(result: Result) -> bool:
    return bool(result.problem) or any(e.status in CRASHED for e in result.exercises)


def page_name(result: Result) -> str:
    return f"{_short(result)}-{hashlib.sha256(result.student.encode(errors='replace')).hexdigest()[:6]}.html"


def handout_names(results: Sequence[Result]) -> dict[str, str]:
    """Key -> file name: the student's, with a number where two are alike but for signs or case."""
    found: dict[str, str] = {}
    for result in results:
        ends = itertools.chain([""], (f"-{k}" for k in itertools.count(2)))
        names = (f"{_short(result) or 'student'}{end}.html" for end in ends)
        taken = {name.casefold() for name in found.values()}
        found[result.key] = next(name for name in names if name.casefold() not in taken)
    return found


def _short(result: Result) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", result.student).strip("-")[:60]


def histogram(shares: Iterable[float]) -> list[int]:
    """How many of these shares of the points, 0 to 1, lie in each of BINS steps; the last has the whole ones, too.

    >>> histogram([0, 0.05, 1, 1.2])
    [2, 0, 0, 0, 0, 0, 0, 0, 0, 2]
    """
    counted = Counter(min(BINS - 1, int(BINS * share)) for share in shares)
    return [counted[i] for i in range(BINS)]


def by_exercise(results: Sequence[Result], rubric: Rubric) -> list[tuple[str, int, list[int]]]:
    """(name, how many pass, histogram) of each exercise."""
    rows = []
    for e in rubric.exercises:
        marked = [m for r in results for m in r.exercises if m.name == e.name]
        shares = [m.points / m.of if m.of else 1.0 for m in marked]
        rows.append((e.name, sum(m.status == "pass" for m in marked), histogram(shares)))
    return rows


def faults(results: Sequence[Result]) -> list[tuple[str, str, list[tuple[Result, str]]]]:
    """(name, its sentence, who made it and how sure that is), the most frequent first."""
    found: dict[str, tuple[str, dict[str, tuple[Result, str]]]] = {}
    for result in results:
        for e in result.exercises:
            for name, sentence in () if e.follows else e.named.items():
                who = found.setdefault(name, (sentence, {}))[1]
                if result.key not in who or SUREST.index(e.sureness) < SUREST.index(who[result.key][1]):
                    who[result.key] = result, e.sureness
    rows = [(name, sentence, list(who.values())) for name, (sentence, who) in found.items()]
    return sorted(rows, key=lambda row: (-len(row[2]), row[0]))


def certainty(result: Result) -> str:
    """The sureness of the first cause; empty where no cause is, or an error says what happened."""
    return result.worst.sureness if result.worst and result.worst.status == "fail" else ""


def in_short(result: Result) -> str:
    """What went wrong, in one line: the error of what ran not at all, or the first cause."""
    return "; ".join((result.problem or result.first_problem).split("\n"))


# ------------------------------------------------------------------------------------------ numbers


def summary(results: Sequence[Result], rubric: Rubric) -> dict[str, Any]:
    """Own JSON: everything but pictures."""
    rows = [plain(r) | {"points": r.points, "of": r.of} for r in results]
    for one in rows:
        del one["pictures"]
    return {"title": rubric.title, "points": rubric.points, "results": rows}


def csv_rows(results: Sequence[Result], rubric: Rubric) -> Iterator[Sequence[str]]:
    """Yield the head, and a row per student: points in all and of each exercise, status of each, causes and how sure
    they are, what went wrong where there are no numbers."""
    names = [e.name for e in rubric.exercises]
    taken = ("student", "points", "of", *CSV_ENDS)
    columns = [f"{n}: points" if n in taken else n for n in names]
    yield ["student", "points", "of", *columns, *(f"{n}: status" for n in names), *CSV_ENDS]
    for r in results:
        by_name: dict[str, Marked] = {e.name: e for e in r.exercises}
        found = [by_name.get(n) for n in names]
        cells = [of_points(e.points) if e else "" for e in found] + [e.status if e else "" for e in found]
        crash = in_short(r) if r.problem or (r.worst and r.worst.status in CRASHED) else ""
        ends = ["; ".join(r.faults), crash, certainty(r), f"{r.own_seconds:.2f}", r.graded]
        yield [r.student, of_points(r.points), of_points(rubric.points), *cells, *ends]


CSV_ENDS = ("causes", "problem", "certainty", "seconds", "graded")


def write_csv(path: Path, rows: Iterable[Sequence[str]]) -> None:
    """Write a line per row; a cell's line ends become blanks."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([tame(" ".join(cell.split())) for cell in row] for row in rows)
    write_text(path, text.getvalue())


def tame(cell: str) -> str:
    """Put an apostrophe before what a spreadsheet takes for a formula; numbers stay as they are.

    >>> tame("=1+1"), tame("-2.5"), tame("@x"), tame("Ada")
    ("'=1+1", '-2.5', "'@x", 'Ada')
    """
    return f"'{cell}" if cell[:1] in ("=", "+", "-", "@", "\t", "\r") and not _is_number(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False
