"""report.html: one file that opens offline; pictures side by side, numbers, calibration, times beside errors."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from importlib import resources
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np

from raytwin import files
from raytwin.compare.heatmap import signed_error
from raytwin.image import Image, Surface
from raytwin.report import numbers, pictures
from raytwin.report.figures import Picture, embed, script_of_bokeh
from raytwin.report.values import Values, pack_values
from raytwin.report.view import PairView, showable, view_of
from raytwin.scene import Tolerance

if TYPE_CHECKING:
    from raytwin.jobs.compare import Result

LISTED = 8
"""Worst pixels in the table."""


def write_report(shown: "PairView | Result", path: str | os.PathLike[str]) -> None:
    """The whole report as one HTML file without references to any other; some megabytes, mostly pictures."""
    view = shown if isinstance(shown, PairView) else view_of(shown)
    page = template().render(
        r=view,
        c=view.comparison,
        css=asset("report.css"),
        noisy=view.noisy,
        colours=pictures,
        groups=list(numbers.rows(view.comparison, view.tolerance, view.noisy, view.names.the_reference)),
        calibrated=calibrated(view),
        **(side_by_side(view) if view.alike else {"alone": alone(view)}),
    )
    files.write_text(path, page)


def side_by_side(view: PairView) -> dict[str, Any]:
    """Linked pictures, the inspector's values, the worst pixels."""
    error = signed_error(view.test, view.reference, "absolute")
    held = view.tolerance or Tolerance()
    scale = pictures.choose_scale(view.test, view.reference, error, held.p999_abs)
    with ThreadPoolExecutor() as pool:
        packing = pool.submit(pack_values, view.test, view.reference, surfaces=view.surfaces is not None)
        worst = pictures.worst_pixels(error, LISTED)
        apart = mismatches(view)
        panels = draw(view, error, scale, worst, apart, pool)
        values = packing.result()
    height, width = error.shape
    script, elements, toolbar = embed(panels, width, height)
    return {
        "width": width, "height": height, "panels": list(zip(panels, elements, strict=True)), "toolbar": toolbar,
        "bokeh": script_of_bokeh(), "script": script, "js": asset("report.js"), "meta": meta(view, values),
        "thin": values.thin, "packed": {plane.name: plane.data for plane in values.planes},
        "bar": colour_bar(scale, allowed(view)), "worst": pixel_rows(view, worst, apart), "apart": len(apart),
    }  # fmt: skip


def alone(view: PairView) -> list[Picture]:
    """Each picture for itself, where the two cannot lie side by side; none of what is no picture at all."""
    found = []
    for key, title, image in (
        ("test", view.names.test_title, view.test),
        ("reference", view.names.reference_title, view.reference),
    ):
        if showable(image):
            url, lossless = pictures.picture_url(pictures.exposed(image, pictures.exposure(image)))
            size = "{1} × {0} pixels".format(*image.shape)
            found.append(Picture(key, title, f"{title}, {size}", size + _lossy(lossless), url))
    return found


def allowed(view: PairView) -> float | None:
    """The error that a single value may have, where that is what decides."""
    return None if view.noisy or view.tolerance is None else view.tolerance.p999_abs


def template() -> jinja2.Template:
    return environment().from_string(asset("report.html.j2"))


def environment() -> jinja2.Environment:
    """Jinja as every page uses it: text is escaped, a name that is missing is an error."""
    made = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined)
    made.filters |= {f.__name__: f for f in (numbers.shown, numbers.beside, numbers.short, numbers.seconds)}
    return made


def asset(name: str) -> str:
    return resources.files("raytwin.report").joinpath(name).read_text(encoding="utf-8")


# ------------------------------------------------------------------------------------------ pictures


def draw(
    view: PairView,
    error: np.ndarray,
    scale: pictures.Scale,
    worst: list[tuple[int, int]],
    apart: list[tuple[int, int]],
    pool: ThreadPoolExecutor,
) -> list[Picture]:
    """The panels in reading order; what the images lack is left out."""
    names = view.names
    gain = pictures.exposure(view.reference)
    stops = math.log2(gain)
    note = f"exposure {'+' if stops >= 0 else '−'}{abs(stops):.2f} stops, sRGB"
    size = "{1} by {0} pixels".format(*error.shape)

    def radiance(name: str, title: str, image: Image) -> Picture:
        url, lossless = pictures.picture_url(pictures.exposed(image, gain))
        return Picture(name, title, f"{title} of {view.title}, {size}", note + _lossy(lossless), url)

    def photo(key: str, title: str, pixels: np.ndarray) -> Picture:
        return Picture(key, title, f"{title}, {size}", "sRGB" + _lossy(False), pictures.jpeg_url(pixels))

    def signed() -> Picture:
        url = pictures.png_url(pictures.error_indices(error, scale), pictures.palette())
        alt = f"Signed error of {names.the_test} against {names.the_reference}, {size}: "
        alt += "red where it is brighter, blue where darker"
        return Picture(
            "error", "Signed error", alt, "the channel that errs most; rings: the worst pixels", url, (*worst,)
        )

    def outlines(surfaces: tuple[Surface, Surface]) -> Picture:
        indices = pictures.silhouette_indices(*surfaces)
        alt = f"Which object each pixel sees, {size}: grey where the two agree, coloured where they do not"
        url = pictures.png_url(indices, pictures.silhouette_palette())
        return Picture("silhouettes", "Silhouettes", alt, ring_note(apart), url, (*apart,))

    jobs = []
    if view.photo is not None:
        jobs.append(pool.submit(photo, "photo", "Photo", view.photo))
    if view.augmented is not None:
        jobs.append(pool.submit(photo, "augmented", "Augmented photo", view.augmented))
    jobs.append(pool.submit(radiance, names.test, names.test_title, view.test))
    jobs.append(pool.submit(radiance, names.reference, names.reference_title, view.reference))
    jobs.append(pool.submit(signed))
    if view.surfaces:
        jobs.append(pool.submit(outlines, view.surfaces))
    return [job.result() for job in jobs]


