"""paper.html, paper.json, paper.md: the paper's three figures again, as charts and as tables beside its own numbers."""

import os
from collections.abc import Iterable

from raytwin import files
from raytwin.paper.paper_record import Frame, Paper
from raytwin.paper.paper_tables import TRIMS, is_full, markdown, size_of, tables
from raytwin.report.bench_charts import Mark, calibration_charts, marks_chart, megapixels
from raytwin.report.bench_page import made_folder
from raytwin.report.charts.chart import Chart, chart_html, write_charts
from raytwin.report.numbers import seconds, shown
from raytwin.report.page import write_page

MACHINES = "The paper ran on Google Colab, this run on {}: seconds of the two do not compare, ratios within each do."


def write_paper_all(paper: Paper, folder: str | os.PathLike[str]) -> None:
    """paper.html, paper.json, paper.md, and each chart as SVG."""
    folder = made_folder(folder)
    files.write_json(folder / "paper.json", paper)
    files.write_text(folder / "paper.md", markdown(paper, machines(paper)))
    charts = charts_of(paper)
    write_page(
        folder / "paper.html", "paper/paper.html.j2", ("bench.css",), ("charts.js",),
        p=paper,
        parts=[(t, [(c, chart_html(c)) for c in charts.get(t.key, ())]) for t in tables(paper)],
        machines=machines(paper),
    )  # fmt: skip
    write_charts((c for found in charts.values() for c in found), folder)


def machines(paper: Paper) -> str:
    return MACHINES.format(f"{paper.machine['processor']} ({paper.machine['cores']} cores)")


def paper_summary(paper: Paper) -> str:
    """The ratios, for the terminal."""
    lines = [f"the paper's figures 10 to 12 on {paper.scene}, in {seconds(paper.seconds)}"]
    lines += [f"  {r.what:<70} {shown(r.measured):>8}   {r.asked}" for r in paper.ratios]
    if paper.left_out:
        lines.append(f"  left out: {len(paper.left_out)}, named with their reasons in paper.html")
    return "\n".join(lines)


def charts_of(paper: Paper) -> dict[str, list[Chart]]:
    """By table's key, in the page's order."""
    guessed = [*paper.speculation, *(f for f in paper.intersection if is_full(paper, f))]
    return {
        "calibration": calibration_charts("", paper.calibration),
        "intersection": frames_chart(paper, "intersection", "a frame, trimmed and not", paper.intersection, sizes=True),
        "speculation": frames_chart(paper, "speculation", "every n-th pixel traced", guessed, sizes=False),
    }


def frames_chart(paper: Paper, key: str, title: str, frames: Iterable[Frame], sizes: bool) -> list[Chart]:
    """One chart of the frames that have an error; none where none has."""
    marks, floor = [], 0.0
    for f in sorted(frames, key=lambda f: (f.width, f.family)):
        if f.rmse is None:
            continue
        family = f"{f.family}, {megapixels((f.width, f.height))}" if sizes else f.family
        marks.append(Mark(family, TRIMS.get(f.label, f.label), f"{f.method}, {size_of(f)}", f.seconds_median, f.rmse))
        floor = max(floor, paper.floor[f"{f.width}x{f.height}"])
    if not marks:
        return []
    note = "grey: below what the truth, stored in float32, can tell" if any(m.error <= floor for m in marks) else ""
    return [
        marks_chart(key, f"{paper.scene}: {title}", "seconds a frame (median)", "RMSE, radiance", marks, floor, note)
    ]
