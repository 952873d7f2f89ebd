"""The page of a matrix: scenes by subjects, the worst first, a chart of speed against accuracy per scene.

write_matrix(cells, folder)    # index.html, matrix.json, matrix.csv, junit.xml; cells/*.html are there already
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import files, viewer
from raytwin.bench import staircase
from raytwin.compare import Report, scaled
from raytwin.compare.comparison import Comparison, Radiance
from raytwin.errors import InputError
from raytwin.report.bench_charts import Mark, marks_chart, steps
from raytwin.report.charts.chart import chart_html
from raytwin.report.compare_page import write_report
from raytwin.report.data_urls import error_thumb
from raytwin.report.junit import Case, write_junit
from raytwin.report.page import write_page
from raytwin.report.spreadsheet import write_csv
from raytwin.report.view import showable
from raytwin.workflows.compare_scene import Result
from raytwin.workflows.matrix import Cell, Job, judge
from raytwin.workflows.matrix_history import Past

CELLS = "cells"
SCRIPT = "viewer.js"
THUMB = 96
"""Pixels across."""
ORDER = "fail", "error", "undecided", "differs", "pass"
"""Verdicts, the worst first."""
SIGNS = {"pass": "✓", "differs": "≈", "fail": "✗", "undecided": "?", "error": "!"}
FLOOR = 1e-9
"""Errors below are drawn there: a logarithm has no 0."""


def make_cell(job: Job, folder: str) -> Cell:
    """Make one cell with its whole report: what a worker does."""
    cell, result = judge(job)
    if result is None:
        return cell
    report = f"{CELLS}/{job.key}.html"
    write_report(result, Path(folder) / report, script=SCRIPT)
    return msgspec.structs.replace(cell, thumbnail=thumbnail(result), report=report)


def thumbnail(result: Result) -> str:
    """The difference as a small picture; empty where there is none."""
    test, reference = result.test, result.reference
    if not (showable(test) and showable(reference)) or test.shape != reference.shape:
        return ""
    return error_thumb(test, reference, scaled(result.tolerance, reference, test).p999_abs, THUMB)


def write_matrix(
    cells: Sequence[Cell], folder: Path, past: dict[tuple[str, str, str], Past] | None = None, title: str = ""
) -> None:
    """Write every output of a matrix into `folder`."""
    past = past or {}
    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    subjects = list(dict.fromkeys(cell.subject for cell in cells))
    by_place = {(cell.scene, cell.subject): cell for cell in cells}
    lines = [(scene, [by_place.get((scene, subject)) for subject in subjects]) for scene in scenes]
    lines.sort(key=lambda line: min(map(badness, filter(None, line[1]))))
    files.write_text(folder / CELLS / SCRIPT, viewer.script())
    write_page(
        folder / "index.html",
        "matrix.html.j2",
        ("matrix.css",),
        ("table.js", "charts.js"),
        title=title or f"{len(subjects)} renderers on {len(scenes)} scenes",
        rows=lines,
        subjects=subjects,
        cells=cells,
        signs=SIGNS,
        order=ORDER,
        count={verdict: sum(cell.verdict == verdict for cell in cells) for verdict in ORDER},
        past={cell.key: past.get((cell.scene, cell.subject, cell.rung)) for cell in cells},
        told_first=sorted(
            (cell for cell in cells if (cell.scene, cell.subject, cell.rung) in past),
            key=lambda cell: not (found := past[cell.scene, cell.subject, cell.rung]).hovers and not found.trend,
        ),
        charts=[(scene, chart_html(chart)) for scene in scenes if (chart := scene_chart(scene, cells))],
    )
    rows = [{k: v for k, v in files.plain(cell).items() if k != "thumbnail"} for cell in cells]
    files.write_json(folder / "matrix.json", {"cells": rows})
    columns = [name for name in Cell.__struct_fields__ if name not in ("thumbnail", "key")]
    written = [["" if row[name] is None else str(row[name]) for name in columns] for row in rows]
    write_csv(folder / "matrix.csv", [columns, *written])
    write_junit(map(case_of, cells), folder / "junit.xml", "raytwin matrix")


def badness(cell: Cell) -> tuple[int, float]:
    """Less is worse: the verdict, then how far it is beyond its limit."""
    return ORDER.index(cell.verdict), -(cell.margin or 0.0)


def scene_chart(scene: str, cells: Sequence[Cell]) -> Any:
    """Error against seconds of every subject on a scene, with the frontier; None where nothing was measured."""
    known = [c for c in cells if c.scene == scene and c.seconds and c.rmse is not None and np.isfinite(c.rmse)]
    if not known:
        return None
    marks = [Mark(c.subject, c.subject, f"{c.subject}: {c.verdict}", c.seconds or 0.0, c.rmse or 0.0) for c in known]
    chart = marks_chart(f"matrix-{scene}", scene, "seconds a frame", "RMSE, radiance", marks, FLOOR)
    stairs = staircase([m.seconds for m in marks], [m.error for m in marks], FLOOR)
    return replace(chart, lines=(*chart.lines, steps([chart.points[i] for i in stairs], chart.x_range[1])))


def case_of(cell: Cell) -> Case:
    """A cell as a test."""
    if cell.verdict == "error":
        where, _, rest = cell.reason.partition(": expected ")
        expected, _, got = rest.rpartition(", got ")
        return Case(cell.subject, cell.scene, InputError(where, expected or "a comparison", got or cell.reason))
    said = tuple(filter(None, (cell.cause, cell.reason)))
    verdict: Any = cell.verdict
    made = Comparison(verdict, said, radiance=Radiance(rmse=cell.rmse, relmse=cell.relmse, p999_abs=cell.p999_abs))
    return Case(cell.subject, cell.scene, Report(cell.scene, cell.rung, made, {"tracer": cell.seconds or 0.0}))
