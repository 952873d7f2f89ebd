"""Every method's seconds beside its error, on scenes and at sizes, within a budget of seconds.

RENDERERS -> references -> first calls -> rounds in random order -> Measurement -> frontier -> report
"""

import gc
import math
import os
import platform
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from math import gcd, sqrt
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import twin
from raytwin.compare import METRICS, Comparison, Verdict
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.notebook import InNotebook
from raytwin.photos.find_camera import find_camera
from raytwin.progress import Progress, silent
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.renderer_table import RENDERERS, renderers_of
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Scene, Tolerance
from raytwin.scene.record_base import Row
from raytwin.scene.scene_files import scene_and_photos
from raytwin.scene.toml_json import write_json
from raytwin.study.compare_scene import compare_with_twin
from raytwin.study.converged import Reference, converged
from raytwin.teach.contract.subject import method as as_method

ERRORS = ("rmse", "relmse", "p999_abs")
"""The metrics that a row carries: rows of compare.METRICS."""
ALL_LIGHT = "path-area"
"""The reference with all light, which every method is compared with, whatever part of it the method computes."""
REFERENCE_SHARE, PREPARE_SHARE = 0.3, 0.47
"""Shares of a size's time: all references take the first, and no method is prepared after the second. A warm call takes
no longer than the first one did, so that three rounds of timed calls fit into the rest."""
OUT_OF_TIME = "no time"
"""How the reason begins where a larger budget would help."""

clock = time.perf_counter
OnImage = Callable[["_Run", Image], None]
Picture = Callable[[str, Image], None]
"""Takes the name and the first image of a method, or of a reference."""


class Measurement(Row, frozen=True):
    """Seconds and error of one method at one size, against the converged reference `truth` ("shadow-center").

    `seconds_median`, `seconds_iqr` of the warm calls; `compile_seconds`: what only the first call cost. `rmse`,
    `relmse` and `p999_abs` are means over the images of independent seeds, `rmse_sigma` is the standard error of the
    mean of `rmse` (None: one image). `truth_floor`: the reference's own RMSE, below which `rmse` tells nothing.
    `on_frontier`: among the methods measured against the same reference. `verdict` of the first image beside the twin
    at the method's own light level; `reason`: its first reason, in words.
    """

    method: str
    engine: str
    precision: str
    rung: str
    trim: str | None
    speculation: int
    samples: int
    width: int
    height: int
    seconds_median: float
    seconds_iqr: float
    compile_seconds: float
    truth: str
    rmse: float
    rmse_sigma: float | None
    relmse: float
    p999_abs: float
    truth_floor: float
    on_frontier: bool
    verdict: Verdict
    reason: str


class Bench(Row, InNotebook, frozen=True):
    """A whole run at `sizes` (width, height).

    `rows`: each method against its own light level; `errors`: against the highest one.
    `left_out`: the methods that were not measured at some size -> why. `subjects`: the names of the methods that were
    given themselves, not by a pattern.
    """

    scene: str
    machine: dict[str, str]
    versions: dict[str, str]
    budget: float
    seconds: float
    sizes: tuple[tuple[int, int], ...]
    rows: tuple[Measurement, ...]
    errors: tuple[Measurement, ...]
    left_out: dict[str, str]
    subjects: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """1 if a subject fails, else 2 if one is undecided or was not measured, else 0: nothing else decides."""
        verdicts = [row.verdict for row in self.rows if row.method in self.subjects]
        if "fail" in verdicts:
            return 1
        measured = {row.method for row in self.rows}
        return 2 if "undecided" in verdicts or not measured.issuperset(self.subjects) else 0

    def table(self) -> list[dict[str, Any]]:
        """Return a row per method and size: what `pandas.DataFrame` takes."""
        return [row.to_dict() for row in self.rows]

    def __repr__(self) -> str:
        return f"<raytwin.bench of {self.scene}: {len(self.rows)} measurements, {len(self.left_out)} left out>"


def write_bench(benches: Sequence[Bench], path: str | os.PathLike[str]) -> None:
    """As JSON: one scene's result, or a list of several; NaN and infinity, which JSON lacks, become null."""
    write_json(path, benches[0] if len(benches) == 1 else list(benches))


def no_picture(name: str, image: Image) -> None:
    """Images are not kept."""


