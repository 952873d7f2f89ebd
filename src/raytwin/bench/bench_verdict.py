"""Samples and seconds until a verdict is certain, against the size of the fault: ours beside other tools.

Every scene is path traced in blocks of BLOCK samples, the test's and the reference's apart. A fault changes the test's
blocks; all tools see the same ones. `in rounds` is SequentialComparison. Any other tool is asked at numbers of samples
that grow by a fourth root of two, or by two, and is certain from the first number on at which it notices the fault in
every run: what a user with hindsight would have chosen.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin import files, twin
from raytwin.bench.bench_run import machine, sized
from raytwin.bench.verdict_tools import ON_BATCHES, ON_IMAGES
from raytwin.calib.find_camera import find_camera
from raytwin.compare import SequentialComparison, compare
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.image_pool import ImagePool
from raytwin.progress import Progress, silent
from raytwin.renderers.subject_renderers import PathTraced, fast_engine
from raytwin.scene import Record, Scene
from raytwin.workflows.versions import versions

SCENES = ("overlap", "wedge", "ball")
BLOCK = 4
"""Samples per pixel of a block: the first look's."""

DEPTH = 3
"""Surfaces and eye, as Mitsuba counts; the fault `a bounce missing` has one less."""

SIZES = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""How much too bright."""

PIXELS = 0.0048
"""Megapixels of a picture: 80 x 60."""

LEAST_SHARE = 0.9
"""Share of the runs in which a fixed number of samples must notice the fault."""

IN_ROUNDS, FIXED, ALWAYS = "in rounds", "best fixed number", "always 64"
AS_BY_64 = "nothing wrong, {} as by 64"
"""Correct pairs in rounds until a pass excludes the bias that a comparison of 64 samples per pixel would have found."""


class Certainty(Record, frozen=True):
    """A tool and a fault: `size` of the fault, and the median `samples` and `seconds` until it was certain.

    null where it was not within the samples taken. `seconds`: rendering both sides, and the test. `verdict`: what it
    was certain of. `runs`: how many there were.
    """

    scene: str
    tool: str
    fault: str
    where: str
    size: float
    verdict: str
    samples: float | None
    seconds: float | None
    runs: int


class Alarms(Record, frozen=True):
    """How often a tool failed correct pairs: `alarms` of `asked`, and the 95 % interval of the rate."""

    scene: str
    tool: str
    alarms: int
    asked: int
    low: float
    high: float


class VerdictBench(Record, frozen=True):
    """All that `raytwin bench verdict` measured."""

    machine: dict[str, str]
    versions: dict[str, str]
    most_samples: int
    rows: tuple[Certainty, ...]
    alarms: tuple[Alarms, ...]
    seconds: float

    def table(self) -> list[dict[str, object]]:
        """Return the rows as dicts, for a chart or a data frame."""
        return [msgspec.structs.asdict(row) for row in self.rows]

    def ratios(self) -> list[float]:
        """Samples in rounds over those of the best fixed number, of each fault that both noticed."""
        found = {(r.scene, r.fault, r.tool): r.samples for r in self.rows if r.size}
        pairs = ((found.get((s, f, IN_ROUNDS)), n) for (s, f, tool), n in found.items() if tool == FIXED)
        return [mine / best for mine, best in pairs if mine and best]


class Fault(NamedTuple):
    """What is wrong with the test: `change` makes a block wrong, `where` and `size` say how."""

    name: str
    where: str
    size: float
    change: Callable[[Image], Image]
    shallow: bool = False


def _same(image: Image) -> Image:
    return image


def _brighter(size: float, local: bool, image: Image) -> Image:
    gain = np.ones_like(image.mean)
    if local:
        h, w = image.shape[:2]
        gain[(h - 24) // 2 : (h + 24) // 2, (w - 24) // 2 : (w + 24) // 2] += np.float32(size)
    else:
        gain += np.float32(size)
    variance = None if image.variance is None else image.variance * gain * gain
    return replace(image, mean=image.mean * gain, variance=variance)


FAULTS: tuple[Fault, ...] = (
    Fault("nothing wrong", "", 0.0, _same),
    *(Fault(f"{100 * s:g} % too bright", "whole image", s, partial(_brighter, s, False)) for s in SIZES),
    *(Fault(f"24 x 24 pixels {100 * s:g} % too bright", "24 x 24 pixels", s, partial(_brighter, s, True))
      for s in SIZES[:4]),
    Fault("a bounce missing", "light path", 0.0, _same, shallow=True),
)  # fmt: skip


class _Run(NamedTuple):
    """The blocks of one run: of the test, of a test with a bounce less, of the reference; seconds of a pair."""

    test: list[Image]
    shallow: list[Image]
    reference: list[Image]
    seconds: float

    def faulty(self, fault: Fault) -> list[Image]:
        return [fault.change(image) for image in (self.shallow if fault.shallow else self.test)]


def bench_verdict(
    scenes: Sequence[str] = SCENES, *, repeats: int = 3, most: int = 256, progress: Progress = silent
) -> VerdictBench:
    """Measure every tool on every fault: `repeats` runs of `most` samples per pixel on each of the `scenes`."""
    if repeats < 1:
        raise InputError("--repeats", "at least 1", repeats)
    if most < 2 * BLOCK or most % BLOCK:
        raise InputError("--samples", f"a multiple of {BLOCK}, at least {2 * BLOCK}", most)
    began = time.perf_counter()
    engine = fast_engine(twin.activate().variant)
    rows: list[Certainty] = []
    alarms: list[Alarms] = []
    for i, name in enumerate(scenes):
        scene = find_camera(files.read_scene(name))[0]
        scene = scene.with_camera(sized(scene.camera, PIXELS))
        runs = [_blocks(scene, engine, most // BLOCK, seed) for seed in range(repeats)]
        for j, fault in enumerate(FAULTS):
            progress("verdicts", i * len(FAULTS) + j, len(scenes) * len(FAULTS))
            found = list(_measure(scene.name, fault, runs))
            rows += found
            if fault.name == "nothing wrong":
                alarms += _alarms(scene.name, runs)
    progress("verdicts", 1, 1)
    return VerdictBench(machine(), versions(), most, tuple(rows), tuple(alarms), time.perf_counter() - began)


def _blocks(scene: Scene, engine: str, count: int, seed: int) -> _Run:
    """Blocks that share no random number."""

    def rendered(depth: int, part: int, blocks: int = count) -> list[Image]:
        call = PathTraced("path", engine, BLOCK, "center", depth=depth).prepare(scene)
        return [call(int(np.random.SeedSequence([seed, part, k]).generate_state(1)[0])) for k in range(blocks)]

    for depth in (DEPTH, DEPTH - 1):  # what is compiled once is no part of the seconds
        rendered(depth, 9, 1)
    start = time.perf_counter()
    test, reference = rendered(DEPTH, 0), rendered(DEPTH, 1)
    seconds = (time.perf_counter() - start) / count
    return _Run(test, rendered(DEPTH - 1, 2), reference, seconds)


def _counts(most: int, per_octave: int) -> Iterator[int]:
    """Numbers of blocks up to `most`, that many in each octave where whole numbers allow it."""
    n = 1
    while n <= most:
        yield n
        n = max(n + 1, round(n * 2 ** (1 / per_octave)))


def _pool(images: Sequence[Image]) -> Image:
    pool = ImagePool()
    for image in images:
        pool.add(image)
    return pool.image


def _measure(scene: str, fault: Fault, runs: Sequence[_Run]) -> Iterator[Certainty]:
    """A row for each tool."""
    tests = [run.faulty(fault) for run in runs]
    references = [run.reference for run in runs]
    pair = float(np.median([run.seconds for run in runs]))

    def row(tool: str, verdict: str, samples: float | None, own: float, name: str = fault.name) -> Certainty:
        seconds = None if samples is None else samples / BLOCK * pair + own
        return Certainty(scene, tool, name, fault.where, fault.size, verdict, samples, seconds, len(runs))

    def in_rounds(biases: Sequence[tuple[float | None, float | None]], name: str = fault.name) -> Certainty:
        ended = [_in_rounds(*pair, *asked) for pair, asked in zip(pairs, biases, strict=True)]
        verdicts = [verdict for verdict, _, _ in ended]
        verdict = max(set(verdicts), key=verdicts.count)
        samples = float(np.median([n if v == verdict != "undecided" else math.inf for v, n, _ in ended]))
        own = float(np.median([seconds for *_, seconds in ended]))
        return row(IN_ROUNDS, verdict, samples if math.isfinite(samples) else None, own, name)

    pairs = list(zip(tests, references, strict=True))
    local, asked = fault.where == "24 x 24 pixels", fault.size / 2 or None
    yield in_rounds([(None, asked) if local else (asked, None)] * len(runs))
    always = 64 // BLOCK
    if not (fault.size or fault.shallow):
        if len(tests[0]) >= always:
            seen = [compare(_pool(a[:always]), _pool(b[:always])).statistics for a, b in pairs]
            both = [(s.minimum_detectable_bias, s.minimum_detectable_tile_bias) for s in seen]
            yield in_rounds([(image, None) for image, _ in both], AS_BY_64.format("image"))
            yield in_rounds(both, AS_BY_64.format("image and tiles"))
        return

    def by_compare(a: Sequence[Image], b: Sequence[Image]) -> bool:
        return compare(_pool(a), _pool(b)).verdict == "fail"

    yield row(FIXED, "fail", *_first(by_compare, tests, references, 4))
    if len(tests[0]) >= always:
        start = time.perf_counter()
        share = np.mean([by_compare(a[:always], b[:always]) for a, b in pairs])
        own = (time.perf_counter() - start) / len(tests)
        yield row(ALWAYS, "fail", 64.0 if share >= LEAST_SHARE else None, own)
    for tool, on_batches in ON_BATCHES.items():
        yield row(tool, "fail", *_first(on_batches, tests, references, 4, fewest=2))
    for tool, on_images in ON_IMAGES.items():
        try:
            first = _first(partial(_on_pools, on_images), tests, references, 1)
        except ImportError:
            continue
        yield row(tool, "fail", *first)


def _on_pools(sees: Callable[[Image, Image], bool], a: Sequence[Image], b: Sequence[Image]) -> bool:
    return sees(_pool(a), _pool(b))


def _in_rounds(
    test: Sequence[Image], reference: Sequence[Image], image: float | None = None, tile: float | None = None
) -> tuple[str, int, float]:
    """(verdict, samples, seconds of the looks); a pass must exclude these biases of the `image` and of a `tile`."""
    check = SequentialComparison(detectable_bias=image, detectable_tile_bias=tile)
    start = time.perf_counter()
    for a, b in zip(test, reference, strict=True):
        if check.add(a, b):
            break
    made = check.conclude()
    return made.verdict, check.samples, time.perf_counter() - start


def _first(
    sees: Callable[[Sequence[Image], Sequence[Image]], bool], tests: Sequence[list[Image]],
    references: Sequence[list[Image]], per_octave: int, fewest: int = 1,
) -> tuple[float | None, float]:  # fmt: skip
    """The first number of samples at which LEAST_SHARE of the runs are noticed, and the seconds of one test there."""
    for n in _counts(len(tests[0]), per_octave):
        if n < fewest:
            continue
        start = time.perf_counter()
        missed = 0
        for a, b in zip(tests, references, strict=True):
            missed += not sees(a[:n], b[:n])
            if missed > (1 - LEAST_SHARE) * len(tests):
                break
        else:
            return float(n * BLOCK), (time.perf_counter() - start) / len(tests)
    return None, 0.0


def _alarms(scene: str, runs: Sequence[_Run]) -> Iterator[Alarms]:
    """Correct pairs: every tool at every doubling of the samples, and the rounds once a run."""
    from scipy.stats import binomtest

    def counted(tool: str, failed: list[bool]) -> Alarms:
        interval = binomtest(sum(failed), len(failed)).proportion_ci()
        return Alarms(scene, tool, sum(failed), len(failed), float(interval.low), float(interval.high))

    yield counted(IN_ROUNDS, [_in_rounds(run.test, run.reference)[0] == "fail" for run in runs])
    prefixes = [(r.test[:n], r.reference[:n]) for r in runs for n in _counts(len(r.test), 1) if n > 1]
    pooled = [(_pool(a), _pool(b)) for a, b in prefixes]
    yield counted(FIXED, [compare(a, b).verdict == "fail" for a, b in pooled])
    for tool, on_batches in ON_BATCHES.items():
        yield counted(tool, [on_batches(a, b) for a, b in prefixes])
    for tool, on_images in ON_IMAGES.items():
        try:
            yield counted(tool, [on_images(a, b) for a, b in pooled])
        except ImportError:
            continue
