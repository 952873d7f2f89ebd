"""A class's pages: the class as a matrix, a page a student, failures first; scripts and styles once for all.

write_class(results, rubric, folder)    # index.html, students/*.html, shared/*, results.csv, results.json, junit.xml
"""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

from raytwin import files, viewer
from raytwin.grade.feedback import row_of, unnamed
from raytwin.grade.fingerprint import same
from raytwin.grade.result import SUREST, Marked, Picture, Result
from raytwin.grade.rubric import PICTURES, Rubric
from raytwin.report.page import asset, render_page, write_page
from raytwin.report.spreadsheet import write_csv

SHARED = "shared"
STUDENTS = "students"
BINS = 10
"""Steps of the points' distribution."""
SURENESS = {
    "named": "named by the instructor",
    "proved": "proved",
    "likely": "likely",
    "": "cause unknown",
}
"""How sure a cause is, from the surest, in words."""


def write_class(results: Sequence[Result], rubric: Rubric, folder: Path) -> list[str]:
    """Write every output of a class; return the students whose page could not be made, each of whom gets a plain one.

    Students' names are as they were handed in; files are named so that none escapes.
    """
    shared = folder / SHARED
    files.write_text(shared / "viewer.js", viewer.script())
    files.write_text(shared / "grade.js", asset("table.js") + asset("grade.js"))
    files.write_text(shared / "grade.css", asset("report.css") + viewer.style() + asset("grade.css"))
    alike = near_identical(results)
    names = {r.key: page_name(r) for r in results}
    common: dict[str, Any] = {
        "of_points": of_points,
        "STATUS": STATUS,
        "SURENESS": SURENESS,
        "PICTURES": PICTURES,
        "rubric": rubric,
    }
    common["page"] = lambda result: names[result.key]
    failed = []
    for result in results:
        try:
            views, said = [_view(p) for p in result.pictures], alike.get(result.key, [])
            text = render_page(
                "grade_student.html.j2",
                r=result,
                exercises=_ordered(result),
                views=views,
                alike=said,
                next_step=next_step,
                **common,
            )
        except Exception as error:  # ours: it costs this page and no other
            failed.append(result.student)
            text = PLAIN_PAGE.format(escape(result.student), escape(f"{type(error).__name__}: {error}"))
        files.write_text(folder / STUDENTS / names[result.key], text)
    write_page(
        folder / "index.html",
        "grade_class.html.j2",
        results=results,
        columns=rubric.exercises,
        bins=histogram(r.points / r.of if r.of else 0 for r in results),
        by_exercise=by_exercise(results, rubric),
        faults=faults(results),
        unnamed=[(e, who, row_of(e)) for e, who in unnamed(results)],
        fast=leaderboard(results),
        alike=alike,
        crashed=[r for r in results if broken(r)],
        certainty=certainty,
        in_short=in_short,
        **common,
    )
    write_csv(folder / "results.csv", csv_rows(results, rubric))
    files.write_json(folder / "results.json", summary(results, rubric))
    return failed


def _ordered(result: Result) -> list[Marked]:
    """What to look at first comes first, then by lost points; what passes, and last what is not written."""
    late = {"pass": 1, "missing": 2}
    first = result.worst
    return sorted(result.exercises, key=lambda e: (late.get(e.status, 0), e is not first, -(e.of - e.points)))


PLAIN_PAGE = (
    '<!DOCTYPE html>\n<html lang="en"><meta charset="utf-8"><title>{0}</title>'
    '<h1>{0}</h1><p>The grader could not make this page: {1}</p><p><a href="../index.html">The class</a></p>\n'
)

STATUS = {
    "pass": ("✓", "passes"),
    "fail": ("✗", "other numbers"),
    "error": ("!", "an error, or no usable array"),
    "missing": ("–", "not written"),
    "limit": ("◷", "too much time, memory or output"),
    "broken": ("☇", "the process ended"),
}
"""Status -> a sign that needs no colour, and what it means."""


CRASHED = ("limit", "broken", "error")


def broken(result: Result) -> bool:
    return bool(result.problem) or any(e.status in CRASHED for e in result.exercises)


def of_points(points: float) -> str:
    """
    >>> of_points(12.0), of_points(3.25)
    ('12', '3.25')
    """
    return f"{points:.2f}".rstrip("0").rstrip(".")


def page_name(result: Result) -> str:
    short = re.sub(r"[^A-Za-z0-9_-]+", "-", result.student).strip("-")[:60]
    return f"{short}-{hashlib.sha256(result.student.encode(errors='replace')).hexdigest()[:6]}.html"


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
            for name, sentence in e.faults:
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


