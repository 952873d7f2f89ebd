"""The tables of the page and of paper.md, as texts."""

from collections.abc import Iterator
from typing import NamedTuple

from raytwin.bench import Calibrated
from raytwin.bench.calibration_cost import OURS, SHRUNK, WHOLE
from raytwin.compare import METRICS
from raytwin.paper.paper_record import Frame, Paper
from raytwin.paper.paper_runs import ERRORS, FULL
from raytwin.report.numbers import seconds, shown

TRIMS = {
    "none": "untrimmed",
    "corners": "eight-corner box",
    "conic": "conic box",
    "in place": "in place, conic box",
    "fill": "nothing",
    "1": "one sample a pixel",
}
DETECTORS = {(WHOLE, 1.0): WHOLE, (OURS, 1.0): OURS, (SHRUNK, 0.25): "photos shrunk to a quarter"}
"""(setting, scale) -> how the first table calls it."""
TIMES = "seconds", "times faster"
THEIRS = "the paper", "its times faster"
METRIC_NAMES = tuple(METRICS[name].title for name in ERRORS)

Cells = list[str]
Rows = Iterator[tuple[Cells | None, Cells]]
"""Lines of a table; with the line of the first table that sums it up, if there is one."""


class PaperTable(NamedTuple):
    """`words`: how many columns, from the left, are text; the others are numbers."""

    key: str
    title: str
    heads: tuple[str, ...]
    words: int
    rows: list[Cells]


def calibration_rows(paper: Paper) -> Rows:
    first = {c.source: c.seconds_median for c in paper.calibration if (c.setting, c.scale) == (WHOLE, 1.0)}
    (whole,) = published(paper, "calibration", "12 MP")
    for c in paper.calibration:
        photos = f"{c.source}, {c.photos} of {size_of(c)}"
        stated = published(paper, "calibration", counterpart(c))
        theirs = [in_seconds(stated), shown(whole / stated[0]) if stated and is_large(c) else ""]
        times = [seconds(c.seconds_median), ratio(first.get(c.source), c)]
        name = DETECTORS.get((c.setting, c.scale))
        glance = name and [f"calibration: {photos}", name, *theirs, *times, f"{shown(c.heldout_px)} px held out"]
        errors = shown(c.heldout_px), shown(c.focal_percent)
        yield glance or None, [photos, c.setting, f"{c.scale:g}", str(c.tags), *times, *errors, *theirs]


def counterpart(c: Calibrated) -> str | None:
    """Return what the paper calls the same there."""
    if c.setting == WHOLE and is_large(c):
        return "12 MP"
    if c.setting == WHOLE and sorted((c.width, c.height)) == [1000, 1333]:
        return "photos of 1000"
    return "a quarter" if c.setting == SHRUNK and c.scale == 0.25 and is_large(c) else None


def is_large(c: Calibrated) -> bool:
    return c.width * c.height > 8e6


def published(paper: Paper, figure: str, start: str | None) -> tuple[float, ...]:
    """Return the seconds that the paper states; none where it does not."""
    found = (p.seconds for p in paper.published if start and p.figure == figure and p.what.startswith(start))
    return next(found, ())


def intersection_rows(paper: Paper) -> Rows:
    first = {(f.width, f.family): f.seconds_median for f in paper.intersection if f.label == "none"}
    slow, trimmed = (published(paper, "intersection", w) for w in ("untrimmed", "trimmed"))
    faster = " and ".join(shown(a / b) for a, b in zip(slow, trimmed, strict=True))
    stated = {"none": [in_seconds(slow), ""], "corners": [in_seconds(trimmed), faster]}
    for f in paper.intersection:
        theirs = stated.get(f.label, ["", ""]) if f.family.startswith("Python loop") else ["", ""]
        trim, times = TRIMS.get(f.label, f.label), [seconds(f.seconds_median), ratio(first.get((f.width, f.family)), f)]
        glance = None
        if f.rmse is not None and f.label != "in place":
            error = f"RMSE {shown(f.rmse)}, {shown(f.cut)} px cut"
            glance = [f"intersection: {f.family}, {size_of(f)}", trim, *theirs, *times, error]
        yield glance, [f.family, trim, size_of(f), *times, *errors(f), shown(f.cut), shown(f.wasted), *theirs]


