"""The cheapest way to a scene's image that meets a tolerance, by measurement; and what the scene does not need.

Errors are against the whole light over the pixels' area (`converged`). `search` finds the way, `simplify` says what the
scene can spare, beside what is proven (`bounds`).
"""

import math
import time
from pathlib import Path

from raytwin import files, twin
from raytwin.analysis.recommend.recommendation import Needs, NotNeeded, Row, Whole
from raytwin.analysis.recommend.search import DEEP, Search
from raytwin.analysis.recommend.simplify import not_needed
from raytwin.calib.find_camera import find_camera
from raytwin.errors import InputError, check_one_of
from raytwin.progress import Progress, silent
from raytwin.renderers.subject_renderers import fast_engine
from raytwin.scene import Scene, SceneFile

__all__ = ["Needs", "NotNeeded", "Row", "Whole", "check_asked", "needs", "scene_of"]

ERRORS = "rmse", "relmse", "mae", "max_abs", "p999_abs", "p999_rel"
"""The metrics that are 0 for equal images."""


def needs(
    scene: str | Path | Scene | SceneFile,
    tolerance: float,
    metric: str = "rmse",
    *,
    photo: str | None = None,
    size: tuple[int, int] | None = None,
    engine: str | None = None,
    progress: Progress = silent,
) -> Needs:
    """Find the cheapest way to the scene's image whose error meets `tolerance`, and what the scene does not need.

    The error is in `metric` (rmse, relmse, mae, max_abs, p999_abs or p999_rel), against all light over the pixels'
    area. `photo`: whose camera pose is used. `size`: (width, height) in pixels. `engine`: for the random walks, by
    default the fastest here. `table()` of what is returned has a row per way. Raises InputError for a tolerance that is
    none.
    """
    check_asked(tolerance, metric)
    scene = scene_of(scene, photo, size, progress)
    began = time.perf_counter()
    search = Search(scene, tolerance, metric, engine or fast_engine(twin.activate().variant))
    progress("truth", 0, 1)
    noise = search.low.noise(metric)
    progress("truth", 1, 1)
    progress("candidates", 0, 1)
    choice: Row | None = None
    rejected: tuple[Row, ...] = ()
    if noise > tolerance / 3:
        reason = f"cannot tell: the truth's own noise is {noise:.2g} {metric}, more than a third of {tolerance:g}"
    else:
        choice, rejected, reason = search.choose()
    progress("candidates", 1, 1)
    whole = Whole(DEEP, 2 * search.low.samples, search.pixels, noise, search.bound(search.bounds.beyond(DEEP - 2)))
    found = not_needed(search) if noise <= tolerance / 3 else ()
    seconds = time.perf_counter() - began
    return Needs(scene.name, tolerance, metric, choice, rejected, found, whole, reason, seconds)


def check_asked(tolerance: float, metric: str) -> None:
    check_one_of("--metric", metric, ERRORS)
    if not (math.isfinite(tolerance) and tolerance > 0):
        raise InputError("--tolerance", "a finite number > 0", tolerance)


def scene_of(
    path: str | Path | Scene | SceneFile, photo: str | None, size: tuple[int, int] | None, progress: Progress = silent,
    light: Path | None = None,
) -> Scene:  # fmt: skip
    """Return the scene at `path` with its camera found, of `size` and under the `light` where these are given."""
    written = files.read_scene(path)
    if light is not None:
        from raytwin.calib.lighting.light_file import read_light  # with OpenCV

        written = read_light(light).on(written)
    scene = find_camera(written, photo, progress)[0]
    return scene.with_(size=size) if size else scene