def next_step(e: Marked | None) -> str:
    """What a student does about an exercise, or a file, after reading what is wrong."""
    if e is None:
        return "Run the file yourself until it loads without an error, then hand in again."
    if e.status == "missing":
        return f"Write {e.stage}; the starter file says what it takes and returns."
    if e.status == "limit":
        return "Find the loop that does not end, or do all rays at once, then hand in again."
    if e.status in ("error", "broken"):
        return f"Run {e.stage} yourself until it returns an array without an error, then hand in again."
    change = "Change that" if e.faults or e.sureness else "Find out what differs there"
    if e.stage in PICTURES:
        return f"{change}, and compare your picture with the expected one below."
    return f'{change}, then test it alone: raytwin.check("{e.stage}", {e.stage}).'


def leaderboard(results: Sequence[Result]) -> list[tuple[Result, float, float]]:
    """(result, computed seconds per picture, error) of those whose pictures are right, the fastest first."""
    passed = {r.key: {e.name for e in r.exercises if e.status == "pass"} for r in results}
    rows = [(r, seconds, error) for r in results for name, seconds, error in r.speed if name in passed[r.key]]
    return sorted(rows, key=lambda row: row[1])


def near_identical(results: Sequence[Result]) -> dict[str, list[tuple[Result, str]]]:
    """Key -> who has the same wrong numbers, and in which exercise. The same mistake does that, too."""
    found: dict[str, dict[str, tuple[Result, str]]] = {}
    marked = [(r, e) for r in results for e in r.exercises if e.fingerprint]
    for (a, x), (b, y) in combinations(marked, 2):
        if a.key != b.key and x.stage == y.stage and same(x.fingerprint, y.fingerprint):
            found.setdefault(a.key, {})[b.key] = (b, y.name)
            found.setdefault(b.key, {})[a.key] = (a, x.name)
    return {key: list(others.values()) for key, others in found.items()}


def _view(picture: Picture) -> dict[str, Any]:
    """What the viewer mounts: the picture's planes and how to show them; empty where there is a small one alone."""
    view: dict[str, Any] = {"exercise": picture.exercise, "shows": picture.shows, "thumb": picture.thumb, "data": ""}
    if picture.planes:
        panes = [
            {"key": "reference", "kind": "radiance", "title": "Expected", "tab": "expected"},
            {"key": "test", "kind": "radiance", "title": "Got", "tab": "got"},
            {"key": "map", "kind": "map", "title": "Difference", "tab": "difference"},
        ]
        more = {
            "names": {"test": "got", "reference": "expected"},
            "panes": [pane | {"alt": f"{pane['title']}, {picture.shows}"} for pane in panes],
            "objects": [], "noisy": False, "places": [], "marks": [], "start": None, "address": False,
            "bound": {"share": picture.share, "scale": picture.scale, "held": True}, "exposure": picture.stops,
        }  # fmt: skip
        # "<" would end the element that holds it.
        view["data"] = json.dumps(json.loads(picture.planes) | more).replace("<", "\\u003c")
    return view


# ------------------------------------------------------------------------------------------ numbers


def summary(results: Sequence[Result], rubric: Rubric) -> dict[str, Any]:
    """Own JSON: everything but pictures."""
    rows = [files.plain(r) | {"points": r.points, "of": r.of} for r in results]
    for one in rows:
        del one["pictures"]
    return {"title": rubric.title, "points": rubric.points, "results": rows}


def csv_rows(results: Sequence[Result], rubric: Rubric) -> Iterator[Sequence[str]]:
    """Yield the head, and a row per student: points in all and of each exercise, status of each, causes and how sure
    they are, what went wrong where there are no numbers."""
    names = [e.name for e in rubric.exercises]
    taken = ("student", "points", "of", "bonus", *CSV_ENDS)
    columns = [f"{n}: points" if n in taken else n for n in names]
    yield ["student", "points", "of", "bonus", *columns, *(f"{n}: status" for n in names), *CSV_ENDS]
    for r in results:
        by_name: dict[str, Marked] = {e.name: e for e in r.exercises}
        found = [by_name.get(n) for n in names]
        cells = [of_points(e.points) if e else "" for e in found] + [e.status if e else "" for e in found]
        crash = in_short(r) if r.problem or (r.worst and r.worst.status in CRASHED) else ""
        ends = ["; ".join(r.faults), crash, certainty(r), f"{r.own_seconds:.2f}", r.graded]
        yield [r.student, of_points(r.points), of_points(rubric.points), of_points(r.bonus), *cells, *ends]


CSV_ENDS = ("causes", "problem", "certainty", "seconds", "graded")
