"""paper.html, paper.json, paper.md: the paper's three figures again, as charts and as tables beside its own numbers."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bokeh.embed import components

from raytwin import files
from raytwin.bench.calibration import OURS, SHRUNK, WHOLE
from raytwin.bench.paper import FULL, Frame, Paper
from raytwin.errors import InputError
from raytwin.report.bench_html import growth_figure
from raytwin.report.bench_static import write_static
from raytwin.report.charts import Chart, Mark, calibration_charts, marks_chart, megapixels
from raytwin.report.figures import script_of_bokeh
from raytwin.report.html import asset, environment
from raytwin.report.numbers import seconds, shown

TRIMS = {
    "none": "untrimmed",
    "corners": "eight-corner box",
    "conic": "conic box",
    "in place": "in place, conic box",
    "fill": "nothing",
}

MACHINES = "The paper ran on Google Colab, this run on {}: seconds of the two do not compare, ratios within each do."


@dataclass(frozen=True)
class Table:
    """`rows` are texts, as many as `head`; the first `words` columns are words, the others numbers."""

    key: str
    title: str
    lead: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int = 1


def write_paper_all(paper: Paper, folder: str | os.PathLike) -> None:
    """paper.html, paper.json, paper.md, and each chart as SVG and PNG."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "a folder to write to", error.strerror) from None
    files.write_json(folder / "paper.json", paper)
    files.write_text(folder / "paper.md", markdown(paper))
    write_page(paper, folder / "paper.html")
    write_static((c for charts in charts_of(paper).values() for c in charts), folder)


def write_page(paper: Paper, path: str | os.PathLike) -> None:
    groups = charts_of(paper)
    figures = [growth_figure(c) for charts in groups.values() for c in charts]
    script, elements = components(figures) if figures else ("", ())
    drawn = iter(elements)
    page = environment().from_string(asset("paper.html.j2")).render(
        p=paper,
        css=asset("report.css") + asset("bench.css"),
        bokeh=script_of_bokeh(),
        script=script,
        parts=[(t, [(c, next(drawn)) for c in groups.get(t.key, ())]) for t in tables(paper)],
        machines=MACHINES.format(machine(paper)),
    )  # fmt: skip
    files.write_text(path, page)


def machine(paper: Paper) -> str:
    return f"{paper.machine['processor']} ({paper.machine['cores']} cores)"


def paper_summary(paper: Paper) -> str:
    """The ratios, for the terminal."""
    lines = [f"the paper's figures 10 to 12 on {paper.scene}, in {seconds(paper.seconds)}"]
    lines += [f"  {r.what:<70} {shown(r.measured):>8}   {r.asked}" for r in paper.ratios]
    if paper.left_out:
        lines.append(f"  left out: {len(paper.left_out)}, named with their reasons in paper.html")
    return "\n".join(lines)


# ------------------------------------------------------------------------------------------ charts


def charts_of(paper: Paper) -> dict[str, list[Chart]]:
    """By table's key, in the page's order."""
    guessed = [*paper.speculation, *(f for f in paper.intersection if is_full(paper, f))]
    return {
        "calibration": calibration_charts("", paper.calibration),
        "intersection": frames_chart(paper, "intersection", "a frame, trimmed and not",
                                     paper.intersection, sizes=True),
        "speculation": frames_chart(paper, "speculation", "every n-th pixel traced", guessed, sizes=False),
    }  # fmt: skip


def is_full(paper: Paper, frame: Frame) -> bool:
    """What speculation's seconds are divided by: every pixel, at speculation's size."""
    return frame.method == FULL and any((f.width, f.height) == (frame.width, frame.height) for f in paper.speculation)


def frames_chart(paper: Paper, key: str, title: str, frames: Iterable[Frame], sizes: bool) -> list[Chart]:
    marks, floor = [], 0.0
    for f in sorted(frames, key=lambda f: (f.width, f.family)):
        if f.rmse is None:
            continue
        family = f"{f.family}, {megapixels((f.width, f.height))}" if sizes else f.family
        marks.append(Mark(family, TRIMS.get(f.label, f.label), f"{f.method}, {f.width} x {f.height}",
                          f.seconds_median, f.rmse))  # fmt: skip
        floor = max(floor, paper.floor[f"{f.width}x{f.height}"])
    if not marks:
        return []
    note = "grey: below what the truth, stored in float32, can tell" if any(m.error <= floor for m in marks) else ""
    return [
        marks_chart(key, f"{paper.scene}: {title}", "seconds a frame (median)", "RMSE, radiance", marks, floor, note)
    ]


