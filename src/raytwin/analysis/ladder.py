"""The ladder of light: every rung on both sides, its error and its seconds, and what each leaves out."""

import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from raytwin import files, twin
from raytwin.analysis.beside_twin import compare_with_twin
from raytwin.analysis.ledger import split_error
from raytwin.analysis.light_parts import WholeLight
from raytwin.calib.find_camera import find_camera
from raytwin.compare.report import Part
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.notebook import InNotebook
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import PathTraced, Traced, fast_engine
from raytwin.renderers.twin_renderers import Twin
from raytwin.rungs import RUNGS
from raytwin.scene import Record, Scene, SceneFile
from raytwin.speed import PARTS, light_parts, walk

WIDTH = 480
"""Pixels across by default: fifteen pictures share a page."""
MORE = 4
"""The reference has this many times the samples of the light levels."""
CALLS = 3
"""Timed calls of each method; their median counts."""


class Step(Record, frozen=True):
    """One rung on one side: `seconds` a frame, and its error against the whole light over the pixels' area.

    `rmse` is None where there is no light; `noise`: the rms standard error of its own samples, None where it has none.
    """

    rung: str
    side: str
    method: str
    seconds: float
    rmse: float | None
    noise: float | None


class Rungs(Record, frozen=True):
    """What ladder.json holds. `floor`: the rms standard error of the whole light, below which no rmse can be told."""

    scene: str
    width: int
    height: int
    samples: int
    depth: int
    floor: float
    steps: tuple[Step, ...]
    ledgers: dict[str, tuple[Part, ...]]
    seconds: float


@dataclass(frozen=True, eq=False)
class Ladder(InNotebook):
    """`images`: title -> (H, W, 3), each rung on both sides, each part of the light alone and all up to it."""

    rungs: Rungs
    images: dict[str, np.ndarray]

    def table(self) -> list[dict[str, Any]]:
        """Return a row per light level and side: what `pandas.DataFrame` takes."""
        return [step.to_dict() for step in self.rungs.steps]

    def to_dict(self) -> dict[str, Any]:
        """Return what ladder.json holds."""
        return self.rungs.to_dict()

    def __repr__(self) -> str:
        return f"<raytwin.ladder of {self.rungs.scene}, {self.rungs.width} x {self.rungs.height}>"


def ladder(
    path: str | Path | Scene | SceneFile,
    *,
    size: tuple[int, int] | None = None,
    samples: int = 64,
    seed: int = 0,
    photo: str | None = None,
    progress: Progress = silent,
) -> Ladder:
    """Render a scene (`path`: its folder, name, or a Scene) at every light level on both sides.

    The result says what each level adds, leaves out and costs.

    `size`: (width, height) in pixels, by default the camera's, at most 480 wide. `samples` per pixel where light is
    followed, 2 or more, drawn from `seed`. `photo`: whose camera pose is used. `table()` of what is returned has a row
    per level and side, `images` the pictures (H, W, 3). Raises InputError for fewer samples.
    """
    if not 2 <= samples <= twin.MOST_SAMPLES:
        raise InputError("--samples", f"a whole number from 2 to {twin.MOST_SAMPLES}", samples)
    began, stages = time.perf_counter(), Stages(progress)
    with stages.stage("backend"):
        engine = fast_engine(twin.activate().variant)
    written = files.read_scene(path)
    scene, _, _, _ = find_camera(written, photo, stages)
    camera = scene.camera
    scene = scene.with_camera(camera.resized(*(size or _small(camera.image_size))))
    deepest = max(row.depth or 0 for row in RUNGS.values())
    with stages.stage("global illumination"):
        whole = walk(scene, "path", engine, samples=MORE * samples, seed=seed + 1, surface=False)
    with stages.stage("ledger"):
        split = WholeLight(scene, engine, deepest)
    images, steps, ledgers = {}, [], {}
    for name, row in RUNGS.items():
        method = PathTraced(name, engine, samples) if row.noisy else Traced(name, engine)
        with stages.stage("tracer"):
            mine, took = _timed(method, scene, seed)
        with stages.stage("twin"):
            theirs, twins = _timed(Twin(name, samples=samples), scene, seed, calls=1)
        for side, made, label, seconds in (
            ("tracer", mine, method.name, took), ("twin", theirs, f"twin-{name}", twins)
        ):  # fmt: skip
            images[f"{side}: {name}"] = made.mean
            steps.append(
                Step(name, side, label, seconds, _rms(made.mean - whole.mean) if row.lit else None, _noise(made))
            )
        if row.lit:
            with stages.stage("ledger"):
                faulty = compare_with_twin(mine, theirs, scene, written.tolerance).verdict == "fail"
                ledgers[name] = split_error(split, mine, name, faulty).parts
    with stages.stage("parts"):
        light = light_parts(scene, engine, samples=samples, seed=seed, depth=deepest)
    total = np.zeros_like(whole.mean)
    for part in PARTS:
        total = total + light[part].mean
        images[f"{TITLES[part]} alone"] = light[part].mean
        if part != PARTS[0]:
            images[f"all light up to {TITLES[part]}"] = total
    images["global illumination"] = whole.mean
    w, h = scene.camera.image_size
    floor = _noise(whole) or 0.0
    spent = time.perf_counter() - began
    return Ladder(Rungs(scene.name, w, h, samples, deepest, floor, tuple(steps), ledgers, spent), images)


TITLES = {
    "open": "sun and open sky", "shadow": "the sun's shadow", "occlusion": "the sky's occlusion",
    "bounce 1": "bounce 1", "bounce 2": "bounce 2", "bounce 3+": "bounces 3 and more",
}  # fmt: skip


def _small(size: tuple[int, int]) -> tuple[int, int]:
    w, h = size
    return (WIDTH, max(1, round(WIDTH * h / w))) if w > WIDTH else size


def _timed(method: Renderer, scene: Scene, seed: int, calls: int = CALLS) -> tuple[Image, float]:
    """The image and the median seconds of some calls, after one that nobody times."""
    call = method.prepare(scene)
    call(seed)
    seconds = []
    for _ in range(calls):
        start = time.perf_counter()
        made = call(seed)
        seconds.append(time.perf_counter() - start)
    return made, median(seconds)


def _rms(picture: np.ndarray) -> float:
    return float(np.sqrt(np.square(picture, dtype=float).mean()))


def _noise(image: Image) -> float | None:
    return None if image.variance is None else float(np.sqrt(image.variance.mean(dtype=float)))