def bench(
    path: str | Path | Scene,
    *,
    methods: Sequence[str | Renderer | Callable[..., Any]] = ("*",),
    sizes: Sequence[float] = (0.2,),
    budget: float = 300.0,
    repeats: int = 15,
    truth_samples: int = 4096,
    progress: Progress = silent,
    picture: Picture = no_picture,
) -> Bench:
    """Measure each method's time and error on a scene (`path`: its folder, name, or a Scene), at each of `sizes`
    (megapixels), and judge its picture beside the twin's.

    `methods`: patterns of names (`raytwin bench list`), and renderers of your own, which come first: functions of a
    scene, and what `method` returns. `budget`: seconds for all, preparing and references too; methods that do not fit
    are named in `left_out`, and InputError says so if none does. `repeats`: most timed calls of each. `truth_samples`:
    most samples per pixel of each reference. `table()` of what is returned has a row per method and size: seconds,
    errors, verdict, and whether it is on the frontier. `progress(stage, done, total)` is called as work goes on,
    `picture(name, image)` with the images at the first size.
    """
    check_numbers("--sizes", sizes or (0,), most=1000)
    for where, number in (("--budget", budget), ("repeats", repeats), ("truth_samples", truth_samples)):
        check_numbers(where, (number,))
    chosen, subjects = chosen_methods(methods)
    twin.activate()
    start = clock()
    scene = find_camera(path, progress=progress)[0]
    rows: list[Measurement] = []
    errors: list[Measurement] = []
    left: dict[str, str] = {}
    cameras = [sized(scene.camera, megapixels) for megapixels in sizes]
    for i, camera in enumerate(cameras):
        own, whole, missing = measure_size(
            scene.with_camera(camera), scene.tolerance, chosen, subjects, start + budget * (i + 1) / len(sizes),
            repeats, truth_samples, progress, no_picture if i else picture,
        )  # fmt: skip
        rows, errors, left = rows + own, errors + whole, missing | left
    if not rows:
        raise _nothing(left, subjects, budget, clock() - start)
    return Bench(
        scene=scene.name, machine=machine(), versions=twin.versions(), budget=budget, seconds=clock() - start,
        sizes=tuple(camera.image_size for camera in cameras), rows=tuple(rows), errors=tuple(errors), left_out=left,
        subjects=subjects,
    )  # fmt: skip


def bench_scenes(
    paths: Sequence[str | Path | Scene],
    *,
    methods: Sequence[str | Renderer | Callable[..., Any]] = ("*",),
    budget: float = 300.0,
    picture: Picture = no_picture,
    **options: Any,
) -> tuple[Bench, ...]:
    """Measure on each scene, in turn: see `bench`. `budget`: seconds for all scenes, each of which has an equal share;
    `picture`: of the first.

    Raises InputError for a scene or a method that cannot be, before anything is measured.
    """
    chosen_methods(methods)
    check_names("SCENE", [scene_and_photos(path)[0].name for path in paths])
    pictures = picture, *[no_picture] * len(paths)
    share = budget / max(len(paths), 1)
    return tuple(
        bench(path, methods=methods, budget=share, picture=of_scene, **options)
        for path, of_scene in zip(paths, pictures, strict=False)
    )


def chosen_methods(
    methods: Sequence[str | Renderer | Callable[..., Any]],
) -> tuple[list[Renderer], tuple[str, ...]]:
    """Return the methods, those that are given themselves first, and the names of these, which no pattern repeats.

    A method of the table is timed as it is there, and does not also say what each ray met.
    """
    given = [m if isinstance(m, Renderer) else as_method(m) for m in methods if not isinstance(m, str)]
    own = [RENDERERS.get(m.name, m) for m in given]
    names = tuple(m.name for m in own)
    check_names("--subject", names)
    globs = [m for m in methods if isinstance(m, str)]
    listed = renderers_of(globs) if globs or not own else []
    return [*own, *(m for m in listed if m.name not in names)], names


def check_names(where: str, names: Sequence[str]) -> None:
    """Raise InputError for a name that stands twice."""
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(where, "each once, under a name of its own", f"{twice} twice")


def check_numbers(where: str, numbers: Sequence[float], most: float = math.inf) -> None:
    """Raise InputError for a number that is not above 0, or above `most`."""
    if not all(number > 0 for number in numbers):
        raise InputError(where, "numbers above 0", ", ".join(f"{number:g}" for number in numbers))
    if max(numbers, default=1) > most:
        raise InputError(where, f"at most {most}", f"{max(numbers):g}")


def _nothing(left: dict[str, str], subjects: Collection[str], budget: float, spent: float) -> InputError:
    """Why nothing was measured, and what to give."""
    if late := [name for name, why in left.items() if why.startswith(OUT_OF_TIME)]:
        want = f"more seconds, or fewer --methods: none of {len(late)} could be prepared and timed"
        return InputError("--budget", want, f"{budget:.3g}; preparing and references took {spent:.2g} s")
    name, why = next(iter(left.items()))
    where = "--subject" if name in subjects else "--methods"
    return InputError(where, "one that this scene and this machine can have", f"{name}: {why}")


