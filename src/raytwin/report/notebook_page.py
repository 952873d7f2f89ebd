"""What a notebook shows of an image, of two, or of measurements; and the viewer, where anywidget is.

Pictures are PNGs in the HTML, so that they stay when a notebook is saved. They are at most WIDE pixels across.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from raytwin import files, viewer
from raytwin.compare import Comparison, error_map
from raytwin.image import Image
from raytwin.report import numbers
from raytwin.report.data_urls import exposed, exposure, png_url, stops
from raytwin.report.page import render_part
from raytwin.report.view import PairView, showable, view_of
from raytwin.viewer.packing import binned
from raytwin.viewer.widget import has_widgets, pane, widget

WIDE = 480
"""Most pixels across a picture in the HTML: a saved notebook stays small."""
COLOURS = {"pass": "#1a7f37", "differs": "#1a7f37", "fail": "#cf222e", "undecided": "#9a6700"}
"""Verdict -> the colour of its word; readable on white and on black."""


def html_of(thing: Any) -> str:
    """Return what stays in a saved notebook: pictures as PNG, tables as HTML."""
    return HTML[type(thing).__name__](thing)


def widget_of(thing: Any) -> dict[str, Any]:
    """Return the viewer as a notebook's widget; nothing where it cannot be, or `thing` has no pictures."""
    made = VIEWED.get(type(thing).__name__)
    if made is None or not has_widgets() or (shown := made(thing)) is None:
        return {}
    bundle = widget(*shown)._repr_mimebundle_()
    first = bundle[0] if isinstance(bundle, tuple) else bundle
    return {kind: value for kind, value in first.items() if kind.endswith("widget-view+json")}


def png_of(image: Image) -> bytes:
    """Return the picture as PNG, exposed as its 99.5 % quantile asks."""
    return files.encoded(_exposed(image), "png")


def _shown(columns: Sequence[str] = (), rows: Sequence[dict[str, Any]] = (), **parts: Any) -> str:
    """Return the parts in the order of notebook.html.j2: verdict, caption, figures, table."""
    empty: dict[str, Any] = dict.fromkeys(("verdict", "caption", "figures"), ())
    return render_part("notebook.html.j2", columns=columns, rows=rows, wide=WIDE, **empty | parts)


def _exposed(image: Image, gain: float | None = None) -> np.ndarray:
    small = binned(image, -(-image.shape[1] // WIDE)) if image.shape[1] > WIDE else image
    return exposed(small, exposure(image) if gain is None else gain)


def _image(image: Image) -> str:
    caption = repr(image).strip("<>").removeprefix("raytwin.")
    if not showable(image):
        return _shown(caption=caption)
    return _shown(figures=[(png_url(_exposed(image)), caption)])


def _pair(view: PairView) -> str:
    """Return the verdict, both pictures, their difference and the numbers."""
    parts = _head(view)
    if view.alike:
        gain, n = exposure(view.reference), -(-view.test.shape[1] // WIDE)
        a, b = (binned(i, n) if n > 1 else i for i in (view.test, view.reference))
        pictures = [(_exposed(a, gain), view.names.test_title), (_exposed(b, gain), view.names.reference_title)]
        pictures.append((files.to_bytes(error_map(a, b)), "Difference: red is too bright, blue too dark"))
        parts["figures"] = [(png_url(pixels), title) for pixels, title in pictures]
    return _shown(("number", "value", "unit"), _numbers(view.comparison), **parts)


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
    "Diff": lambda found: _pair(view_of(found)),
    "Result": lambda found: _pair(view_of(found)),
    "Levels": lambda found: _shown(("method", "rung", "rays", "seconds", "error"), found.table()),
    "Bench": lambda found: _shown(
        ("method", "rung", "width", "height", "seconds_median", "rmse", "verdict", "on_frontier"), found.table()
    ),
}
"""Name of a class -> what a notebook shows of it. One more kind is one more row, and InNotebook among its bases."""


# ------------------------------------------------------------------------------------------ the viewer


def _viewed_image(image: Image) -> tuple[dict[str, Any], str] | None:
    if not showable(image):
        return None
    packed = viewer.pack(image, image, surfaces=False)
    about = {"names": {"test": "image"}, "panes": [pane("test", "Image", "image")], "exposure": stops(image)}
    return packed.for_page() | about, ""


def _viewed_pair(view: PairView) -> tuple[dict[str, Any], str] | None:
    from raytwin.report.compare_page import side_by_side

    return (side_by_side(view)["data"] | {"address": False}, _shown(**_head(view))) if view.alike else None


VIEWED: dict[str, Callable[[Any], tuple[dict[str, Any], str] | None]] = {
    "Image": _viewed_image,
    "Diff": lambda found: _viewed_pair(view_of(found)),
    "Result": lambda found: _viewed_pair(view_of(found)),
}
"""Name of a class -> the viewer's data and the HTML above it, for what has pictures."""
