"""A comparison's folder: report.html, comparison.json, the EXRs of both images and of their difference."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from raytwin.compare import error_map
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.photo_files import to_bytes, write_picture
from raytwin.progress import Progress, silent
from raytwin.scene.toml_json import write_json
from raytwin.show.compare_page import write_report
from raytwin.show.view import view_of
from raytwin.study.diff_files import Diff

if TYPE_CHECKING:
    from raytwin.study.compare_scene import Result


def write_all(result: "Result", folder: Path, json: Path | None = None, progress: Progress = silent) -> None:
    """Write every view of `result` into `folder`; `json` names a second place for comparison.json."""
    header = {**result.settings, **{f"version of {k}": v for k, v in result.versions.items()}}
    alike = result.test.mean.shape == result.reference.mean.shape
    exrs = [
        ("tracer", result.test, {"renderer": "raytwin's tracer"}),
        ("twin", result.reference, {"renderer": "Mitsuba"}),
    ]
    if alike:
        exrs.append(("error", Image(result.test.mean - result.reference.mean), {"content": "tracer - twin"}))
    for path in (folder / "comparison.json", json):
        if path is not None:
            write_json(path, result.numbers())
    jobs: list[Callable[[], None]] = [
        partial(write_exr, folder / f"{n}.exr", image, header | more) for n, image, more in exrs
    ]
    if (augmented := result.augmented) is not None:
        jobs.append(partial(write_picture, folder / "augmented.png", augmented))
    with ThreadPoolExecutor(2) as pool:  # EXRs and PNGs are packed without the interpreter, while the page is drawn
        writing = [pool.submit(job) for job in jobs]
        progress("page", 0, 1)
        write_report(result, folder / "report.html")
        progress("page", 1, 1)
        for done, job in enumerate(writing):
            progress("pictures", done, len(writing))
            job.result()
        progress("pictures", len(writing), len(writing))


def write_diff(found: Diff, folder: Path) -> None:
    """Write report.html, comparison.json and, for images of one size, heatmap.png."""
    view = view_of(found)
    write_json(folder / "comparison.json", found.numbers())
    write_report(view, folder / "report.html")
    if view.alike:
        write_picture(folder / "heatmap.png", to_bytes(error_map(found.test, found.reference)))
