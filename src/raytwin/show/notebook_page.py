"""What a notebook shows of an image, of two, or of measurements; and the viewer, where anywidget is.

Pictures are PNGs in the HTML, so that they stay when a notebook is saved. They are at most MAX_WIDTH pixels across.
"""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytwin.compare import Comparison, error_map
from raytwin.images.image import Image
from raytwin.images.packing import binned
from raytwin.images.photo_files import encoded, to_bytes
from raytwin.notebook import InNotebook
from raytwin.show import numbers, viewer
from raytwin.show.data_urls import exposed, exposure, png_url, stops
from raytwin.show.page import render_part
from raytwin.show.view import PairView, showable, view_of
from raytwin.show.viewer.widget import has_widgets, pane, widget

MAX_WIDTH = 480
"""Most pixels across a picture in the HTML: a saved notebook stays small."""
GAP = 8
"""White pixels between the pictures of one PNG."""
Figures = list[tuple[np.ndarray, str]]
"""sRGB uint8 (H, W, 3) and a title, each."""
COLOURS = {"pass": "#1a7f37", "differs": "#1a7f37", "fail": "#cf222e", "undecided": "#9a6700"}
"""Verdict -> the colour of its word; readable on white and on black."""


@dataclass(frozen=True, eq=False, repr=False)
class Pictures(InNotebook):
    """Pictures side by side, (sRGB (H, W, 3) uint8, title) each, and the viewer's data."""

    figures: Figures
    data: dict[str, Any]

    def __repr__(self) -> str:
        return f"<{', '.join(title for _, title in self.figures)}>"


def html_of(thing: Any) -> str:
    """Return what stays in a saved notebook: pictures as PNG, tables as HTML."""
    return HTML[type(thing).__name__](thing)


def bundle_of(thing: Any) -> dict[str, Any]:
    """Return the pictures as one PNG, and the viewer as a notebook's widget; each where there is one."""
    return still_of(thing) | (widget_of(thing) if has_widgets() else {})


def still_of(thing: Any) -> dict[str, Any]:
    """Return the pictures of `thing` in a row, as PNG."""
    if not (figures := FIGURES.get(type(thing).__name__, lambda _: [])(thing)):
        return {}
    heights = [len(pixels) for pixels, _ in figures]
    rows = [np.pad(p, ((0, max(heights) - len(p)), (0, GAP), (0, 0)), constant_values=255) for p, _ in figures]
    return {"image/png": encoded(np.concatenate(rows, axis=1)[:, :-GAP], "png")}


def widget_of(thing: Any, still: str = "") -> dict[str, Any]:
    """Return the viewer as a notebook's widget, which hides what is marked `still`; nothing without pictures."""
    made = VIEWED.get(type(thing).__name__)
    if made is None or (shown := made(thing)) is None:
        return {}
    bundle = widget(*shown, still)._repr_mimebundle_()
    first = bundle[0] if isinstance(bundle, tuple) else bundle
    return {kind: value for kind, value in first.items() if kind.endswith("widget-view+json")}


def display(thing: Any) -> None:
    """Display pictures that stay, then the viewer, which hides them: without a kernel, Jupyter shows an error in the
    place of a widget, whatever else its output holds. Raises NotImplementedError where there is no viewer."""
    still = secrets.token_hex(8)
    if not has_widgets() or not (view := widget_of(thing, still)):
        raise NotImplementedError
    from IPython.display import display as show

    html = f'<div data-raytwin="{still}">{html_of(thing)}</div>'
    show({"text/plain": repr(thing), "text/html": html, **still_of(thing)}, raw=True)
    show({"text/plain": "", **view}, raw=True)


def _shown(columns: Sequence[str] = (), rows: Sequence[dict[str, Any]] = (), **parts: Any) -> str:
    """Return the parts in the order of notebook.html.j2: verdict, caption, figures, table."""
    empty: dict[str, Any] = dict.fromkeys(("verdict", "caption", "figures"), ())
    return render_part("notebook.html.j2", columns=columns, rows=rows, wide=MAX_WIDTH, **empty | parts)


