"""What a notebook shows of an image, of two, or of measurements; and the viewer, where anywidget is.

Pictures are PNGs in the HTML, so that they stay when a notebook is saved. They are at most MAX_WIDTH pixels across.
"""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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


@dataclass(frozen=True, eq=False)
class Cell:
    """What a notebook shows: `head` and `table` as notebook.html.j2 takes them, pictures, and the viewer's data."""

    head: dict[str, Any]
    figures: Figures = field(default_factory=list)
    table: tuple[Sequence[str], Sequence[dict[str, Any]]] = ((), ())
    viewed: Callable[[], dict[str, Any]] | None = None

    def html(self) -> str:
        """Return what stays in a saved notebook: pictures as PNG, tables as HTML."""
        return _shown(self.head, [(png_url(pixels), title) for pixels, title in self.figures], self.table)

    def still(self) -> dict[str, Any]:
        """Return the pictures in a row, as PNG."""
        if not self.figures:
            return {}
        most = max(len(pixels) for pixels, _ in self.figures)
        rows = [np.pad(p, ((0, most - len(p)), (0, GAP), (0, 0)), constant_values=255) for p, _ in self.figures]
        return {"image/png": encoded(np.concatenate(rows, axis=1)[:, :-GAP], "png")}

    def widget(self, still: str = "") -> dict[str, Any]:
        """Return the viewer as a notebook's widget, which hides what is marked `still`; nothing without pictures."""
        if self.viewed is None:
            return {}
        bundle = widget(self.viewed(), _shown(self.head), still)._repr_mimebundle_()
        first = bundle[0] if isinstance(bundle, tuple) else bundle
        return {kind: value for kind, value in first.items() if kind.endswith("widget-view+json")}


def _shown(head: dict[str, Any], figures: Sequence[Any] = (), table: Any = ((), ())) -> str:
    empty: dict[str, Any] = dict.fromkeys(("verdict", "caption"))
    columns, rows = table
    return render_part("notebook.html.j2", figures=figures, columns=columns, rows=rows, wide=MAX_WIDTH, **empty | head)


def html_of(thing: Any) -> str:
    """Return what stays in a saved notebook."""
    return cell_of(thing).html()


def bundle_of(thing: Any) -> dict[str, Any]:
    """Return the pictures as one PNG, and the viewer as a notebook's widget; each where there is one."""
    cell = cell_of(thing)
    return cell.still() | (cell.widget() if has_widgets() else {})


def display(thing: Any) -> None:
    """Display pictures that stay, then the viewer, which hides them: without a kernel, Jupyter shows an error in the
    place of a widget, whatever else its output holds. Raises NotImplementedError where there is no viewer."""
    still = secrets.token_hex(8)
    if not has_widgets() or not (view := (cell := cell_of(thing)).widget(still)):
        raise NotImplementedError
    from IPython.display import display as show

    html = f'<div data-raytwin="{still}">{cell.html()}</div>'
    show({"text/plain": repr(thing), "text/html": html, **cell.still()}, raw=True)
    show({"text/plain": "", **view}, raw=True)


def cell_of(thing: Any) -> Cell:
    return CELLS[type(thing).__name__](thing)


def small_picture(image: Image, gain: float | None = None) -> np.ndarray:
    """Return sRGB uint8 (h, w, 3), at most MAX_WIDTH across, times `gain` (None: bright parts become white)."""
    small = binned(image, -(-image.shape[1] // MAX_WIDTH)) if image.shape[1] > MAX_WIDTH else image
    return exposed(small, exposure(image) if gain is None else gain)


def pair_figures(test: Image, reference: Image, titles: Sequence[str], gain: float) -> Figures:
    """Return both pictures, times `gain`, and their difference."""
    n = -(-test.shape[1] // MAX_WIDTH)
    a, b = (binned(i, n) if n > 1 else i for i in (test, reference))
    difference = to_bytes(error_map(a, b)), "Difference: red is too bright, blue too dark"
    return [(small_picture(a, gain), titles[0]), (small_picture(b, gain), titles[1]), difference]


def _image(image: Image) -> Cell:
    title = repr(image).strip("<>").removeprefix("raytwin.")
    if not showable(image):
        return Cell({"caption": title})

    def viewed() -> dict[str, Any]:
        packed = viewer.pack(image, image, surfaces=False)
        panes = [pane("test", "Image", "image")]
        return packed.for_page() | {"names": {"test": "image"}, "panes": panes, "exposure": stops(image)}

    return Cell({}, [(small_picture(image), title)], viewed=viewed)


def _pair(pair: Any) -> Cell:
    """Return the verdict, both pictures, their difference and the numbers."""
    from raytwin.show.compare_page import side_by_side

    view = view_of(pair)
    table = ("number", "value", "unit"), _numbers(view.comparison)
    if not view.alike:
        return Cell(_head(view), table=table)
    figures = pair_figures(view.test, view.reference, view.names[2:], exposure(view.reference))
    return Cell(_head(view), figures, table, lambda: side_by_side(view)["data"] | {"address": False})


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


LEVELS = "method", "rung", "rays", "seconds", "error"
METHODS = "method", "rung", "width", "height", "seconds_median", "rmse", "verdict", "on_frontier"
"""Columns of the tables."""
CELLS: dict[str, Callable[[Any], Cell]] = {
    "Image": _image,
    "Pictures": lambda shown: Cell({}, shown.figures, viewed=lambda: shown.data),
    "Diff": _pair,
    "Result": _pair,
    "Levels": lambda made: Cell({"caption": made.found.reason}, table=(LEVELS, made.table())),
    "Bench": lambda found: Cell({}, table=(METHODS, found.table())),
}
"""Name of a class -> what a notebook shows of it. One more kind is one more row, and InNotebook among its bases."""
