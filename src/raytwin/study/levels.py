"""How much light a scene needs: every method's error and cost, the cheapest for a tolerance, and what can be left out.

The cost that orders methods is counted, not timed, so that a busy machine gives the same answer: the rays that a pixel
needs. A path that goes on meets a surface, and sends from there a ray to the sun and one onward. With s_k the share of
paths that meet a k-th surface, one sample to depth d costs

    1 + 2 (s_1 + ... + s_{d-1})

rays, and 3 for each 2 where an environment map is sampled too. The s_k are measured in a white furnace.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import twin
from raytwin.errors import InputError, check_one_of
from raytwin.fast import PARTS, light_parts, trace
from raytwin.images.image import Image
from raytwin.notebook import InNotebook
from raytwin.photos.find_camera import find_camera
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import Filled, PathTraced, Traced, fast_engine
from raytwin.renderers.twin_renderers import Twin
from raytwin.rungs import RUNGS
from raytwin.scene import Record, Scene, Sky
from raytwin.study.converged import SQUARES, Error, Reference, converged, unbiased_error

METRICS = *SQUARES, "mae", "max_abs", "p999_abs", "p999_rel"
"""Metrics that are 0 for equal images."""
WIDTH = 320
"""Pixels across by default."""
DEPTHS = 2, 3, 4, 8
"""Depths of random walks: no bounce, one, two, and six."""
SAMPLES = 1, 4, 16, 64
"""Samples per pixel of the table. A tolerance tries all powers of two up to MAX_SAMPLES."""
MAX_SAMPLES = 1024
"""Samples per pixel, at most, of a method that is tried for a tolerance."""
REFERENCE_DEPTH, REFERENCE_SAMPLES, MAX_REFERENCE_SAMPLES = 16, 256, 4096
"""Samples per pixel without a tolerance; with one, at most."""
FLOOR = 0.1, 1 / 3
"""Shares of the tolerance: the floor that the reference is rendered to, and the one that is too high to answer."""
PART_SAMPLES, PART_SEEDS = 64, (31, 32)
"""Samples per pixel of each half of the light's parts."""


class Row(Record, frozen=True):
    """One method. `error`: in the metric; `error_most`: two standard errors more. `rays`: per pixel, the cost.

    `depth`: of random walks. `seconds`: a frame, the least of at most three calls. `side`: tracer or twin.
    """

    method: str
    side: str
    rung: str
    depth: int | None
    sampling: str
    samples: int
    rays: float
    seconds: float
    error: float
    error_most: float


class Part(Record, frozen=True):
    """A part of the light: the `error` of an image without it.

    `share_of_light`: its mean over that of all light, less than 0 where it takes light away. `can_be_dropped`: the
    error is at most the tolerance. None without a tolerance.
    """

    part: str
    error: float
    error_most: float
    share_of_light: float | None
    can_be_dropped: bool | None


class Table(Record, frozen=True):
    """What levels.json holds; `rows` from the lowest cost up.

    `choice`: the cheapest of the tracer's methods whose `error_most` is at most `tolerance`, None where none is or
    none was asked for; `reason` says why. `floor`: the largest error that the reference cannot tell from none.
    """

    scene: str
    width: int
    height: int
    metric: str
    tolerance: float | None
    choice: Row | None
    reason: str
    rows: tuple[Row, ...]
    parts: tuple[Part, ...]
    reference_samples: int
    floor: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Levels(InNotebook):
    """`images`: title -> the picture of each light level, and the reference."""

    found: Table
    images: dict[str, Image]

    @property
    def choice(self) -> Row | None:
        return self.found.choice

    def table(self) -> list[dict[str, Any]]:
        """Return a row per method, the cheapest first: what `pandas.DataFrame` takes."""
        return [row.to_dict() for row in self.found.rows]

    def to_dict(self) -> dict[str, Any]:
        """Return what levels.json holds."""
        return self.found.to_dict()

    def __repr__(self) -> str:
        return f"<raytwin.levels of {self.found.scene}, {self.found.width} x {self.found.height}>"