# ------------------------------------------------------------------------------------------ tables


def tables(paper: Paper) -> list[Table]:
    """Every number that the page and paper.md show, as text."""
    made = digest(paper), calibration(paper), intersection(paper), speculation(paper), boxes(paper), asked(paper)
    return [t for t in made if t]


def digest(paper: Paper) -> Table | None:
    """What the paper states and what it is to be held against, in one table for a README."""
    rows = []
    for r in t.rows if (t := calibration(paper)) else ():
        kept = {(WHOLE, "1"): WHOLE, (OURS, "1"): OURS, (SHRUNK, "0.25"): "photos shrunk to a quarter"}
        if what := kept.get((r[1], r[2])):
            rows.append((f"calibration: {r[0]}", what, *r[8:10], *r[4:6], f"{r[6]} px held out"))
    for r in t.rows if (t := intersection(paper)) else ():
        if r[5] != "–" and not r[1].startswith("in place"):
            rows.append((f"intersection: {r[0]}, {r[2]}", r[1], *r[10:], *r[3:5], f"RMSE {r[5]}, {r[8]} px cut"))
    for r in t.rows if (t := speculation(paper)) else ():
        if r[1] in ("–", "4", "8"):
            what = r[0] if r[1] == "–" else f"{r[0]}, n = {r[1]}"
            rows.append((f"speculation: {r[2]}", what, "", "", *r[3:5], f"RMSE {r[5]}, worst {r[7]}"))
    if not rows:
        return None
    return Table(
        "digest", "At a glance", "Times faster: than the first row of the same kind, here and in the paper.",
        ("figure", "what", "the paper", "its times faster", "here", "times faster", "error"), tuple(rows), words=2,
    )  # fmt: skip


def published(paper: Paper, figure: str, start: str) -> tuple[float, ...]:
    return next((p.seconds for p in paper.published if p.figure == figure and p.what.startswith(start)), ())


def stated(values: tuple[float, ...]) -> str:
    return " and ".join(f"{v:g}" for v in values) + (" s" if values else "")


def calibration(paper: Paper) -> Table | None:
    rows = []
    base = {(c.source, c.setting, c.scale): c.seconds_median for c in paper.calibration}
    whole = published(paper, "calibration", "12 MP")
    for c in paper.calibration:
        theirs: tuple[float, ...] = ()
        large = c.width * c.height > 8e6
        if c.setting == WHOLE:
            small_set = sorted((c.width, c.height)) == [1000, 1333]
            theirs = whole if large else published(paper, "calibration", "photos of 1000") if small_set else ()
        elif c.setting == SHRUNK and c.scale == 0.25 and large:
            theirs = published(paper, "calibration", "a quarter")
        first = base.get((c.source, WHOLE, 1.0))
        rows.append((
            f"{c.source}, {c.photos} of {c.width} x {c.height}", c.setting, f"{c.scale:g}", str(c.tags),
            seconds(c.seconds_median), shown(first / c.seconds_median) if first else "–", shown(c.heldout_px),
            shown(c.focal_percent), stated(theirs),
            shown(whole[0] / theirs[0]) if theirs and large else "",
        ))  # fmt: skip
    if not rows:
        return None
    return Table(
        "calibration", "Calibration over image scale",
        "From photos on disk to a camera: decoding, finding the tags, choosing a lens model and fitting it; "
        "all cores unless said. Held-out: the rms error in photos that the fit has not seen, in pixels of the "
        "photos as taken, against the tags' true centres, or, in real photos, against what is found at full "
        "size. Focal: how far the focal length is from the truth, which only synthetic photos have. Photos "
        "shrunk: the paper's trick, centres scaled back with pixel centres at whole numbers. Reduced search: "
        "tags are looked for at that scale, their edges refined on the whole photo. The paper's seconds are "
        "for photos of its own, whose number may be another.",
        ("photos", "detector", "scale", "tags", "seconds", "times faster", "held-out, px", "focal, %", "the paper",
         "its times faster"), tuple(rows), words=2,
    )  # fmt: skip


