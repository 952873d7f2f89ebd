"""The tables of the page and of paper.md: typed rows first, texts last, a column a function of a row."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from raytwin.bench import Calibrated
from raytwin.bench.calibration_cost import OURS, SHRUNK, WHOLE
from raytwin.compare import METRICS
from raytwin.paper.paper_record import Boxed, Frame, Paper
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

T = TypeVar("T", Calibrated, Frame)


@dataclass(frozen=True)
class Timed(Generic[T]):
    """A measurement; `faster`: than its kind's first; `theirs`: the paper's seconds, `theirs_faster`: than its own."""

    of: T
    faster: float | None
    theirs: tuple[float, ...] = ()
    theirs_faster: tuple[float, ...] = ()


@dataclass(frozen=True)
class Glance:
    """A line of the first table; `error`: what it is worth, in words."""

    figure: str
    what: str
    timed: Timed[Any]
    error: str


@dataclass(frozen=True)
class Column:
    head: str
    text: Callable[[Any], str]
    number: bool = True


@dataclass(frozen=True)
class PaperTable:
    key: str
    title: str
    lead: str
    columns: tuple[Column, ...]
    rows: Sequence[Any]

    def texts(self) -> Iterator[list[str]]:
        for row in self.rows:
            yield [column.text(row) for column in self.columns]


# ------------------------------------------------------------------------------------------ typed rows


def calibrations(paper: Paper) -> list[Timed[Calibrated]]:
    first = {c.source: c.seconds_median for c in paper.calibration if (c.setting, c.scale) == (WHOLE, 1.0)}
    whole = published(paper, "calibration", "12 MP")
    rows = []
    for c in paper.calibration:
        theirs = published(paper, "calibration", counterpart(c))
        faster = first[c.source] / c.seconds_median if c.source in first else None
        rows.append(Timed(c, faster, theirs, (whole[0] / theirs[0],) if theirs and large(c) else ()))
    return rows


def counterpart(c: Calibrated) -> str | None:
    """How the paper calls what is the same there."""
    if c.setting == WHOLE and large(c):
        return "12 MP"
    if c.setting == WHOLE and sorted((c.width, c.height)) == [1000, 1333]:
        return "photos of 1000"
    return "a quarter" if c.setting == SHRUNK and c.scale == 0.25 and large(c) else None


def large(c: Calibrated) -> bool:
    return c.width * c.height > 8e6


def published(paper: Paper, figure: str, start: str | None) -> tuple[float, ...]:
    """The seconds that the paper states; none where it does not."""
    found = (p.seconds for p in paper.published if start and p.figure == figure and p.what.startswith(start))
    return next(found, ())


def intersections(paper: Paper) -> list[Timed[Frame]]:
    first = {(f.width, f.family): f.seconds_median for f in paper.intersection if f.label == "none"}
    untrimmed, trimmed = (published(paper, "intersection", w) for w in ("untrimmed", "trimmed"))
    faster = tuple(a / b for a, b in zip(untrimmed, trimmed, strict=True))
    theirs = {"none": (untrimmed, ()), "corners": (trimmed, faster)}
    rows = []
    for f in paper.intersection:
        own = theirs.get(f.label, ((), ())) if f.family.startswith("Python loop") else ((), ())
        slow = first.get((f.width, f.family))
        rows.append(Timed(f, slow / f.seconds_median if slow else None, *own))
    return rows


def speculations(paper: Paper) -> list[Timed[Frame]]:
    """Every pixel first, at speculation's size."""
    full = [f for f in paper.intersection if is_full(paper, f)][:1]
    return [Timed(f, full[0].seconds_median / f.seconds_median if full else None) for f in (*full, *paper.speculation)]


def is_full(paper: Paper, frame: Frame) -> bool:
    """What speculation's seconds are divided by: every pixel, at speculation's size."""
    return frame.method == FULL and any((f.width, f.height) == (frame.width, frame.height) for f in paper.speculation)


def glances(paper: Paper) -> list[Glance]:
    """What the paper states, beside the row of ours that it is compared with."""
    names = {(WHOLE, 1.0): WHOLE, (OURS, 1.0): OURS, (SHRUNK, 0.25): "photos shrunk to a quarter"}
    rows = [
        Glance(f"calibration: {photos_of(c)}", what, c, f"{shown(c.of.heldout_px)} px held out")
        for c in calibrations(paper)
        if (what := names.get((c.of.setting, c.of.scale)))
    ]
    rows += [
        Glance(f"intersection: {f.of.family}, {size_of(f.of)}", TRIMS.get(f.of.label, f.of.label), f,
               f"RMSE {shown(f.of.rmse)}, {shown(f.of.cut)} px cut")
        for f in intersections(paper)
        if f.of.rmse is not None and f.of.label != "in place"
    ]  # fmt: skip
    rows += [
        Glance(f"speculation: {size_of(f.of)}", way_of(f.of) + (f", n = {n}" if (n := every_of(f.of)) else ""), f,
               f"RMSE {shown(f.of.rmse)}, worst {shown(f.of.max_abs)}")
        for f in speculations(paper)
        if every_of(f.of) in (None, 4, 8)
    ]  # fmt: skip
    return rows


# ------------------------------------------------------------------------------------------ texts


def size_of(thing: Frame | Boxed) -> str:
    return f"{thing.width} x {thing.height}"


def photos_of(c: Timed[Calibrated]) -> str:
    return f"{c.of.source}, {c.of.photos} of {c.of.width} x {c.of.height}"