def levels(
    path: str | Path | Scene,
    tolerance: float | None = None,
    metric: str = "rmse",
    *,
    size: tuple[int, int] | None = None,
    photo: str | None = None,
    light: Path | None = None,
    progress: Progress = silent,
) -> Levels:
    """Measure every light level of a scene: its error against all light over the pixels' area, and its cost.

    With a `tolerance` the answer names the cheapest method that meets it, and what can be left out. `path`: a scene's
    folder or name, or a Scene. `metric`: rmse, relmse, mae, max_abs, p999_abs or p999_rel. `size`: (width, height) in
    pixels, by default the camera's, at most 320 wide. `photo`: whose camera pose is used. `light`: a light.toml.
    `table()` of the result has a row per method. Raises InputError for a wrong tolerance or metric.
    """
    check_one_of("--metric", metric, METRICS)
    if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0):
        raise InputError("--tolerance", "a finite number > 0", tolerance)
    began, stages = time.perf_counter(), Stages(progress)
    scene = find_camera(path, photo, stages)[0]
    if light is not None:
        from raytwin.photos.lighting.light_file import read_light  # with OpenCV

        scene = read_light(light).on(scene)
    w, h = scene.camera.image_size
    size = size or ((WIDTH, max(1, round(WIDTH * h / w))) if w > WIDTH else (w, h))
    scene = scene.with_camera(scene.camera.resized(*size))
    with stages.stage("backend"):
        engine = fast_engine(twin.activate().variant)
    with stages.stage("reference"):
        samples, enough = (REFERENCE_SAMPLES, 0.0) if tolerance is None else (MAX_REFERENCE_SAMPLES, FLOOR[0])
        enough *= tolerance or 0.0
        whole = converged(scene, samples=samples, enough=enough, metric=metric, depth=REFERENCE_DEPTH)
    with stages.stage("parts"):
        light_of = [
            {
                k: x.mean
                for k, x in light_parts(scene, engine, samples=PART_SAMPLES, seed=s, depth=REFERENCE_DEPTH).items()
            }
            for s in PART_SEEDS
        ]
    survey = _Survey(scene, engine, whole, metric, light_of)
    with stages.stage("methods"):
        for method in (*_table(engine), *(Twin(name, samples=16) for name, rung in RUNGS.items() if rung.lit)):
            survey.measure(method)
        floor = whole.floor(metric)
        choice, reason = (None, "") if tolerance is None else survey.cheapest(tolerance, floor)
    found = Table(
        scene.name, *size, metric, tolerance, choice, reason, survey.rows(), tuple(survey.parts(tolerance)),
        whole.image.samples, floor, time.perf_counter() - began,
    )  # fmt: skip
    return Levels(found, survey.images | {REFERENCE: whole.image})


REFERENCE = "reference: all light"


def _table(engine: str) -> Iterator[Renderer]:
    """The tracer's methods."""
    yield Filled()
    for rung in ("lambert", "shadow"):
        yield Traced(rung, engine)
    for depth in DEPTHS:
        for n in SAMPLES:
            yield walks(engine, depth, n)


def walks(engine: str, depth: int, samples: int) -> PathTraced:
    return PathTraced("sky" if depth == 2 else "path", engine, samples, depth=None if depth == 2 else depth)


