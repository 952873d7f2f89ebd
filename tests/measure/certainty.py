"""Samples until a verdict is certain, against the size of the fault: ours beside other tools.

`python -m measure.certainty [REPEATS] [SAMPLES] [SCENE ...]`, in tests/, prints a table of docs/measured.md (9
runs of 128 samples per pixel); with `--record` it draws docs/images/verdict.svg, too.

Every scene is path traced in blocks of BLOCK samples, the test's and the reference's apart. A fault changes the test's
blocks; all tools see the same ones. `in rounds` is SequentialComparison. Any other tool is asked at numbers of samples
that grow by a fourth root of two, or by two, and is certain from the first number on at which it notices the fault in
nine of ten runs: what a user with hindsight would have chosen.
"""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from measure import record
from measure.other_tools import ON_BATCHES, ON_IMAGES

import raytwin
from raytwin import twin
from raytwin.compare import SequentialComparison, compare
from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool
from raytwin.photos.find_camera import find_camera
from raytwin.renderers.subject_renderers import PathTraced, fast_engine
from raytwin.safe_write import write_text
from raytwin.show.charts.chart import Point, family_chart, svg_text
from raytwin.study.bench import sized

SCENES = ("overlap", "wedge", "ball")
BLOCK = 4
"""Samples per pixel of a block: the first look's."""
ALWAYS = 64 // BLOCK
"""Blocks that were always compared before verdicts came in rounds."""
DEPTH = 3
"""Surfaces and eye, as Mitsuba counts; the fault `a bounce missing` has one less."""
SIZES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""How much too bright."""
PIXELS = 0.0048
"""Megapixels of a picture: 80 x 60."""
LEAST_SHARE = 0.9
"""Share of the runs in which a fixed number of samples must notice the fault."""
COLOURS = "#0f8b8d", "#e07b00", "#7a3e9d", "#c02f4a", "#3b82c4", "#a16207"
"""Of the chart's lines, one per tool that has one."""

Blocks = Sequence[Image]
Sees = Callable[[Blocks, Blocks], bool]


