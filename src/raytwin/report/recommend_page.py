"""What a scene needs: as text, and as a page with each light level as a picture."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from raytwin import files
from raytwin.analysis.recommend import Needs, Row
from raytwin.analysis.recommend.level_pictures import MORE, REFERENCE, SAMPLES
from raytwin.image import Image
from raytwin.report import data_urls, numbers
from raytwin.report.page import write_page
from raytwin.report.picture_pair import SCRIPTS, STYLES, picture_pair

WORDS = 18
"""Characters of the words before each line in the terminal."""

THUMB = 320
"""Pixels across a level's small picture, at most."""


class Level(NamedTuple):
    """A light level as a small picture; `said`: its least error and the seconds of that."""

    name: str
    url: str
    width: int
    height: int
    chosen: bool
    said: str


def write_needs(found: Needs, images: Mapping[str, Image], folder: str | os.PathLike[str]) -> None:
    """Write needs.html and needs.json; `images` as `level_pictures` makes them."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    chosen = found.choice.rung if found.choice and found.choice.rung in images else "path"
    write_page(
        folder / "needs.html",
        "needs.html.j2",
        STYLES,
        SCRIPTS,
        n=found,
        described=_described(found.choice) if found.choice else "",
        levels=[_level(found, name, image, images[REFERENCE]) for name, image in images.items() if name != REFERENCE],
        samples=SAMPLES,
        reference_samples=MORE * SAMPLES,
        **picture_pair(images, (chosen, REFERENCE), REFERENCE),
    )
    files.write_json(folder / "needs.json", found)


def _level(found: Needs, name: str, image: Image, reference: Image) -> Level:
    step = -(-image.shape[1] // THUMB)
    shown = data_urls.exposed(image, data_urls.exposure(reference))[::step, ::step]
    tried = [row for row in (found.choice, *found.rejected) if row and row.rung == name and row.error is not None]
    best = min(tried, key=lambda row: row.error or 0.0, default=None)
    said = "not tried" if best is None else f"{found.metric} {numbers.shown(best.error, 2)}"
    if best is not None and best.seconds is not None:
        said += f", {numbers.seconds(best.seconds)}"
    chosen = found.choice is not None and found.choice.rung == name
    url, _ = data_urls.picture_url(shown)
    return Level(name, url, shown.shape[1], shown.shape[0], chosen, said)


SHOWN = 6
"""Ways that were rejected; the JSON has all."""


def needs_summary(found: Needs) -> str:
    """The choice, what was cheaper and fails, what else would do, and what is not needed."""
    lines = [f"{found.scene}: {found.metric} <= {found.tolerance:g} against global illumination over the pixels' area"]
    if found.choice is None:
        lines.append(f"{'None':<{WORDS}}{found.reason}")
    else:
        lines += [
            f"{'Cheapest':<{WORDS}}{_described(found.choice)}",
            f"{'':<{WORDS}}{found.choice.reason}{_on(found.choice)}",
        ]
    for row in found.rejected[:SHOWN]:
        lines.append(f"{'Rejected':<{WORDS}}{row.method}: {row.reason}")
    if (more := len(found.rejected) - SHOWN) > 0:
        lines.append(f"{'':<{WORDS}}and {more} more")
    for thing in found.not_needed:
        unit = " px" if thing.what.startswith("distortion") else ""
        proven = "nothing proven" if thing.bound is None else f"proven <= {thing.bound:.2g}{unit}"
        measured = "" if thing.measured is None else f", measured {thing.measured:.2g}{unit}"
        lines.append(f"{'Can be dropped':<{WORDS}}{thing.what}: {thing.why} ({proven}{measured})")
    t = found.truth
    deeper = "no bound on deeper light" if t.beyond is None else f"deeper light adds at most {t.beyond:.2g}"
    lines.append(
        f"{'Measured against':<{WORDS}}{t.samples} samples at {t.pixels} pixels, depth {t.depth} ({deeper}); "
        f"its noise {t.noise:.2g}; {found.seconds:.1f} s"
    )
    return "\n".join(lines)


def _described(row: Row) -> str:
    depth = f" to depth {row.depth}" if row.depth else ""
    rays = "one ray through each pixel's centre" if row.samples == 1 and row.sampling == "center" else (
        f"{row.samples} rays {'over each pixel' if row.sampling == 'area' else 'through each centre'}"
    )  # fmt: skip
    guessed = f", every {row.speculation}-th pixel traced" if row.speculation > 1 else ""
    trim = f", trim {row.trim}" if row.trim else ""
    seconds = "" if row.seconds is None else f": {row.seconds:.3g} s{'' if row.calls else ' (scaled from fewer rays)'}"
    return f"{row.rung}{depth}, {row.engine} ({row.precision} bits), {rays}{guessed}{trim}{seconds}"


def _on(row: Row) -> str:
    """On how much of the frame the error was taken."""
    share = row.pixels or 0.0
    return ", verified at full size" if share == 1 else f", verified on {100 * share:.2g} % of the frame's pixels"