def small_picture(image: Image, gain: float | None = None) -> np.ndarray:
    """Return sRGB uint8 (h, w, 3), at most MAX_WIDTH across, times `gain` (None: bright parts become white)."""
    small = binned(image, -(-image.shape[1] // MAX_WIDTH)) if image.shape[1] > MAX_WIDTH else image
    return exposed(small, exposure(image) if gain is None else gain)


def _image(image: Image) -> str:
    caption = repr(image).strip("<>").removeprefix("raytwin.")
    return _pictures(_image_figures(image)) if showable(image) else _shown(caption=caption)


def _pictures(figures: Figures, **parts: Any) -> str:
    return _shown(figures=[(png_url(pixels), title) for pixels, title in figures], **parts)


def _image_figures(image: Image) -> Figures:
    return [(small_picture(image), repr(image).strip("<>").removeprefix("raytwin."))] if showable(image) else []


def pair_figures(test: Image, reference: Image, titles: Sequence[str], gain: float) -> Figures:
    """Return both pictures, times `gain`, and their difference."""
    n = -(-test.shape[1] // MAX_WIDTH)
    a, b = (binned(i, n) if n > 1 else i for i in (test, reference))
    difference = to_bytes(error_map(a, b)), "Difference: red is too bright, blue too dark"
    return [(small_picture(a, gain), titles[0]), (small_picture(b, gain), titles[1]), difference]


def _view_figures(view: PairView) -> Figures:
    if not view.alike:
        return []
    return pair_figures(view.test, view.reference, view.names[2:], exposure(view.reference))


def _pair(view: PairView) -> str:
    """Return the verdict, both pictures, their difference and the numbers."""
    table = {"columns": ("number", "value", "unit"), "rows": _numbers(view.comparison)}
    return _pictures(_view_figures(view), **table, **_head(view))


def _head(view: PairView) -> dict[str, Any]:
    """Return the verdict with its cause, or its first reason, in one line; the reasons are folded below it."""
    c, about = view.comparison, " ".join((view.title, *view.about))
    first = c.reasons[0] if c.reasons else ""
    rest = c.reasons if c.cause else c.reasons[1:]
    colour = COLOURS[c.verdict]
    return {"verdict": c.verdict, "colour": colour, "about": about, "cause": c.cause, "first": first, "rest": rest}


def _numbers(c: Comparison) -> list[dict[str, Any]]:
    rows = [row for _, group in numbers.rows(c, None, False) for row in group]
    return [{"number": r.number.name, "value": numbers.shown(r.value), "unit": r.number.unit} for r in rows]


HTML: dict[str, Callable[[Any], str]] = {
    "Image": _image,
    "Pictures": lambda shown: _pictures(shown.figures),
    "Diff": lambda found: _pair(view_of(found)),
    "Result": lambda found: _pair(view_of(found)),
    "Levels": lambda made: _shown(
        ("method", "rung", "rays", "seconds", "error"), made.table(), caption=made.found.reason
    ),
    "Bench": lambda found: _shown(
        ("method", "rung", "width", "height", "seconds_median", "rmse", "verdict", "on_frontier"), found.table()
    ),
}
"""Name of a class -> what a notebook shows of it. One more kind is one more row, and InNotebook among its bases."""
FIGURES: dict[str, Callable[[Any], Figures]] = {
    "Image": _image_figures,
    "Diff": lambda found: _view_figures(view_of(found)),
    "Result": lambda found: _view_figures(view_of(found)),
    "Pictures": lambda shown: shown.figures,
}
"""Name of a class -> its pictures, for what has any."""


# ------------------------------------------------------------------------------------------ the viewer


def _viewed_image(image: Image) -> tuple[dict[str, Any], str] | None:
    if not showable(image):
        return None
    packed = viewer.pack(image, image, surfaces=False)
    about = {"names": {"test": "image"}, "panes": [pane("test", "Image", "image")], "exposure": stops(image)}
    return packed.for_page() | about, ""


def _viewed_pair(view: PairView) -> tuple[dict[str, Any], str] | None:
    from raytwin.show.compare_page import side_by_side

    return (side_by_side(view)["data"] | {"address": False}, _shown(**_head(view))) if view.alike else None


VIEWED: dict[str, Callable[[Any], tuple[dict[str, Any], str] | None]] = {
    "Image": _viewed_image,
    "Diff": lambda found: _viewed_pair(view_of(found)),
    "Result": lambda found: _viewed_pair(view_of(found)),
    "Pictures": lambda shown: (shown.data, ""),
}
"""Name of a class -> the viewer's data and the HTML above it, for what has pictures."""