def _lossy(lossless: bool) -> str:
    return "" if lossless else "; shown as JPEG"


def mismatches(view: PairView) -> list[tuple[int, int]]:
    return pictures.mismatches(*view.surfaces) if view.surfaces else []


def ring_note(apart: list[tuple[int, int]]) -> str:
    if not apart:
        return "every pixel's centre sees the same object in both"
    if len(apart) < pictures.MARKS:
        return f"{len(apart)} pixel{'s' * (len(apart) > 1)} differ{'s' * (len(apart) == 1)}, ringed"
    return f"the first {pictures.MARKS} pixels that differ are ringed"


def colour_bar(scale: pictures.Scale, tolerance: float | None) -> dict[str, Any]:
    """A strip of the palette, its ticks (position in percent, text), its words, where `tolerance` is."""
    strip = pictures.png_url(np.arange(255, dtype=np.uint8)[None], pictures.palette())
    if scale.logarithmic:
        first, last = round(math.log10(scale.low)), round(math.log10(scale.high))
        step = max(1, math.ceil((last - first) / 4))
        sizes = [10.0**k for k in range(last, first, -step)]
        words = f"each tick is a factor of {10**step:,}; below {numbers.short(scale.low)} white"
    else:
        sizes = [scale.high, scale.high / 2]
        words = f"equal steps up to ±{numbers.short(scale.high)}, the rounded 99.9 % quantile of all errors"
    marks = [(-s, s) for s in sizes]
    ticks = [(50.0, "0")]
    for s in (s for pair in marks for s in pair):
        at = 50 + 50 * float(scale.position(np.array(s, np.float32)))
        ticks.append((at, ("+" if s > 0 else "−") + numbers.short(abs(s))))
    held = None if tolerance is None else 50 * float(scale.position(np.array(tolerance, np.float32)))
    return {"strip": strip, "ticks": sorted(ticks), "words": words, "held": held, "tolerance": tolerance}


# ------------------------------------------------------------------------------------------ numbers for the page


def meta(view: PairView, values: Values) -> dict[str, Any]:
    """What report.js needs to decode the values and to name what a pixel sees."""
    height, width = view.reference.shape[:2]
    planes = [{k: v for k, v in asdict(plane).items() if k != "data"} for plane in values.planes]
    return {
        "width": width, "height": height, "columns": values.width, "lines": values.height, "thin": values.thin,
        "planes": planes, "objects": view.objects, "tolerance": allowed(view),
    }  # fmt: skip


def pixel_rows(view: PairView, worst: list[tuple[int, int]], apart: list[tuple[int, int]]) -> list[dict[str, Any]]:
    """Exact values at pixels worth a look: those that see another object first, then the worst errors."""
    names = dict(enumerate(view.objects)) | {-1: "background"}
    chosen = list(dict.fromkeys([*apart[: LISTED // 2], *worst]))[:LISTED]
    rows = []
    for x, y in chosen:
        a, b = view.test.mean[y, x].astype(float), view.reference.mean[y, x].astype(float)
        row = {"x": x, "y": y, "reference": b.tolist(), "error": (a - b).tolist(), "seen": "–"}
        if view.surfaces:
            seen = [names.get(i, f"object {i}") for i in (int(s.ids[y, x]) for s in view.surfaces)]
            row["seen"] = seen[0] if seen[0] == seen[1] else f"{seen[0]} / {seen[1]}"
        rows.append(row)
    return rows


def calibrated(view: PairView) -> dict[str, Any] | None:
    """Intrinsics with their standard deviations, views worst first, and the spread of the views' rms for the bars."""
    calibration = view.calibration
    if calibration is None:
        return None
    from raytwin.photos import explained  # these two load OpenCV
    from raytwin.report.uncertainty import bend_url, uncertainty_url

    k = calibration.K
    found = [("fx", k[0][0], "px"), ("fy", k[1][1], "px"), ("cx", k[0][2], "px"), ("cy", k[1][2], "px")]
    found += [(n, v, "") for n, v in zip(("k1", "k2", "p1", "p2", "k3"), calibration.dist, strict=False)]
    views = sorted(calibration.views, key=lambda v: -v.rms_px)
    return {
        "intrinsics": [(n, v, calibration.sigma.get(n), unit) for n, v, unit in found],
        "views": views,
        "posed": view.photographed,
        # A calibration that was read back has no evidence any more.
        "models": explained(calibration.evidence.trials, calibration.evidence.taken) if calibration.evidence else [],
        "uncertainty": uncertainty_url(calibration) if calibration.evidence else None,
        "bends": [(b, bend_url(calibration, i)) for i, b in enumerate(calibration.boards) if b.heights]
        if calibration.evidence
        else [],
        "largest": max((v.rms_px for v in views), default=1.0) or 1.0,
    }
