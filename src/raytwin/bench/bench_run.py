"""Scenes, methods and sizes in; a Bench per scene out, within a budget of seconds."""

import math
import os
import platform
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from math import gcd, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from raytwin import files, twin
from raytwin.bench.bench_record import Bench, Converged, Deviation, LeftOut, Measurement
from raytwin.bench.bench_reference import WHOLE, converge, judge, measure, truth_of, twin_of
from raytwin.bench.frontier import median_iqr, on_frontier
from raytwin.bench.timing import Clock, Errors, Look, Measured, guess, repeat, warm
from raytwin.calib.find_camera import find_camera
from raytwin.compare import Comparison
from raytwin.contract.subject import method as as_method
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.progress import Progress, silent
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.renderer_table import RENDERERS, choose
from raytwin.scene import Camera, Scene, SceneFile, Tolerance
from raytwin.workflows.versions import versions

PREPARE_SHARE, TRUTH_SHARE = 0.6, 0.3
"""Shares of a size's time: references take at most TRUTH_SHARE; preparing stops after PREPARE_SHARE of the rest."""

OUT_OF_TIME = "no time"
"""How the reason begins where a larger budget would help."""
Parts = dict[str, list[Any]]
"""What a run has measured so far, by Bench's fields."""
CALLS = 4
"""Calls of a method that must fit what is left of the time: one to warm up, three to time."""


def bench(
    path: str | Path | Scene | SceneFile,
    *,
    methods: Sequence[str | Renderer | Callable[..., Any]] = ("*",),
    sizes: Sequence[float] = (0.2,),
    budget: float = 300.0,
    repeats: int = 15,
    truth_samples: int = 4096,
    progress: Progress = silent,
) -> Bench:
    """Measure each method's time and error on a scene (`path`: its folder, name, or a Scene), at each of `sizes`
    (megapixels), and judge its picture beside the twin's.

    `methods`: patterns of names (`raytwin bench list`), and renderers of your own, which come first: functions of a
    scene, and what `method` returns. `budget`: seconds for all, preparing and truths too; methods that do not fit are
    named in `left_out`, and InputError says so if none does. `repeats`: most timed calls of each. `truth_samples`: most
    samples a pixel of each truth. `table()` of what is returned has a row per method and size: seconds, errors,
    verdict, and whether it is on the frontier. `progress(stage, done, total)` is called as work goes on.
    """
    (found,) = bench_scenes(
        (path,), methods=methods, sizes=sizes, budget=budget, repeats=repeats, truth_samples=truth_samples,
        progress=progress,
    )  # fmt: skip
    return found


def bench_scenes(
    paths: Sequence[str | Path | Scene | SceneFile],
    *,
    methods: Sequence[str | Renderer | Callable[..., Any]] = ("*",),
    sizes: Sequence[float] = (0.2,),
    budget: float = 300.0,
    repeats: int = 15,
    truth_samples: int = 4096,
    progress: Progress = silent,
) -> tuple[Bench, ...]:
    """Measure on each scene, in turn: see `bench`. `budget`: seconds for all scenes, each of which has an equal share.

    Raises InputError for a scene or a method that cannot be, before anything is measured.
    """
    for where, numbers, most in (
        ("--budget", (budget,), math.inf), ("--sizes", sizes or (0,), 1000),
        ("--repeats", (repeats,), math.inf), ("--truth-samples", (truth_samples,), math.inf),
    ):  # fmt: skip
        check_numbers(where, numbers, most)
    chosen, subjects = chosen_methods(methods)
    scenes = [files.read_scene(path) for path in paths]
    check_names("SCENE", [scene.name for scene in scenes])
    start = time.perf_counter()
    twin.activate()
    made = []
    for number, written in enumerate(scenes):
        began = time.perf_counter()
        deadline = portion(start + budget, len(scenes) - number)
        scene = find_camera(written, progress=progress)[0]
        found: Parts = defaultdict(list)
        for i, megapixels in enumerate(sizes):
            measure_size(
                found, scene.with_camera(sized(scene.camera, megapixels)), written.tolerance, chosen, subjects,
                portion(deadline, len(sizes) - i), repeats, truth_samples, progress,
            )  # fmt: skip
        made.append(
            Bench(
                scene=scene.name, machine=machine(), versions=versions(), budget=float(deadline - began),
                seconds=time.perf_counter() - began, subjects=subjects,
                **{name: tuple(part) for name, part in found.items()},
            )
        )  # fmt: skip
    if not any(one.rows for one in made):
        raise _nothing([o for one in made for o in one.left_out], subjects, budget, time.perf_counter() - start)
    return tuple(made)


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
    listed = choose(globs) if globs or not own else []
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