def speculation_rows(paper: Paper) -> Rows:
    """Yield every pixel first, at speculation's size."""
    full = [f for f in paper.intersection if is_full(paper, f)][:1]
    for f in (*full, *paper.speculation):
        every = f.label.removeprefix("n=") if f.label.startswith("n=") else ""
        way = f.family.split(", ")[1] if every else "every pixel"
        times = [seconds(f.seconds_median), ratio(full[0].seconds_median if full else None, f)]
        glance = None
        if every in ("", "4", "8"):
            error = f"RMSE {shown(f.rmse)}, worst {shown(f.max_abs)}"
            named = f"{way}, n = {every}" if every else way
            glance = [f"speculation: {size_of(f)}", named, "", "", *times, error]
        yield glance, [way, every or "–", size_of(f), *times, *errors(f)]


def is_full(paper: Paper, frame: Frame) -> bool:
    """Return whether this is what speculation's seconds are divided by: every pixel, at speculation's size."""
    return frame.method == FULL and any((f.width, f.height) == (frame.width, frame.height) for f in paper.speculation)


def size_of(thing: Calibrated | Frame) -> str:
    return f"{thing.width} x {thing.height}"


def ratio(first: float | None, timed: Calibrated | Frame) -> str:
    return shown(first / timed.seconds_median if first else None)


def in_seconds(values: tuple[float, ...]) -> str:
    return " and ".join(f"{v:g}" for v in values) + (" s" if values else "")


def errors(frame: Frame) -> Cells:
    return [shown(getattr(frame, name)) for name in ERRORS]


def tables(paper: Paper) -> list[PaperTable]:
    """Return every number that the page and paper.md show; those tables that have a row."""
    parts = [list(rows) for rows in (calibration_rows(paper), intersection_rows(paper), speculation_rows(paper))]
    calibration, intersection, speculation = ([cells for _, cells in part] for part in parts)
    digest = [glance for part in parts for glance, _ in part if glance]
    boxes = [
        [b.scene, TRIMS[b.trim], f"{b.width} x {b.height}", shown(b.pixels), shown(b.wasted), shown(b.cut)]
        for b in paper.boxes
    ]
    ratios = [[r.what, r.asked or "–", shown(r.measured)] for r in paper.ratios]
    made = (
        PaperTable("digest", "At a glance", ("figure", "what", *THEIRS, "here", "times faster", "error"), 2, digest),
        PaperTable(
            "calibration",
            "Calibration over image scale",
            ("photos", "detector", "scale", "tags", *TIMES, "held-out, px", "focal, %", *THEIRS),
            2,
            calibration,
        ),
        PaperTable(
            "intersection",
            "Ray-sphere intersection, with and without bounding boxes",
            ("method", "trim", "size", *TIMES, *METRIC_NAMES, "cut", "wasted", *THEIRS),
            3,
            intersection,
        ),
        PaperTable(
            "speculation", "High-resolution speculation", ("way", "n", "size", *TIMES, *METRIC_NAMES), 1, speculation
        ),
        PaperTable("boxes", "Where boxes cut", ("scene", "trim", "size", "pixels", "wasted", "cut"), 2, boxes),
        PaperTable("ratios", "Ratios", ("ratio", "asked", "measured"), 2, ratios),
    )
    return [table for table in made if table.rows]


def markdown(paper: Paper, head: str) -> str:
    """Return the page's tables; the first is meant for a README."""
    parts = [head]
    for table in tables(paper):
        rules = ["---" if k < table.words else "---:" for k in range(len(table.heads))]
        lines = [f"| {' | '.join(row)} |" for row in (table.heads, rules, *table.rows)]
        parts += [f"**{table.title}**", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"