def intersection(paper: Paper) -> Table | None:
    first = {(f.width, f.family): f.seconds_median for f in paper.intersection if f.label == "none"}
    untrimmed, trimmed = (published(paper, "intersection", w) for w in ("untrimmed", "trimmed"))
    rows = []
    for f in paper.intersection:
        loop = f.family.startswith("Python loop")
        theirs = {"none": untrimmed, "corners": trimmed}.get(f.label, ()) if loop else ()
        times = ""
        if loop and f.label == "corners":
            times = " and ".join(shown(a / b) for a, b in zip(untrimmed, trimmed, strict=True))
        slow = first.get((f.width, f.family))
        rows.append((
            f.family, TRIMS.get(f.label, "one sample a pixel" if f.label == "1" else f.label),
            f"{f.width} x {f.height}", seconds(f.seconds_median), shown(slow / f.seconds_median) if slow else "–",
            shown(f.rmse), shown(f.p999_abs), shown(f.max_abs), shown(f.cut), shown(f.wasted), stated(theirs), times,
        ))  # fmt: skip
    if not rows:
        return None
    return Table(
        "intersection", "Ray-sphere intersection, with and without bounding boxes",
        f"Diffuse light without shadows through a lens with distortion; the objects cover {100 * paper.covered:.2g} % "
        "of the frame. Errors of radiance against the untrimmed tracer in float64. Times faster: than the same engine "
        "untrimmed; its frames go into one array, kept from call to call. Cut: pixels that see an object outside its "
        "box. Wasted: pixels of boxes that do not see it.",
        ("method", "trim", "size", "seconds", "times faster", "RMSE", "99.9 %", "worst", "cut", "wasted", "the paper",
         "its times faster"), tuple(rows), words=3,
    )  # fmt: skip


def speculation(paper: Paper) -> Table | None:
    full = next((f for f in paper.intersection if is_full(paper, f)), None)
    shown_frames = ([full] if full and paper.speculation else []) + list(paper.speculation)
    rows = tuple(
        ("every pixel" if f is full else f.family.split(", ")[1], "–" if f is full else f.label.removeprefix("n="),
         f"{f.width} x {f.height}", seconds(f.seconds_median),
         shown(full.seconds_median / f.seconds_median) if full else "–",
         shown(f.rmse), shown(f.p999_abs), shown(f.max_abs))
        for f in shown_frames
    )  # fmt: skip
    if not rows:
        return None
    return Table(
        "speculation", "High-resolution speculation",
        "Every n-th pixel across and down is traced by NumPy in float32, the others are interpolated: everywhere "
        "(paper), or only where no edge or strong curvature is near (careful). Times faster: than tracing "
        "every pixel, untrimmed.",
        ("way", "n", "size", "seconds", "times faster", "RMSE", "99.9 %", "worst"), rows,
    )  # fmt: skip


def boxes(paper: Paper) -> Table | None:
    rows = [
        (b.scene, TRIMS[b.trim], f"{b.width} x {b.height}", shown(b.pixels), shown(b.wasted), shown(b.cut))
        for b in paper.boxes
    ]
    if not rows:
        return None
    return Table(
        "boxes", "Where boxes cut",
        "Pixels of the boxes round every object, summed; the last scenes are made to be hard.",
        ("scene", "trim", "size", "pixels", "wasted", "cut"), tuple(rows), words=3,
    )  # fmt: skip


def asked(paper: Paper) -> Table | None:
    rows = [(r.what, r.asked or "–", shown(r.measured)) for r in paper.ratios]
    if not rows:
        return None
    return Table(
        "ratios", "Ratios", "Of medians of warm calls in one run, the methods in turn.", ("ratio", "asked", "measured"),
        tuple(rows), words=2,
    )  # fmt: skip


def markdown(paper: Paper) -> str:
    """The page's tables; the first is meant for a README."""
    parts = [MACHINES.format(machine(paper))]
    for t in tables(paper):
        lines = ["| " + " | ".join(cells) + " |" for cells in (t.head, *t.rows)]
        lines.insert(1, "| " + " | ".join("---" if i < t.words else "---:" for i in range(len(t.head))) + " |")
        parts += [f"**{t.title}**", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"