def portion(until: float, parts: int) -> float:
    """Return the end of the first of `parts` equal parts of the time from now until then."""
    now = time.perf_counter()
    return now + (until - now) / parts


def _nothing(left: Sequence[LeftOut], subjects: Collection[str], budget: float, spent: float) -> InputError:
    """Why nothing was measured, and what to give."""
    late = {o.method for o in left if o.why.startswith(OUT_OF_TIME)}
    if not late:
        want = "one that this scene and this machine can have"
        where = "--subject" if left[0].method in subjects else "--methods"
        return InputError(where, want, f"{left[0].method}: {left[0].why}")
    want = f"more seconds, or fewer --methods: none of {len(late)} could be prepared and timed"
    return InputError("--budget", want, f"{budget:g}; preparing and truths took {spent:.2g} s")


def measure_size(
    found: Parts, scene: Scene, tolerance: Tolerance, methods: Sequence[Renderer], subjects: Collection[str],
    deadline: float, repeats: int, truth_samples: int, progress: Progress,
) -> None:  # fmt: skip
    """Measure references and methods at one size of picture."""
    size = scene.camera.image_size
    images, truths, twins = {}, {}, {}
    own_truths = {truth_of(m) for m in methods}
    names = sorted(own_truths | {WHOLE})
    until = time.perf_counter() + TRUTH_SHARE * (deadline - time.perf_counter())
    for i, name in enumerate(names):
        progress("truths", i, len(names))
        seconds = (until - time.perf_counter()) / (len(names) - i)
        truth, truths[name] = converge(scene, name, truth_samples, seconds)
        images[name] = truth.mean
        if name in own_truths:
            twins[name] = twin_of(scene, name, truth)
    progress("truths", len(names), len(names))
    verdicts: dict[str, Comparison] = {}

    def look(method: Renderer, image: Image) -> Errors:
        own = truth_of(method)
        if method.name not in verdicts:
            verdicts[method.name] = judge(method, image, twins[own], scene, tolerance)
        return {name: measure(image.mean, images[name]) for name in names if name == own or comparable(name)}

    done, left = time_methods(scene, methods, look, deadline, repeats, progress, first=subjects)
    truths = {name: truth for name, truth in truths.items() if any(name in m.errors[0] for m in done)}
    rows, errors = summarize(done, truths, verdicts, size)
    found["rows"] += rows
    found["errors"] += errors
    found["truths"] += truths.values()
    found["left_out"] += left


def comparable(truth: str) -> bool:
    """Return whether every method may be compared with this reference: those over the whole pixel."""
    return truth.endswith("-area")


def time_methods(
    scene: Scene,
    methods: Sequence[Renderer],
    look: Look,
    deadline: float,
    repeats: int,
    progress: Progress,
    clock: Clock = time.perf_counter,
    first: Collection[str] = (),
) -> tuple[list[Measured], list[LeftOut]]:
    """Prepare each method and call it once, then time them in turn; return those timed, and why the others are not.

    Those named in `first` come first. One of each family comes before the second of any, those of few samples first, so
    that time that is too short leaves some of every kind. Two thumbnails tell what a call will take; none is prepared
    whose calls do not fit.
    """
    size, start = scene.camera.image_size, clock()
    until = start + PREPARE_SHARE * (deadline - start)
    cheapest_first = sorted(methods, key=lambda m: m.samples)
    families = [m.family for m in cheapest_first]
    in_turn = sorted(
        cheapest_first, key=lambda m: (m.name not in first, families[: cheapest_first.index(m)].count(m.family))
    )
    ready: list[Measured] = []
    reasons: dict[str, str] = {}
    absent: dict[str, str] = {}
    owed = 0.0
    for i, method in enumerate(in_turn):
        progress("prepare", i, len(methods))
        if method.library in absent:
            reasons[method.name] = absent[method.library]
            continue
        if i > 0 and clock() > until:
            reasons[method.name] = f"{OUT_OF_TIME} to prepare it"
            continue
        try:
            expected, compiling = expected_seconds(method, scene, clock)
            if clock() + owed + CALLS * expected > deadline:
                reasons[method.name] = f"{OUT_OF_TIME}: a call would take about {expected:.2g} s"
                continue
            one = Measured(method, method.prepare(scene), expected, compiling)
            warm(one, look, clock)
        except InputError as error:
            reasons[method.name] = str(error)
            if "cuda" in method.library:
                absent[method.library] = str(error)  # each try would start a child process
            continue
        ready.append(one)
        owed += (CALLS - 1) * one.guess
    progress("prepare", len(methods), len(methods))
    known = {m.method.family for m in ready}
    late = {m.family for m in methods if m.family not in known and reasons[m.name].startswith(OUT_OF_TIME)}
    if ready and late:
        warnings.warn(f"--budget leaves out {', '.join(sorted(late))}", stacklevel=2)
    repeat(ready, look, deadline, repeats, clock)
    reasons |= {m.method.name: f"{OUT_OF_TIME} left for a timed call" for m in ready if not m.seconds}
    left = [LeftOut(m.name, *size, reasons[m.name]) for m in methods if m.name in reasons]
    return sorted((m for m in ready if m.seconds), key=lambda m: methods.index(m.method)), left