# ------------------------------------------------------------------------------------------ one size


@dataclass(eq=False)
class _Run:
    """A method while it is measured: `first`, `seconds` of its first call and of the timed ones; `turn`: of its latest
    call and what was done with the image; `errors`: reference -> ERRORS of each image; `failed`: what went wrong."""

    method: Renderer
    call: Call
    first: float = 0.0
    turn: float = 0.0
    seconds: list[float] = field(default_factory=list)
    errors: dict[str, list[list[float]]] = field(default_factory=dict)
    judged: Comparison | None = None
    failed: str = ""


def reference_of(method: Renderer) -> str:
    """The name of the reference at the method's own light level."""
    return f"{method.rung}-{method.sampling}"


def measure_size(
    scene: Scene, tolerance: Tolerance, methods: Sequence[Renderer], subjects: Collection[str], deadline: float,
    repeats: int, truth_samples: int, progress: Progress, picture: Picture,
) -> tuple[list[Measurement], list[Measurement], dict[str, str]]:  # fmt: skip
    """Measure all methods at one size: rows against their own references and the one with all light, and why not."""
    references: dict[str, Reference] = {}
    twins: dict[str, Image] = {}
    names = sorted({reference_of(m) for m in methods} | {ALL_LIGHT})
    start, given = clock(), deadline - clock()
    for i, name in enumerate(names):
        progress("references", i, len(names))
        rung, sampling = name.split("-")
        seconds = REFERENCE_SHARE * given / len(names)
        known = converged(scene, rung, sampling, samples=truth_samples, seconds=seconds, clock=clock)
        references[name] = known
        picture(f"reference {name}", known.image)
        twins[name] = known.image if RUNGS[rung].noisy else twin.render(scene, rung, sampling=sampling)
    progress("references", len(names), len(names))

    def record_image(run: _Run, image: Image) -> None:
        own = reference_of(run.method)
        for name in dict.fromkeys((own, ALL_LIGHT)):
            found = [METRICS[metric].function(image.mean, references[name].image.mean) for metric in ERRORS]
            run.errors.setdefault(name, []).append([math.nan if value is None else value for value in found])
        if run.judged is None:
            picture(run.method.name, image)
            if run.method.noisy and image.variance is None:
                image = replace(image, batches=1)  # or one sample would count as free of noise
            run.judged = compare_with_twin(image, twins[own], scene, tolerance)

    runs, left = first_calls(scene, methods, subjects, record_image, start + PREPARE_SHARE * given, progress)
    rounds(runs, record_image, deadline, repeats)
    for run in runs:
        if run.failed or not run.seconds:
            left[run.method.name] = run.failed or f"{OUT_OF_TIME} left for a timed call"
    runs = [run for method in methods for run in runs if run.method is method and method.name not in left]
    size = scene.camera.image_size
    rows = []
    for name in names:
        rows += measurements([r for r in runs if reference_of(r.method) == name], name, references[name].noise, size)
    return rows, measurements(runs, ALL_LIGHT, references[ALL_LIGHT].noise, size), left


def first_calls(
    scene: Scene,
    methods: Sequence[Renderer],
    first: Collection[str],
    on_image: OnImage,
    until: float,
    progress: Progress,
) -> tuple[list[_Run], dict[str, str]]:
    """Prepare each method and call it once, as long as there is time; return these, and why the others are not there.

    Those named in `first` begin. Then few samples come before many, so that a short time leaves some of every kind.
    The family's latest one tells what the next will take.
    """
    runs: list[_Run] = []
    left: dict[str, str] = {}
    absent: dict[str, str] = {}
    latest: dict[str, tuple[int, float]] = {}
    for i, method in enumerate(sorted(methods, key=lambda m: (m.name not in first, m.samples))):
        progress("prepare", i, len(methods))
        if method.library in absent:
            left[method.name] = absent[method.library]
            continue
        samples, taken = latest.get(method.family, (1, 0.0))
        expected = taken * method.samples / samples
        begun = clock()
        if begun + expected > until:
            about = f": a call would take about {expected:.2g} s" if expected else " to prepare it"
            left[method.name] = OUT_OF_TIME + about
            continue
        try:
            run = _Run(method, method.prepare(scene))
            image = run.call(0)
            run.first = clock() - begun
            on_image(run, image)
        except InputError as error:
            left[method.name] = str(error)
            if "cuda" in method.library:
                absent[method.library] = str(error)  # each try would start a child process
            continue
        run.turn = clock() - begun
        latest[method.family] = method.samples, run.turn
        runs.append(run)
    progress("prepare", len(methods), len(methods))
    return runs, left


