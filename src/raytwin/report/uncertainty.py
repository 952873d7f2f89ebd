"""The projected uncertainty over the frame, as a picture: how far off a pixel may be, and where the tags were seen."""

import base64
import io
import os

import numpy as np

from raytwin import files
from raytwin.photos import Calibration, uncertainty_map
from raytwin.report.charts import INK, SOFT

WIDTH = 5.4
"""Inches, at 100 dots each on the page and twice that in a file."""


def write_uncertainty(calibration: Calibration, path: str | os.PathLike) -> None:
    """`uncertainty_png` as a file."""
    data = uncertainty_png(calibration)
    with files.replacing(path) as temporary:
        temporary.write_bytes(data)


def uncertainty_url(calibration: Calibration) -> str:
    """The same for a page that has no files beside it."""
    return f"data:image/png;base64,{base64.b64encode(uncertainty_png(calibration)).decode('ascii')}"


def uncertainty_png(calibration: Calibration) -> bytes:
    """One standard deviation of what is seen at each pixel, `photos.uncertainty_map`, with contours: a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = calibration.image_size
    found = uncertainty_map(calibration)
    figure = Figure(figsize=(WIDTH, WIDTH * (0.82 * height / width + 0.17)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    frame = (-0.5, width - 0.5, height - 0.5, -0.5)
    # Logarithmic: from the middle to a corner without tags it may grow a hundredfold.
    low, high = _decades(found)
    norm = {"vmin": np.log10(low), "vmax": np.log10(high)}
    picture = axes.imshow(
        np.log10(np.maximum(found, low)), extent=frame, cmap="viridis", interpolation="bilinear", **norm
    )
    u, v = np.array(calibration.evidence.seen).T
    axes.plot(u, v, ".", color="white", alpha=0.6, markersize=3, markeredgewidth=0)
    levels = [x for x in _steps(low, high) if found.min() < x < found.max()]
    if levels:
        h, w = found.shape
        at = (np.arange(w) + 0.5) * width / w - 0.5, (np.arange(h) + 0.5) * height / h - 0.5
        lines = axes.contour(*at, found, levels, colors="white", linewidths=0.9)
        axes.clabel(lines, fmt=lambda x: f"{x:g}", fontsize=8)
    axes.set(xlim=frame[:2], ylim=frame[2:])
    axes.set_title(
        f"1 σ of a point {calibration.evidence.distance:.2g} m away, px; dots: tags seen",
        fontsize=9, color=INK, loc="left",
    )  # fmt: skip
    axes.tick_params(labelsize=7.5, colors=SOFT, length=2)
    bar = figure.colorbar(picture, cax=axes.inset_axes((1.025, 0, 0.03, 1)))
    ticks = _steps(low, high)
    bar.set_ticks(np.log10(ticks), labels=[f"{x:g}" for x in ticks], fontsize=7.5, color=SOFT)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=200, bbox_inches="tight", pad_inches=0.04)
    return buffer.getvalue()


def _decades(values: np.ndarray) -> tuple[float, float]:
    """The range of the values, rounded outwards to 1, 2 or 5 times a power of 10."""
    low, high = max(float(values.min()), 1e-6), max(float(values.max()), 2e-6)
    steps = [m * 10.0**k for k in range(-7, 8) for m in (1, 2, 5)]
    return max(s for s in steps if s <= low), min(s for s in steps if s >= high)


def _steps(low: float, high: float) -> list[float]:
    """1, 2 and 5 times the powers of 10 from low to high."""
    return [m * 10.0**k for k in range(-7, 8) for m in (1, 2, 5) if low * 0.999 <= m * 10.0**k <= high * 1.001]