class _Survey:
    """What is known of each method so far."""

    def __init__(
        self, scene: Scene, engine: str, whole: Reference, metric: str, light: list[dict[str, np.ndarray]]
    ) -> None:
        self.scene, self.engine, self.whole, self.metric, self.light = scene, engine, whole, metric, light
        self.surfaces = surfaces_met(scene, engine)
        self.known: dict[str, Row] = {}
        self.images: dict[str, Image] = {}

    def measure(self, method: Renderer) -> Row:
        """The method's row: rendered once, and timed up to three times where that is quick."""
        if method.name in self.known:
            return self.known[method.name]
        call, taken = method.prepare(self.scene), []
        image = call(0)
        for seed in range(3):
            start = time.perf_counter()
            call(seed)
            taken.append(time.perf_counter() - start)
            if sum(taken) > 0.1:
                break
        error = self.whole.error(image.mean, self.metric, method.noisy)
        depth = _depth(method)
        side = "twin" if isinstance(method, Twin) else "tracer"
        rung = "none" if isinstance(method, Filled) else method.rung
        if rung != "none":
            self.images[f"{side}: {rung}"] = image  # the last, with the most samples, is shown
        row = Row(
            method.name, side, rung, depth, method.sampling, method.samples if method.noisy else 1, self.rays(method),
            min(taken), error.value, error.most,
        )  # fmt: skip
        self.known[method.name] = row
        return row

    def rays(self, method: Renderer) -> float:
        """The rays that a pixel needs."""
        if isinstance(method, Filled):
            return 0.0
        depth = _depth(method)
        if depth is None:
            return 1 + (self.surfaces[0] if RUNGS[method.rung].shadows else 0.0)
        each = 3 if self.scene.environment else 2
        return method.samples * (1 + each * sum(self.surfaces[: depth - 1]))

    def without(self, *names: str) -> Error:
        """The error of an image that lacks these parts of the light and has all others."""
        one, other = (-sum((half[name] for name in names), np.zeros_like(half["open"])) for half in self.light)
        return unbiased_error(self.metric, one, other, self.whole.image.mean)

    def hopeless(self, method: Renderer, tolerance: float) -> bool:
        """Whether what it leaves out is already more than the tolerance, however many rays it sends."""
        left = [name for name in PARTS if RUNGS[method.rung].lacks(name, _depth(method))]
        return self.without(*left).least > tolerance

    def cheapest(self, tolerance: float, floor: float) -> tuple[Row | None, str]:
        """The first method in order of cost that meets the tolerance, once all cheaper ones are known to fail."""
        if floor > FLOOR[1] * tolerance:
            own = f"the reference's own floor is {floor:.2g} {self.metric}, over a third of it"
            return None, f"cannot tell: {own}. Ask for a tolerance of at least {3 * floor:.2g}"
        queue: list[Renderer] = [m for m in _table(self.engine) if m.samples == 1 or not m.noisy]
        while queue:
            method = queue.pop(min(range(len(queue)), key=lambda i: self.rays(queue[i])))
            row = self.measure(method)
            if row.error_most <= tolerance:
                return row, ""
            if method.noisy and 2 * method.samples <= MAX_SAMPLES and not self.hopeless(method, tolerance):
                queue.append(method.with_samples(2 * method.samples))
        near = min((row for row in self.known.values() if row.side == "tracer"), key=lambda row: row.error)
        return None, f"no method meets it; the nearest is {near.method}, whose {self.metric} is {near.error:.2g}"

    def rows(self) -> tuple[Row, ...]:
        return tuple(sorted(self.known.values(), key=lambda row: row.rays))  # stable: the simpler of a tie first

    def parts(self, tolerance: float | None) -> Iterator[Part]:
        """What the light consists of, and the error without each."""
        mean = float(self.whole.image.mean.mean(dtype=float))
        bounces = PARTS[3:]
        named: dict[str, tuple[str, ...]] = {"shadows of the sun": ("shadow",), "occlusion of the sky": ("occlusion",)}
        named |= {f"bounces beyond {k}" if k else "all bounces": bounces[k:] for k in range(len(bounces))}
        for title, names in named.items():
            error = self.without(*names)
            sent = sum(float(half[name].mean(dtype=float)) for half in self.light for name in names) / 2
            can = None if tolerance is None else error.most <= tolerance
            yield Part(title, error.value, error.most, sent / mean if mean else None, can)


def _depth(method: Renderer) -> int | None:
    own = method.depth if isinstance(method, PathTraced) else None
    return own or RUNGS[method.rung].depth


def surfaces_met(scene: Scene, engine: str) -> tuple[float, ...]:
    """s_1, s_2, ...: the share of all paths that meet a first surface, a second one, ...

    With albedo 1 under an even sky of 1, a path brings 1 once it leaves. So occlusion takes away the paths that meet a
    second surface, and bounce k brings back those that leave after k more.
    """
    white = {"albedo": (1.0, 1.0, 1.0), "specular": msgspec.UNSET, "exponent": msgspec.UNSET}
    furnace = scene.with_(
        objects=[msgspec.structs.replace(thing, **white) for thing in scene.objects], sun=None, sky=Sky((1.0, 1.0, 1.0))
    )
    surface = trace(furnace, "surface", engine).surface
    assert surface is not None  # the tracer always has one
    bounces = max(DEPTHS) - 2
    parts = light_parts(furnace, engine, samples=16, depth=max(DEPTHS) + 1, bounces=bounces)
    met = [float(surface.mask.mean()), -float(parts["occlusion"].mean.mean(dtype=float))]
    for k in range(1, bounces):
        met.append(met[-1] - float(parts[f"bounce {k}"].mean.mean(dtype=float)))
    return tuple(max(share, 0.0) for share in met)
