"""The paper's figures 10 to 12 again, each with the error axis that it left out, and the ratios asked of this tool.

calibration    seconds of a whole calibration over image scale, against the held-out error
intersection   a frame of two spheres by a plain loop, NumPy and Dr.Jit, trimmed and not, against float64 untrimmed
speculation    every n-th pixel traced, the rest interpolated, against the same truth

The paper: "An Image Augmentation Pipeline With Customized Data For AR Education". It ran a Python loop over pixels on
Google Colab: its seconds are another machine's, and only ratios compare.
"""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from raytwin import files, twin
from raytwin.bench.bench_record import Calibrated, LeftOut
from raytwin.bench.bench_reference import rounding
from raytwin.bench.bench_run import check_numbers, machine, number, time_methods
from raytwin.bench.calibration_cost import OURS, SHRUNK_ALONE, WHOLE, Shoot, measure_calibration, photographed
from raytwin.bench.frontier import median_iqr
from raytwin.calib.find_camera import find_camera
from raytwin.compare import METRICS
from raytwin.image import Image
from raytwin.paper.paper_record import PUBLISHED, Boxed, Frame, Paper, Ratio
from raytwin.progress import Progress, silent
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.renderer_table import choose
from raytwin.renderers.subject_renderers import Filled, PythonLoop, Traced
from raytwin.renderers.twin_renderers import Plain
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.speed import TRIMS, trace
from raytwin.workflows.versions import versions

RUNG = "lambert"
"""Diffuse light without shadows, as in the paper."""

SMALL = ("loop-lambert-*", "numpy32-lambert-*", "drjit32-lambert-*")
LARGE = ("fill", "numpy32-lambert-*", "drjit32-lambert-*", "drjit32-shadow-inplace", "mitsuba-llvm-direct-1")
SPECULATION = tuple(f"numpy32-shadow-{way}{n}" for way in ("paper", "careful") for n in (2, 4, 8, 16))
"""Patterns of RENDERERS; shadow's become RUNG's."""

FULL = f"numpy32-{RUNG}-none"
"""Frames that give the seconds and errors to which speculation is compared."""

YARDSTICKS = (Filled, Plain)
"""Kinds of methods that draw something else: they are timed, and have no error against this truth."""

ERRORS = ("rmse", "p999_abs", "max_abs")

SHARES = {"calibration": 0.55, "small": 0.2}
"""Shares of the budget; the large frames get the rest."""