class Fault(NamedTuple):
    """`size` of what is too bright, in the whole image or, if `local`, in 24 x 24 pixels; `shallow`: a bounce less."""

    name: str
    size: float = 0.0
    local: bool = False
    shallow: bool = False

    def put_into(self, image: Image) -> Image:
        gain = np.ones_like(image.mean)
        h, w = image.shape[:2]
        part = (slice((h - 24) // 2, (h + 24) // 2), slice((w - 24) // 2, (w + 24) // 2)) if self.local else ...
        gain[part] += np.float32(self.size)
        variance = None if image.variance is None else image.variance * gain**2
        return replace(image, mean=image.mean * gain, variance=variance)


FAULTS = (
    Fault("nothing wrong"),
    *(Fault(f"{100 * s:g} % too bright", s) for s in SIZES),
    *(Fault(f"24 x 24 pixels {100 * s:g} % too bright", s, local=True) for s in SIZES[:4]),
    Fault("a bounce missing", shallow=True),
)


class Run(NamedTuple):
    """Blocks of a test, of a test with a bounce less, and of the reference; they share no random number."""

    test: Blocks
    shallow: Blocks
    reference: Blocks


def blocks(scene: raytwin.Scene, count: int, seed: int) -> Run:
    engine = fast_engine(twin.activate().variant)

    def rendered(depth: int, part: int) -> list[Image]:
        call = PathTraced("path", engine, BLOCK, "center", depth=depth).prepare(scene)
        return [call(int(np.random.SeedSequence([seed, part, k]).generate_state(1)[0])) for k in range(count)]

    return Run(rendered(DEPTH, 0), rendered(DEPTH - 1, 2), rendered(DEPTH, 1))


def pool(images: Blocks) -> Image:
    made = ImagePool()
    for image in images:
        made.add(image)
    return made.image


def by_compare(a: Blocks, b: Blocks) -> bool:
    return compare(pool(a), pool(b)).verdict == "fail"


TOOLS: dict[str, tuple[Sees, int, int]] = {
    "best fixed": (by_compare, 4, 1),
    **{name: (sees, 4, 2) for name, sees in ON_BATCHES.items()},
    **{name: (lambda a, b, sees=sees: sees(pool(a), pool(b)), 1, 1) for name, sees in ON_IMAGES.items()},
}
"""Tool -> whether it sees a fault, the numbers of blocks per octave at which it is asked, and the fewest blocks."""


def counts(most: int, per_octave: int) -> Iterator[int]:
    """Yield numbers of blocks up to `most`, that many in each octave where whole numbers allow it."""
    n = 1
    while n <= most:
        yield n
        n = max(n + 1, round(n * 2 ** (1 / per_octave)))


def first(sees: Sees, pairs: Sequence[tuple[Blocks, Blocks]], per_octave: int, fewest: int) -> float | None:
    """Return the first number of samples at which LEAST_SHARE of the runs are noticed; None within none."""
    for n in counts(len(pairs[0][0]), per_octave):
        if n >= fewest and np.mean([sees(a[:n], b[:n]) for a, b in pairs]) >= LEAST_SHARE:
            return float(n * BLOCK)
    return None


def in_rounds(pairs: Sequence[tuple[Blocks, Blocks]], image: float | None, tile: float | None) -> float:
    """Return the median of samples of the most frequent verdict; a pass must exclude these biases."""
    ended = []
    for a, b in pairs:
        check = SequentialComparison(detectable_bias=image, detectable_tile_bias=tile)
        any(check.add(*both) for both in zip(a, b, strict=True))
        ended.append((check.conclude().verdict, check.samples))
    verdicts = [verdict for verdict, _ in ended]
    verdict = max(set(verdicts), key=verdicts.count)
    return float(np.median([n if v == verdict != "undecided" else math.inf for v, n in ended]))


def alarms(runs: Sequence[Run]) -> set[str]:
    """Return the tools that fail most correct pairs of 8 samples and more: they notice whatever they are shown."""
    pairs = [(r.test[:n], r.reference[:n]) for r in runs for n in counts(len(r.test), 1) if n > 1]
    return {name for name, (sees, *_) in TOOLS.items() if np.mean([sees(a, b) for a, b in pairs]) > 0.5}


def rows_of(scene: str, runs: Sequence[Run]) -> Iterator[list[str]]:
    """Yield a row per fault: scene, fault, samples in rounds, then those of the other tools."""

    def cell(samples: float | None) -> str:
        return "-" if samples is None or not math.isfinite(samples) else f"{samples:g}"

    wrong = alarms(runs)
    for fault in FAULTS:
        tests = [[fault.put_into(image) for image in (r.shallow if fault.shallow else r.test)] for r in runs]
        pairs = [(test, r.reference) for test, r in zip(tests, runs, strict=True)]
        asked = fault.size / 2 or None
        found = in_rounds(pairs, None if fault.local else asked, asked if fault.local else None)
        if not (fault.size or fault.shallow):
            yield [scene, fault.name, cell(found), *[""] * (len(TOOLS) + 1)]
            continue
        always = np.mean([by_compare(a[:ALWAYS], b[:ALWAYS]) for a, b in pairs]) >= LEAST_SHARE
        others = ["alarms" if name in wrong else cell(first(sees, pairs, *how)) for name, (sees, *how) in TOOLS.items()]
        yield [scene, fault.name, cell(found), others[0], "64" if always else "-", *others[1:]]


def draw(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Draw the first scene's faults of the whole image."""
    sizes = {fault.name: fault.size for fault in FAULTS if fault.size and not fault.local}
    shown = [row for row in rows if row[0] == rows[0][0] and row[1] in sizes]
    lines = {
        tool: sorted((100 * sizes[row[1]], float(row[i])) for row in shown if row[i] not in ("-", "alarms"))
        for i, tool in enumerate(columns[2:], 2)
    }
    drawn = {tool: line for tool, line in lines.items() if line}
    points = [
        Point(x, y, tool, tool, colour, strong=True, label=tool if (x, y) == line[-1] else "")
        for (tool, line), colour in zip(drawn.items(), COLOURS, strict=True) for x, y in line
    ]  # fmt: skip
    title = f"Samples until the fault is certain ({rows[0][0]}, 80 x 60 pixels)"
    chart = family_chart("verdict", title, "size of the fault, %", "samples per pixel", points)
    write_text(record.DOCS / "images" / "verdict.svg", svg_text(chart))


def main(*words: str) -> None:
    numbers = [int(word) for word in words if word.isdigit()]
    repeats, samples = (*numbers, *(9, 128)[len(numbers) :])
    columns, rows = ["scene", "fault", "in rounds", "best fixed", "always 64", *[*TOOLS][1:]], []
    for name in [w for w in words if not w.isdigit()] or SCENES:
        scene = find_camera(name)[0]
        scene = scene.with_camera(sized(scene.camera, PIXELS))
        rows += rows_of(name, [blocks(scene, samples // BLOCK, seed) for seed in range(repeats)])
    record.table("verdict", "certainty", columns, rows, f"python -m measure.certainty {repeats} {samples}")
    if record.RECORD in sys.argv:
        draw(columns, rows)


if __name__ == "__main__":
    main(*record.arguments())