def expected_seconds(method: Renderer, scene: Scene, clock: Clock) -> tuple[float, float]:
    """Return the seconds that a call will take, on the line through two thumbnails, and those of compiling."""
    (small, large), found = (thumbnail(scene, side) for side in (24, 48)), []
    for view in (small, large):
        call = method.prepare(view)
        cold, warm_one = timed(call, clock), timed(call, clock)
        found.append((area(view), warm_one, cold))
    seconds = guess(found[0][:2], found[1][:2], area(scene))
    return seconds, max(0.0, found[0][2] - found[0][1])


def summarize(
    done: list[Measured], truths: dict[str, Converged], verdicts: dict[str, Comparison], size: tuple[int, int]
) -> tuple[list[Measurement], list[Deviation]]:
    """Rows against each method's own truth, and the errors against every truth, each with its frontier."""
    times = {m.method.name: median_iqr(m.seconds) for m in done}
    errors: dict[tuple[str, str], Deviation] = {}
    for name, truth in truths.items():
        compared = [m for m in done if name in m.errors[0]]
        means = [{k: mean_of([e[name][k] for e in m.errors]) for k in m.errors[0][name]} for m in compared]
        seconds = [times[m.method.name][0] for m in compared]
        flags = on_frontier(seconds, [number(mean["rmse"]) for mean in means], number(truth.floor["rmse"]))
        for m, mean, flag in zip(compared, means, flags, strict=True):
            rmse, relmse, p999_abs = (number(mean[key]) for key in ("rmse", "relmse", "p999_abs"))
            errors[m.method.name, name] = Deviation(
                m.method.name, *size, name, rmse, relmse, p999_abs, on_frontier=flag
            )
    rows = []
    for m in done:
        own = truth_of(method := m.method)
        e, judged = errors[method.name, own], verdicts[method.name]
        rows.append(
            Measurement(
                method.name, method.library, f"float{method.precision}", method.rung, method.trim, method.step,
                method.samples, *size, *times[method.name], m.compile_seconds, m.peak_mib, e.rmse, e.relmse, e.p999_abs,
                number(truths[own].floor["rmse"]), e.on_frontier, judged.verdict, judged.reasons[0],
            )
        )  # fmt: skip
    return rows, list(errors.values())


def mean_of(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def number(value: float | None) -> float:
    """An error that every image has."""
    if value is None:
        raise ValueError("an error that was not measured")
    return value


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


def thumbnail(scene: Scene, height: int) -> Scene:
    return scene.with_camera(sized(scene.camera, scene.camera.width / scene.camera.height * height**2 / 1e6))


def area(scene: Scene) -> int:
    return scene.camera.width * scene.camera.height


def timed(call: Call, clock: Clock) -> float:
    start = clock()
    call(0)
    return clock() - start


def machine() -> dict[str, str]:
    """What seconds depend on."""
    rows = dict(twin.doctor())
    return {
        "processor": rows.get("processor", "?"),
        "cores": rows.get("cores", str(os.cpu_count())),
        "backend": rows.get("backend", "?").split(",")[0],
        "system": f"{platform.system()} {platform.machine()}",
    }