def paper(
    path: str | os.PathLike[str] | None = None,
    *,
    shoot: Shoot = Shoot(),  # noqa: B008 - a frozen record
    budget: float = 1500.0,
    repeats: int = 7,
    progress: Progress = silent,
) -> Paper:
    """Measure all three on the scene at `path` (by default `two_spheres`), in about `budget` seconds.

    Frames have the size of `shoot`'s photos, and the loop's a quarter of their side: 4032 x 3024 and 1008 x 756.
    """
    check_numbers("--budget", (budget,))
    check_numbers("--repeats", (repeats,))
    with photographed(shoot, progress) as folder:
        start = time.perf_counter()
        scene = find_camera(files.read_scene(path), progress=progress)[0] if path else two_spheres(*shoot.size)
        until = start + SHARES["calibration"] * budget
        calibration, left = measure_calibration(folder, shoot.board, deadline=until, repeats=repeats, progress=progress)
    twin.activate()
    width, height = shoot.size
    large = scene.with_camera(scene.camera.resized(width, height))
    small = scene.with_camera(scene.camera.resized(width // 4, height // 4))
    until = time.perf_counter() + SHARES["small"] * budget
    slow = measure_frames(small, lambert(SMALL), until, repeats, progress)
    fast = measure_frames(large, lambert((*LARGE, *SPECULATION)), start + budget, repeats, progress)
    guessed = {m.name for m in lambert(SPECULATION)}
    speculation = [f for f in fast.frames if f.method in guessed]
    intersection = [f for f in (*slow.frames, *fast.frames) if f.method not in guessed]
    boxes = [*slow.boxes, *fast.boxes, *(b for hard in hard_cases() for b in boxed(hard))]
    return Paper(
        scene=scene.name, machine=machine(), versions=versions(), budget=float(budget),
        seconds=time.perf_counter() - start, covered=float(mask_of(fast.truth).mean()), published=PUBLISHED,
        calibration=tuple(calibration), intersection=tuple(intersection), speculation=tuple(speculation),
        boxes=tuple(boxes),
        ratios=tuple(ratios(slow.frames, fast.frames, calibration, float(fast.truth.mean.max()))),
        floor={f"{w}x{h}": f for (w, h), f in ((s.size, s.floor) for s in (slow, fast))},
        left_out=(*left, *slow.left_out, *fast.left_out),
    )  # fmt: skip


def lambert(globs: tuple[str, ...]) -> list[Renderer]:
    """The methods of RENDERERS that `globs` name, drawing into one array, and at RUNG where they are at shadow."""
    chosen = [replace(m, keep=True) if isinstance(m, Filled | Traced) else m for m in choose(globs)]
    return [m if isinstance(m, Plain) else replace(m, rung=RUNG) for m in chosen]


class Frames(NamedTuple):
    """All frames of one size, and the reference of their errors; `floor`: its RMSE as stored."""

    size: tuple[int, int]
    frames: list[Frame]
    truth: Image
    floor: float
    boxes: list[Boxed]
    left_out: list[LeftOut]


def measure_frames(
    scene: Scene, methods: Sequence[Renderer], deadline: float, repeats: int, progress: Progress
) -> Frames:
    """Every method warm and in turn with the others."""
    truth = trace(scene, RUNG, "numpy64", trim="none")

    def look(method: Renderer, image: Image) -> dict[str, dict[str, float | None]]:
        return {} if isinstance(method, YARDSTICKS) else {RUNG: errors(image.mean, truth.mean)}

    size = scene.camera.image_size
    done, left = time_methods(scene, methods, look, deadline, repeats, progress)
    boxes = boxed(scene)
    counts = {b.trim: b for b in boxes}
    frames = []
    for m in done:
        box = counts.get(m.method.trim) if isinstance(m.method, PythonLoop | Traced) else None
        found = m.errors[0].get(RUNG, dict.fromkeys(ERRORS))
        cut, wasted = (box.cut, box.wasted) if box else (None, None)
        named = m.method.name, m.method.family, m.method.label
        frames.append(Frame(*named, *size, *median_iqr(m.seconds), **found, cut=cut, wasted=wasted))
    return Frames(size, frames, truth, number(rounding(truth.mean)["rmse"]), boxes, left)


def mask_of(image: Image) -> np.ndarray:
    """(H, W) bool: where an object is seen. The tracer always tells."""
    if image.surface is None:
        raise ValueError("an image without a surface")
    return image.surface.mask


def errors(image: np.ndarray, truth: np.ndarray) -> dict[str, float | None]:
    return {name: METRICS[name].function(image, truth) for name in ERRORS}


# ------------------------------------------------------------------------------------------ boxes


def boxed(scene: Scene, trims: dict[str, Callable] = TRIMS) -> list[Boxed]:
    """What each kind of box costs: a visible pixel is one whose centre's ray meets the object, alone in the scene."""
    w, h = scene.camera.image_size
    alone = (Scene(scene.name, scene.camera, (thing,)) for thing in scene.objects)
    seen = [mask_of(trace(one, "surface", trim="none")) for one in alone]
    rows = []
    for trim, boxes_of in trims.items():
        start = time.perf_counter()
        boxes = boxes_of(scene.objects, scene.camera).tolist()
        spent = time.perf_counter() - start
        pixels = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes)
        inside = sum(int(s[y0:y1, x0:x1].sum()) for s, (x0, y0, x1, y1) in zip(seen, boxes, strict=True))
        cut = sum(int(s.sum()) for s in seen) - inside
        rows.append(Boxed(scene.name, trim, w, h, pixels, pixels - inside, cut, 1e6 * spent))
    return rows


# ------------------------------------------------------------------------------------------ ratios


def ratios(
    small: Sequence[Frame], large: Sequence[Frame], calibration: Sequence[Calibrated], peak: float
) -> list[Ratio]:
    """What is asked of this tool, as ratios of medians from one run; those whose two sides were measured."""
    slow, fast = ({f.method: f.seconds_median for f in frames} for frames in (small, large))
    error = {f.method: f.p999_abs for f in large}
    rows = {(c.setting, c.scale): c for c in calibration}
    seconds = {k: c.seconds_median for k, c in rows.items()}
    held_out = {k: c.heldout_px for k, c in rows.items()}
    trimmed, full = f"drjit32-{RUNG}-conic", f"drjit32-{RUNG}-none"
    numpy_trimmed, mitsuba, careful = f"numpy32-{RUNG}-conic", "mitsuba-llvm-direct-1", f"numpy32-{RUNG}-careful8"
    whole, ours, quarter = (WHOLE, 1.0), (OURS, 1.0), (SHRUNK_ALONE, 0.25)
    asked: tuple[tuple[str, str, dict[Any, Any], Any, Any], ...] = (
        ("Dr.Jit trimmed frame / one fill", "at most 2", fast, trimmed, "fill"),
        ("Mitsuba direct / Dr.Jit trimmed frame", "at least 25", fast, mitsuba, trimmed),
        ("Mitsuba direct / Dr.Jit full frame", "at least 8", fast, mitsuba, full),
        ("Mitsuba direct / NumPy trimmed frame", "at least 4", fast, mitsuba, numpy_trimmed),
        ("Dr.Jit drawing in place / one fill", "about 0.25", fast, f"drjit32-{RUNG}-inplace", "fill"),
        ("NumPy full frame / careful speculation, n = 8", "at least 3", fast, FULL, careful),
        ("careful speculation's p99.9 error, n = 8 / peak", "under 1e-3", error | {"peak": peak}, careful, "peak"),
        ("Python loop / Dr.Jit full frame, a quarter of the side", "", slow, f"loop-{RUNG}-none", full),
        ("calibration at full size in one thread / raytwin's", "at least 5", seconds, whole, ours),
        ("held-out error of raytwin's calibration / at full size", "at most 1", held_out, ours, whole),
        ("calibration at full size / photos shrunk to a quarter, both in one thread", "", seconds, whole, quarter),
        ("held-out error of photos shrunk to a quarter / at full size", "", held_out, quarter, whole),
    )
    return [
        Ratio(what, goal, float(of[above] / of[below]))
        for what, goal, of, above, below in asked
        if above in of and below in of
    ]


# ------------------------------------------------------------------------------------------ scenes

DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
"""R_cam_board of a camera above the board that looks straight down."""


def two_spheres(width: int = 4032, height: int = 3024) -> Scene:
    """Two spheres that cover about 5 % of a frame of a phone's lens, 0.5 m away."""
    f = 0.7234 * width
    K = ((f, 0.0, 0.5 * width), (0.0, 0.9965 * f, 0.496 * height), (0.0, 0.0, 1.0))
    camera = Camera((width, height), K, DOWN, (0.0, 0.0, 0.5), (0.1, -0.2, 0.001, -0.0005, 0.05))
    red, blue = Lambert((0.8, 0.3, 0.2)), Lambert((0.2, 0.3, 0.8))
    spheres = Sphere((-0.05, 0.02, 0.05), 0.0455, red), Sphere((0.06, -0.03, 0.06), 0.047, blue)
    return Scene("two spheres", camera, spheres, (Sun((0.3, 0.4, 1.0)), Sky((0.1, 0.1, 0.1))))


def hard_cases() -> tuple[Scene, ...]:
    """Where the eight-corner box cuts: a lens that bends a floor's sides, a sphere that reaches behind the camera."""
    strong = Camera(
        (800, 600), ((420.0, 0.0, 404.2), (0.0, 418.0, 297.1), (0.0, 0.0, 1.0)), DOWN, (0.0, 0.0, 0.32),
        (-0.22, 0.045, 0.0012, -0.0008, -0.0035),
    )  # fmt: skip
    floor = Rectangle((0.0, 0.0, 0.0), (0.24, 0.0, 0.0), (0.0, 0.18, 0.0))
    wide = Camera((800, 600), ((280.0, 0.0, 399.5), (0.0, 280.0, 299.5), (0.0, 0.0, 1.0)), DOWN, (0.0, 0.0, 0.5))
    return (
        Scene("a floor that a strong lens bends", strong, (floor,)),
        Scene("a sphere that reaches behind the camera", wide, (Sphere((0.1, 0.0, 0.44), 0.1),)),
    )
