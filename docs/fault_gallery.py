"""The gallery of faults: each mistake that raytwin names, rendered once, with its difference and its sentence.

python docs/fault_gallery.py           # make the pictures that are missing
python docs/fault_gallery.py NAME...   # make these again

`docs/build.py` does the same; `docs/hooks.py` makes the page of them.
"""

import sys
from collections.abc import Sequence
from functools import cache
from html import escape
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import gallery
import numpy as np
from PIL import Image as Picture

import raytwin
from raytwin.explain.catalogue import FAULTS
from raytwin.explain.changes import FAULT_STAGES, Fault
from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.predict import Array, Predictor, predictor
from raytwin.images.photo_files import to_bytes

FOLDER = gallery.MADE / "faults"
WIDTH, HEIGHT = 160, 120
"""Of one picture, pixels."""
GAP = 4
"""Pixels between a fault's picture and its difference."""
SEEN = 0.02
"""Mean absolute difference, relative to the picture's brightest value, at which a fault counts as plain to see."""
WHITE, FULL = 0.8, 0.4
"""Linear value at which the right picture's brightest parts are shown, and difference that gets the full colour."""
MOST_BYTES = 3e6
"""Of all pictures together."""

NOWHERE = ".shown-nowhere"
"""The file with the names of faults that no scene shows."""
HEADINGS = {
    "camera": "Camera and rays", "solver": "Intersections", "order": "Which object is in front", "normals": "Normals",
    "light": "Light", "shadow": "Shadows", "sampling": "Sampling", "output": "The finished picture",
}  # fmt: skip
"""Stage of a fault -> heading."""


@cache
def scenes() -> tuple[tuple[Predictor, Array], ...]:
    """Return what faults are shown with, best first, each with its right picture."""
    shipped = [raytwin.read_scene(f"scenes/{name}") for name in ("overlap", "eclipse", "distorted")]
    every = (*shipped, *(draw_scene(seed) for seed in range(3)))
    made = [predictor(scene.with_camera(scene.camera.resized(WIDTH, HEIGHT))) for scene in every]
    return tuple((one, one.radiance()) for one in made)


def shown(fault: Fault) -> tuple[Array, Array] | None:
    """Return the picture with the fault and the right one, (N, 3) each, where it shows best; None where nowhere.

    The first scene on which it is plain to see, else the one with the largest difference.
    """
    best: tuple[float, Array, Array] | None = None
    for one, right in scenes():
        for way in fault.ways:
            wrong = one.picture(way)
            off = float(np.nan_to_num(np.abs(wrong - right), nan=1.0, posinf=1.0).mean()) / one.brightest
            if best is None or off > best[0]:
                best = off, wrong, right
            if off > SEEN:
                return wrong, right
    return best[1:] if best and best[0] > 0 else None


def strip(wrong: Array, right: Array) -> Picture.Image:
    """Return picture and difference side by side: blue is too dark, red too bright, pink no number."""
    scale = WHITE / max(float(np.quantile(right, 0.99)), 1e-6)
    canvas = Picture.new("RGB", (2 * WIDTH + GAP, HEIGHT), (255, 255, 255))
    each = np.nan_to_num(wrong - right) * scale / FULL
    off = np.clip(np.take_along_axis(each, np.abs(each).argmax(axis=-1)[:, None], axis=-1)[:, 0], -1, 1)
    fade = 1 - np.abs(off)
    parts = np.stack([np.where(off < 0, fade, 1), fade, np.where(off > 0, fade, 1)], axis=-1)
    parts[~np.isfinite(wrong).all(axis=-1)] = 1, 0.2, 1
    picture = np.clip(np.nan_to_num(wrong, nan=1.0) * scale, 0, 1)
    for left, values in ((0, to_bytes(picture.astype(np.float32))), (WIDTH + GAP, (255 * parts).astype(np.uint8))):
        canvas.paste(Picture.fromarray(values.reshape(HEIGHT, WIDTH, 3)), (left, 0))
    return canvas


def file_of(fault: Fault) -> Path:
    return FOLDER / f"{fault.name}.webp"


def make(names: Sequence[str] = ()) -> None:
    """Make the pictures that are missing, or those of the named faults again."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    known = {fault.name: fault for fault in FAULTS}
    if unknown := sorted(set(names) - set(known)):
        raise SystemExit(f"faults: expected names of faults, got {', '.join(unknown)}")
    for stale in set(FOLDER.glob("*.webp")) - set(map(file_of, FAULTS)):
        stale.unlink()
    nowhere = FOLDER / NOWHERE  # or every build would look for them in every scene again
    unseen = set(nowhere.read_text(encoding="utf-8").split()) if nowhere.exists() else set()
    for fault in (known[name] for name in names or sorted(known.keys() - unseen)):
        if names or not file_of(fault).exists():
            if pictures := shown(fault):
                strip(*pictures).save(file_of(fault), quality=70)
            else:
                unseen.add(fault.name)
    nowhere.write_text(" ".join(sorted(unseen)), encoding="utf-8")
    if (size := sum(path.stat().st_size for path in FOLDER.glob("*.webp"))) > MOST_BYTES:
        raise SystemExit(f"faults: expected at most {MOST_BYTES / 1e6:.0f} MB of pictures, got {size / 1e6:.1f} MB")


def entry(fault: Fault) -> str:
    """Return a fault as HTML: picture and difference, where there are any, above the sentence."""
    picture = ""
    if file_of(fault).exists():
        picture = (
            f'<img src="{gallery.MADE.name}/faults/{fault.name}.webp" width="{2 * WIDTH + GAP}" height="{HEIGHT}"'
            f' loading="lazy" alt="Left: a picture with the fault {fault.name}. Right: its difference.">'
        )
    return (
        f'<figure class="fault" id="{fault.name}">{picture}<figcaption><b>{fault.name}</b> '
        f"{escape(fault.sentence[0].upper() + fault.sentence[1:])}.</figcaption></figure>"
    )


def page() -> str:
    """Return the page of all faults by stage, with a box to search it."""
    parts = [
        "# Gallery of faults\n\nEach mistake that raytwin names, rendered once. On the left is a picture made with the"
        " mistake, on the right its difference from the right picture: blue is too dark, red too bright, pink is no"
        " number. Is yours among them? `raytwin compare --subject yours.py` looks for it.\n",
        '<p><label>Search <input type="search" class="fault-search" placeholder="normal, shadow, upside down"></label>'
        ' <span class="fault-count" role="status"></span></p>\n',
    ]
    ordered = sorted(FAULTS, key=lambda fault: (FAULT_STAGES.index(fault.stage), not file_of(fault).exists()))
    for stage, faults in groupby(ordered, attrgetter("stage")):
        parts.append(f"## {HEADINGS[stage]}\n")
        parts.append(f'<div class="faults">{"".join(map(entry, faults))}</div>\n')
    return "\n".join(parts)


if __name__ == "__main__":
    make(sys.argv[1:])
