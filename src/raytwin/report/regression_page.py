"""Augmented photos beside the true ones: a page for each, an index of all."""

from pathlib import Path
from typing import Any

import numpy as np

from raytwin import files, viewer
from raytwin.compare import Comparison, Report
from raytwin.image import Image
from raytwin.report.compare_page import write_report
from raytwin.report.page import write_page
from raytwin.report.view import Names, PairView, Tile
from raytwin.scene import Tolerance
from raytwin.workflows.compared import Compared

INDEX, SCRIPT = "against.html", "against-viewer.js"

NAMES = Names("augmented", "true", "Augmented photo", "True photo")


class Against:
    """`add` as each photo is done, `finish` in the end: against.html in the folder, and what it links to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.pages: list[tuple[str, dict[str, Any]]] = []

    def add(self, row: dict[str, Any], drawn: np.ndarray, truth: np.ndarray) -> None:
        """Add a photo: `row` as workflows.augment_photos returns it, the two photos as sRGB uint8 (H, W, 3)."""
        if not self.pages:
            files.write_text(self.folder / SCRIPT, viewer.script())
        name = f"against-{row['photo']}.html"
        regions = [part for part in row["regions"] if part["share"]]
        about = "mean {mean:+.4f}, 95 % within {p95:.4f}, {codes:.2f} codes of 255; {percent:.1f} % of the photo"
        pair = Compared(
            test=Image(files.from_bytes(drawn)),
            reference=Image(files.from_bytes(truth)),
            report=Report("", None, Comparison("pass")),  # which nothing shows: nothing is judged
            tolerance=Tolerance(),
            settings={"pose's rms": f"{row['pose_rms_px']:.3f} px", "values": "linear light, 1 is white"},
        )
        view = PairView(
            pair=pair,
            title=row["photo"],
            about=("against", "the true photo"),
            names=NAMES,
            tolerance=None,
            motto="drawn objects beside real ones",
            tiles=tuple(
                Tile(f"Error on {part['region']}", f"{part['rms']:.4f}", "rms", f"{part['codes']:.2f} codes of 255")
                for part in regions
            ),
            metrics=tuple(
                (f"{part['region']}, rms", part["rms"], about.format(**part, percent=100 * part["share"]))
                for part in regions
            ),
        )
        write_report(view, self.folder / name, SCRIPT)
        self.pages.append((name, row))

    def finish(self) -> Path:
        """The index; its path."""
        write_page(self.folder / INDEX, "against.html.j2", pages=self.pages)
        return self.folder / INDEX
