"""A class's pages: the class as a matrix, a page a student, failures first; scripts and styles once for all.

write_class(results, rubric, folder)    # index.html, students/*.html, shared/*, results.csv, results.json, junit.xml
"""

import csv
import hashlib
import io
import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from raytwin import files, viewer
from raytwin.grade.result import Marked, Picture, Result
from raytwin.grade.rubric import Rubric
from raytwin.report.page import asset, render_page

SHARED = "shared"
STUDENTS = "students"
BINS = 10
"""Steps of the points' distribution."""
ALIKE = 1e-3
"""Share of the largest error: two wrong pictures whose errors differ by less everywhere are near-identical."""


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
    common: dict[str, Any] = {"of_points": of_points, "STATUS": STATUS, "rubric": rubric}
    common["page"] = lambda result: names[result.key]
    failed = []
    for result in results:
        try:
            views, said = [_view(p) for p in result.pictures], alike.get(result.key, [])
            text = render_page(
                "grade_student.html.j2", r=result, exercises=_ordered(result), views=views, alike=said, **common
            )
        except Exception as error:  # ours: it costs this page and no other
            failed.append(result.student)
            text = PLAIN_PAGE.format(escape(result.student), escape(f"{type(error).__name__}: {error}"))
        files.write_text(folder / STUDENTS / names[result.key], text)
    text = render_page(
        "grade_class.html.j2",
        results=results,
        columns=rubric.exercises,
        bins=histogram(results),
        faults=faults(results),
        alike=alike,
        crashed=[r for r in results if broken(r)],
        says=said_of,
        **common,
    )
    files.write_text(folder / "index.html", text)
    write_csv(results, rubric, folder / "results.csv")
    files.write_json(folder / "results.json", summary(results, rubric))
    return failed


def _ordered(result: Result) -> list[Marked]:
    """The exercises, those that lost most points first."""
    return sorted(result.exercises, key=lambda e: (e.status == "pass", -(e.of - e.points)))


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
    "broken": ("☇", "its process ended"),
}
"""Status -> a sign that needs no colour, and what it means."""


def broken(result: Result) -> bool:
    return bool(result.problem) or any(e.status in ("limit", "broken") for e in result.exercises)


def of_points(points: float) -> str:
    """
    >>> of_points(12.0), of_points(3.25)
    ('12', '3.25')
    """
    return f"{points:.2f}".rstrip("0").rstrip(".")


def page_name(result: Result) -> str:
    short = re.sub(r"[^A-Za-z0-9_-]+", "-", result.student).strip("-")[:60]
    return f"{short}-{hashlib.sha256(result.student.encode(errors='replace')).hexdigest()[:6]}.html"


def histogram(results: Sequence[Result]) -> list[tuple[int, int]]:
    """(lower bound in per cent, how many) of the points in BINS steps; the last holds all from there on."""
    shares = [min(BINS - 1, int(BINS * r.points / r.of)) if r.of else 0 for r in results]
    counted = Counter(shares)
    return [(100 * i // BINS, counted[i]) for i in range(BINS)]


def faults(results: Sequence[Result]) -> list[tuple[str, list[Result]]]:
    """Named causes, the most frequent first, each with who has it."""
    found: dict[str, list[Result]] = {}
    for result in results:
        for cause in result.causes:
            found.setdefault(cause, []).append(result)
    return sorted(found.items(), key=lambda item: (-len(item[1]), item[0]))


def said_of(cause: str, result: Result) -> str:
    """What the student was told of it: neither how sure it is, nor what explains as much."""
    said = next(e.sentences[0] for e in result.exercises if cause in e.causes and e.sentences)
    return re.sub(r"^cause \(\w+\): | \(explains .*|; or, with the same .*", "", said, flags=re.DOTALL)


def near_identical(results: Sequence[Result]) -> dict[str, list[tuple[Result, str]]]:
    """Key -> who has a wrong picture of the same scene with the same errors, and which one. The same mistake does that,
    too: it says so, and no more."""
    by_scene: dict[tuple[str, str], list[tuple[Result, np.ndarray]]] = {}
    for result in results:
        for p in result.pictures:
            if p.sample and not p.shows.startswith("drawn") and max(map(abs, p.sample)) > 0:
                by_scene.setdefault((p.exercise, p.shows), []).append((result, np.array(p.sample)))
    found: dict[str, dict[str, tuple[Result, str]]] = {}
    for (_, shows), pictures in by_scene.items():
        for (a, x), (b, y) in combinations(pictures, 2):
            if np.abs(x - y).max() <= ALIKE * min(np.abs(x).max(), np.abs(y).max()):
                found.setdefault(a.key, {})[b.key] = (b, shows)
                found.setdefault(b.key, {})[a.key] = (a, shows)
    return {key: list(others.values()) for key, others in found.items()}


def _view(picture: Picture) -> dict[str, Any]:
    """What the viewer mounts: the picture's planes and how to show them; empty where there is a small one alone."""
    told: dict[str, Any] = {"exercise": picture.exercise, "shows": picture.shows, "thumb": picture.thumb, "data": ""}
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
        told["data"] = json.dumps(json.loads(picture.planes) | more).replace("<", "\\u003c")
    return told


# ------------------------------------------------------------------------------------------ numbers


def summary(results: Sequence[Result], rubric: Rubric) -> dict[str, Any]:
    """Own JSON: everything but pictures."""
    told = [files.plain(r) | {"points": r.points, "of": r.of} for r in results]
    for one in told:
        del one["pictures"]
    return {"title": rubric.title, "points": rubric.points, "results": told}


def write_csv(results: Sequence[Result], rubric: Rubric, path: Path) -> None:
    """A line a student: points in all and of each exercise, status of each, causes."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    names = [e.name for e in rubric.exercises]
    rows.writerow(["student", "points", "of", "bonus", *names, *(f"{n}: status" for n in names), "causes", "problem"])
    for r in results:
        by_name: dict[str, Marked] = {e.name: e for e in r.exercises}
        found = [by_name.get(n) for n in names]
        cells = [of_points(e.points) if e else "" for e in found] + [e.status if e else "" for e in found]
        said = [r.student, of_points(r.points), of_points(rubric.points), of_points(r.bonus), *cells]
        rows.writerow([tame(c) for c in (*said, "; ".join(r.causes), r.problem)])
    files.write_text(path, text.getvalue())


def tame(cell: str) -> str:
    """A spreadsheet takes what begins so for a formula."""
    return f"'{cell}" if cell[:1] in ("=", "+", "-", "@", "\t", "\r") and not _is_number(cell) else cell


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False