def every_of(frame: Frame) -> int | None:
    """n, where every n-th pixel is traced; None where all are."""
    return int(frame.label.removeprefix("n=")) if frame.label.startswith("n=") else None


def way_of(frame: Frame) -> str:
    return frame.family.split(", ")[1] if every_of(frame) else "every pixel"


def stated(values: tuple[float, ...]) -> str:
    return " and ".join(f"{v:g}" for v in values) + (" s" if values else "")


def ratios_of(values: tuple[float, ...]) -> str:
    return " and ".join(shown(v) for v in values)


def error_column(metric: str) -> Column:
    return Column(METRICS[metric].title, lambda r: shown(getattr(r.of, metric)))


TIMES = (
    Column("seconds", lambda r: seconds(r.of.seconds_median)),
    Column("times faster", lambda r: shown(r.faster)),
)
ERROR_COLUMNS = tuple(error_column(name) for name in ERRORS)
THEIRS = (
    Column("the paper", lambda r: stated(r.theirs)),
    Column("its times faster", lambda r: ratios_of(r.theirs_faster)),
)


def tables(paper: Paper) -> list[PaperTable]:
    """Every number that the page and paper.md show; those tables that have a row."""
    made = (
        PaperTable(
            "digest", "At a glance", "Times faster: than the first row of the same kind, here and in the paper.",
            (Column("figure", lambda r: r.figure, False), Column("what", lambda r: r.what, False),
             Column("the paper", lambda r: stated(r.timed.theirs)),
             Column("its times faster", lambda r: ratios_of(r.timed.theirs_faster)),
             Column("here", lambda r: seconds(r.timed.of.seconds_median)),
             Column("times faster", lambda r: shown(r.timed.faster)), Column("error", lambda r: r.error)),
            glances(paper),
        ),
        PaperTable(
            "calibration", "Calibration over image scale",
            "From photos on disk to a camera: decoding, finding the tags, choosing a lens model and fitting it; "
            "all cores unless said. Held-out: the rms error in photos that the fit has not seen, in pixels of the "
            "photos as taken, against the tags' true centres, or, in real photos, against what is found at full "
            "size. Focal: how far the focal length is from the truth, which only synthetic photos have. Photos "
            "shrunk: the paper's trick, centres scaled back with pixel centres at whole numbers. Reduced search: "
            "tags are looked for at that scale, their edges refined on the whole photo. The paper's seconds are "
            "for photos of its own, whose number may be another.",
            (Column("photos", photos_of, False), Column("detector", lambda r: r.of.setting, False),
             Column("scale", lambda r: f"{r.of.scale:g}"), Column("tags", lambda r: str(r.of.tags)), *TIMES,
             Column("held-out, px", lambda r: shown(r.of.heldout_px)),
             Column("focal, %", lambda r: shown(r.of.focal_percent)), *THEIRS),
            calibrations(paper),
        ),
        PaperTable(
            "intersection", "Ray-sphere intersection, with and without bounding boxes",
            f"Diffuse light without shadows through a lens with distortion; the objects cover {100 * paper.covered:.2g}"
            " % of the frame. Errors of radiance against the untrimmed tracer in float64. Times faster: than the same "
            "engine untrimmed; its frames go into one array, kept from call to call. Cut: pixels that see an object "
            "outside its box. Wasted: pixels of boxes that do not see it.",
            (Column("method", lambda r: r.of.family, False),
             Column("trim", lambda r: TRIMS.get(r.of.label, r.of.label), False),
             Column("size", lambda r: size_of(r.of), False), *TIMES, *ERROR_COLUMNS,
             Column("cut", lambda r: shown(r.of.cut)),
             Column("wasted", lambda r: shown(r.of.wasted)), *THEIRS),
            intersections(paper),
        ),
        PaperTable(
            "speculation", "High-resolution speculation",
            "Every n-th pixel across and down is traced by NumPy in float32, the others are interpolated: everywhere "
            "(paper), or only where no edge or strong curvature is near (careful). Times faster: than tracing "
            "every pixel, untrimmed.",
            (Column("way", lambda r: way_of(r.of), False), Column("n", lambda r: shown(every_of(r.of))),
             Column("size", lambda r: size_of(r.of)), *TIMES, *ERROR_COLUMNS),
            speculations(paper),
        ),
        PaperTable(
            "boxes", "Where boxes cut",
            "Pixels of the boxes round every object, summed; the last scenes are made to be hard.",
            (Column("scene", lambda b: b.scene, False), Column("trim", lambda b: TRIMS[b.trim], False),
             Column("size", size_of, False), Column("pixels", lambda b: shown(b.pixels)),
             Column("wasted", lambda b: shown(b.wasted)), Column("cut", lambda b: shown(b.cut))),
            paper.boxes,
        ),
        PaperTable(
            "ratios", "Ratios", "Of medians of warm calls in one run, the methods in turn.",
            (Column("ratio", lambda r: r.what, False), Column("asked", lambda r: r.asked or "–", False),
             Column("measured", lambda r: shown(r.measured))),
            paper.ratios,
        ),
    )  # fmt: skip
    return [table for table in made if table.rows]


def markdown(paper: Paper, head: str) -> str:
    """The page's tables; the first is meant for a README."""
    parts = [head]
    for table in tables(paper):
        rules = ["---:" if column.number else "---" for column in table.columns]
        lines = [[column.head for column in table.columns], rules, *table.texts()]
        parts += [f"**{table.title}**", "\n".join(f"| {' | '.join(cells)} |" for cells in lines)]
    return "\n\n".join(parts) + "\n"
