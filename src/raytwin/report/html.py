"""report.html: one file that opens offline; pictures side by side, numbers, calibration, times beside errors."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from importlib import resources
from pathlib import PurePath

import jinja2
import numpy as np

from raytwin import files
from raytwin.compare.heatmap import signed_error
from raytwin.image import Image
from raytwin.pipeline import Result
from raytwin.report import numbers, pictures
from raytwin.report.figures import Picture, embed, script_of_bokeh
from raytwin.report.values import Values, pack_values
from raytwin.scene import Sphere

LISTED = 8
"""Worst pixels in the table."""


def write_report(result: Result, path: str | os.PathLike) -> None:
    """The whole report as one HTML file without references to any other; some megabytes, mostly pictures."""
    error = signed_error(result.subject, result.twin, "absolute")
    scale = pictures.choose_scale(result.subject, result.twin, error, result.scene.tolerance.p999_abs)
    noisy = pictures.noisy(result.subject, result.twin)
    with ThreadPoolExecutor() as pool:
        packing = pool.submit(pack_values, result.subject, result.twin)
        worst = pictures.worst_pixels(error, LISTED)
        apart = mismatches(result)
        panels = draw(result, error, scale, worst, apart, pool)
        values = packing.result()
    width, height = result.scene.camera.image_size
    script, elements, toolbar = embed(panels, width, height)
    page = template().render(
        r=result,
        c=result.comparison,
        width=width,
        height=height,
        panels=list(zip(panels, elements, strict=True)),
        bokeh=script_of_bokeh(),
        script=script,
        toolbar=toolbar,
        css=asset("report.css"),
        js=asset("report.js"),
        meta=meta(result, values, noisy),
        thin=values.thin,
        packed={plane.name: plane.data for plane in values.planes},
        noisy=noisy,
        bar=colour_bar(scale, None if noisy else result.scene.tolerance.p999_abs),
        colours=pictures,
        groups=list(numbers.rows(result.comparison, result.scene.tolerance, noisy)),
        worst=pixel_rows(result, worst, apart),
        apart=len(apart),
        calibrated=calibrated(result),
    )
    files.write_text(path, page)


def template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters |= {f.__name__: f for f in (numbers.shown, numbers.beside, numbers.short, numbers.seconds)}
    return environment.from_string(asset("report.html.j2"))


def asset(name: str) -> str:
    return resources.files("raytwin.report").joinpath(name).read_text(encoding="utf-8")


# ------------------------------------------------------------------------------------------ pictures


def draw(
    result: Result,
    error: np.ndarray,
    scale: pictures.Scale,
    worst: list[tuple[int, int]],
    apart: list[tuple[int, int]],
    pool: ThreadPoolExecutor,
) -> list[Picture]:
    """The panels in reading order; what the scene lacks is left out."""
    gain = pictures.exposure(result.twin)
    stops = math.log2(gain)
    note = f"exposure {'+' if stops >= 0 else '−'}{abs(stops):.2f} stops, sRGB"
    size = "{1} by {0} pixels".format(*error.shape)

    def radiance(key: str, title: str, image: Image) -> Picture:
        url, lossless = pictures.picture_url(pictures.exposed(image, gain))
        return Picture(key, title, f"{title} of scene {result.scene.name}, {size}", note + _lossy(lossless), url)

    def photo(key: str, title: str, pixels: np.ndarray) -> Picture:
        return Picture(key, title, f"{title}, {size}", "sRGB" + _lossy(False), pictures.jpeg_url(pixels))

    def signed() -> Picture:
        url = pictures.png_url(pictures.error_indices(error, scale), pictures.palette())
        alt = f"Signed error of the tracer against the twin, {size}: red where it is brighter, blue where darker"
        return Picture(
            "error", "Signed error", alt, "the channel that errs most; rings: the worst pixels", url, (*worst,)
        )

    def outlines() -> Picture:
        indices = pictures.silhouette_indices(result.subject.surface, result.twin.surface)
        alt = f"Which object each pixel sees, {size}: grey where tracer and twin agree, coloured where they do not"
        url = pictures.png_url(indices, pictures.silhouette_palette())
        return Picture("silhouettes", "Silhouettes", alt, ring_note(result, apart), url, (*apart,))

    jobs = []
    if result.photo is not None:
        jobs.append(pool.submit(photo, "photo", "Photo", result.photo))
    if result.augmented is not None:
        jobs.append(pool.submit(photo, "augmented", "Augmented photo", result.augmented))
    jobs.append(pool.submit(radiance, "tracer", "Tracer's image", result.subject))
    jobs.append(pool.submit(radiance, "twin", "Twin's image", result.twin))
    jobs.append(pool.submit(signed))
    if both_surfaces(result):
        jobs.append(pool.submit(outlines))
    return [job.result() for job in jobs]


def _lossy(lossless: bool) -> str:
    return "" if lossless else "; shown as JPEG"


def both_surfaces(result: Result) -> bool:
    return result.subject.surface is not None and result.twin.surface is not None


def mismatches(result: Result) -> list[tuple[int, int]]:
    return pictures.mismatches(result.subject.surface, result.twin.surface) if both_surfaces(result) else []


def ring_note(result: Result, apart: list[tuple[int, int]]) -> str:
    if not apart:
        return "every pixel's centre sees the same object in both"
    if len(apart) < pictures.MARKS:
        return f"{len(apart)} pixel{'s' * (len(apart) > 1)} differ{'s' * (len(apart) == 1)}, ringed"
    return f"the first {pictures.MARKS} pixels that differ are ringed"


def colour_bar(scale: pictures.Scale, tolerance: float | None) -> dict:
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
        at = 50 + 50 * float(scale.position(np.float32(s)))
        ticks.append((at, ("+" if s > 0 else "−") + numbers.short(abs(s))))
    held = None if tolerance is None else 50 * float(scale.position(np.float32(tolerance)))
    return {"strip": strip, "ticks": sorted(ticks), "words": words, "held": held, "tolerance": tolerance}


# ------------------------------------------------------------------------------------------ numbers for the page


def object_names(result: Result) -> list[str]:
    """Of `scene.objects`, counted from 0 as in the scene file."""
    spheres = len(result.scene.spheres)
    return [
        f"sphere {i}" if isinstance(thing, Sphere) else f"plane {i - spheres}"
        for i, thing in enumerate(result.scene.objects)
    ]


def meta(result: Result, values: Values, noisy: bool) -> dict:
    """What report.js needs to decode the values and to name what a pixel sees."""
    width, height = result.scene.camera.image_size
    tolerance = None if noisy else result.scene.tolerance.p999_abs
    planes = [{k: v for k, v in asdict(plane).items() if k != "data"} for plane in values.planes]
    return {
        "width": width, "height": height, "columns": values.width, "lines": values.height, "thin": values.thin,
        "planes": planes, "objects": object_names(result), "tolerance": tolerance,
    }  # fmt: skip


def pixel_rows(result: Result, worst: list[tuple[int, int]], apart: list[tuple[int, int]]) -> list[dict]:
    """Exact values at pixels worth a look: those that see another object first, then the worst errors."""
    names = dict(enumerate(object_names(result))) | {-1: "background"}
    chosen = list(dict.fromkeys([*apart[: LISTED // 2], *worst]))[:LISTED]
    rows = []
    for x, y in chosen:
        a, b = result.subject.mean[y, x].astype(float), result.twin.mean[y, x].astype(float)
        row = {"x": x, "y": y, "twin": b.tolist(), "error": (a - b).tolist(), "seen": "–"}
        if both_surfaces(result):
            seen = names[int(result.subject.surface.ids[y, x])], names[int(result.twin.surface.ids[y, x])]
            row["seen"] = seen[0] if seen[0] == seen[1] else f"{seen[0]} / {seen[1]}"
        rows.append(row)
    return rows


def calibrated(result: Result) -> dict | None:
    """Intrinsics with their standard deviations, views worst first, and the spread of the views' rms for the bars."""
    calibration = result.calibration
    if calibration is None:
        return None
    k = calibration.K
    found = [("fx", k[0][0], "px"), ("fy", k[1][1], "px"), ("cx", k[0][2], "px"), ("cy", k[1][2], "px")]
    found += [(n, v, "") for n, v in zip(("k1", "k2", "p1", "p2", "k3"), calibration.dist, strict=False)]
    views = sorted(calibration.views, key=lambda v: -v.rms_px)
    return {
        "intrinsics": [(n, v, calibration.sigma.get(n), unit) for n, v, unit in found],
        "views": views,
        "posed": PurePath(result.pose.photo).name if result.pose else None,
        "largest": max((v.rms_px for v in views), default=1.0) or 1.0,
    }