def rounds(runs: Sequence[_Run], on_image: OnImage, deadline: float, repeats: int) -> None:
    """Call each method `repeats` times, all in a new random order each round, so that a drifting machine affects all.

    No call begins that would end past the deadline. A noisy method is called with another seed each time, and the
    error of each image counts: their scatter is the error's (Celarek et al., Quantifying the error of light transport
    algorithms, EGSR 2019).
    """
    rng = np.random.default_rng(0)
    for number in range(1, repeats + 1):
        for i in rng.permutation(len(runs)):
            run, begun = runs[i], clock()
            if run.failed or begun + run.turn > deadline:
                continue
            gc.disable()
            try:
                image = run.call(number)
            except InputError as error:  # of one seed alone
                run.failed = str(error)
                continue
            finally:
                gc.enable()
            run.seconds.append(clock() - begun)
            if run.method.noisy:
                on_image(run, image)
            run.turn = clock() - begun


def measurements(runs: Sequence[_Run], name: str, floor: float, size: tuple[int, int]) -> list[Measurement]:
    """A row per run, its errors against the reference `name`."""
    rows = []
    for run in runs:
        m, judged, errors = run.method, run.judged, np.array(run.errors[name])
        assert judged is not None
        low, median, high = np.quantile(run.seconds, (0.25, 0.5, 0.75)).tolist()
        sigma = float(errors[:, 0].std(ddof=1) / sqrt(len(errors))) if len(errors) > 1 else None
        rmse, relmse, p999_abs = errors.mean(axis=0).tolist()
        rows.append(
            Measurement(
                m.name, m.library, f"float{m.precision}", m.rung, m.trim, m.step, m.samples, *size, median,
                high - low, max(0.0, run.first - median), name, rmse, sigma, relmse, p999_abs, floor, False,
                judged.verdict, judged.reasons[0],
            )
        )  # fmt: skip
    flags = on_frontier([row.seconds_median for row in rows], [row.rmse for row in rows], floor)
    return [msgspec.structs.replace(row, on_frontier=flag) for row, flag in zip(rows, flags, strict=True)]


# ------------------------------------------------------------------------------------------ frontier

NEAR_TIME, NEAR_ERROR = 1.1, 1.05
"""Times within this ratio, or errors, are a tie: another run might turn them round."""


def on_frontier(seconds: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> list[bool]:
    """Which methods no other clearly beats: none is as accurate and clearly faster, or as fast and clearly better.

    Errors below `floor` count as `floor`: the truth cannot tell them apart. Ties share the frontier, so that noise of a
    few per cent does not push a method off it.
    """
    t, e = np.asarray(seconds, float), np.maximum(np.asarray(errors, float), floor)
    e = np.where(np.isfinite(e), e, np.inf)
    faster = (t[None] * NEAR_TIME < t[:, None]) & (e[None] <= e[:, None] * NEAR_ERROR)
    better = (e[None] * NEAR_ERROR < e[:, None]) & (t[None] <= t[:, None] * NEAR_TIME)
    return [bool(b) for b in ~(faster | better).any(axis=1) & np.isfinite(e)]


def staircase(seconds: Sequence[float], errors: Sequence[float], floor: float = 0.0) -> list[int]:
    """Indices of the methods that no other beats at all, from the fastest to the most accurate: the line to draw."""
    found, best = [], np.inf
    for i in sorted(range(len(seconds)), key=lambda i: (seconds[i], errors[i])):
        if max(errors[i], floor) < best:
            best = max(errors[i], floor)
            found.append(i)
    return found


# ------------------------------------------------------------------------------------------ sizes, machine


def sized(camera: Camera, megapixels: float) -> Camera:
    """The camera with about so many pixels, at its own aspect exactly where whole numbers allow it."""
    w, h = camera.image_size
    unit = gcd(w, h)
    if (w // unit) * (h // unit) <= min(1e4, megapixels * 1e6 / 25):  # 4:3 and its like: steps of 4 x 3 pixels
        steps = max(1, round(sqrt(megapixels * 1e6 / ((w // unit) * (h // unit)))))
        return camera.resized(w // unit * steps, h // unit * steps)
    scale = sqrt(megapixels * 1e6 / (w * h))
    return camera.resized(max(1, round(w * scale)), max(1, round(h * scale)))


def machine() -> dict[str, str]:
    """What seconds depend on."""
    rows = dict(twin.doctor())
    return {
        "processor": rows.get("processor", "?"),
        "cores": rows.get("cores", str(os.cpu_count())),
        "backend": rows.get("backend", "?").split(",")[0],
        "system": f"{platform.system()} {platform.machine()}",
    }
