"""Count the planted bugs that the ledger takes for rounding. None should be.

`python -m measure.planted_ledger [COUNT]`, in tests/, plants COUNT (30) faults of the catalogue, spread over its
stages, in small frames of three scenes at `shadow`, and splits the error of each as that of a subject that fails. A bug
is taken for `numerics` where that row keeps a tenth of its squared error.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from measure.correct_pairs import shipped

from raytwin import twin
from raytwin.explain.catalogue import FAULTS
from raytwin.explain.changes import Fault
from raytwin.explain.ledger import OWN, split_error
from raytwin.explain.light_parts import WholeLight
from raytwin.explain.predict import RIGHT, planted
from raytwin.images.image import Image
from raytwin.renderers.subject_renderers import Traced, fast_engine

SCENES = "overlap", "single", "ball"
WIDTH = 64
HIDDEN = 0.1
"""Share of the planted squared error that the row of rounding may have."""
SEEN = 0.01
"""Rms of a planted error, of the image's, below which it is too small for this question."""


class Planted(NamedTuple):
    """Shares of the planted squared error: that stays with rounding, and that is the subject's own."""

    innocent: float
    own: float


@cache
def light(name: str) -> WholeLight:
    return WholeLight(shipped(name, WIDTH)[0], fast_engine(twin.activate().variant))


@cache
def right_image(name: str) -> Image:
    return Traced("shadow", light(name).engine, surface=True)(light(name).scene, 0)


def ledger_of(name: str, fault: Fault) -> Planted | None:
    """The ledger of a correct image with what `fault` adds to it; None where that is hardly anything."""
    scene, right = light(name).scene, right_image(name)
    exact, made = (planted(scene, way) for way in (RIGHT, fault.ways[0]))
    added = np.nan_to_num(np.clip(made - exact, -10, 10))
    energy = float(np.square(added).mean())
    if energy < SEEN**2 * float(np.square(right.mean).mean()):
        return None
    shown = replace(right, mean=(right.mean + added).astype(np.float32))
    rows = {part.part: part for part in split_error(light(name), shown, "shadow", True).parts}
    before = {part.part: part for part in split_error(light(name), right, "shadow", False).parts}
    kept = max(rows["numerics"].rmse ** 2 - before["numerics"].rmse ** 2, 0.0)
    return Planted(kept / energy, rows[OWN].rmse ** 2 / energy)


def chosen(count: int) -> tuple[Fault, ...]:
    """Return faults that pictures show, evenly over the catalogue, which is in the order of the tracer's stages."""
    shown = [fault for fault in FAULTS if fault.ways]
    return tuple(shown[k * len(shown) // count] for k in range(count))


def results(count: int) -> Iterator[tuple[str, str, Planted]]:
    for name in SCENES:
        for fault in chosen(count):
            if (found := ledger_of(name, fault)) is not None:
                yield name, fault.name, found


def main(count: int = 30) -> int:
    """Print the bugs that hide, and the counts; return how many there are."""
    found = list(results(count))
    wrong = [row for row in found if row[2].innocent > HIDDEN]
    for name, fault, (innocent, own) in wrong:
        print(f"{name} {fault}: {innocent:.2f} of it innocent, {own:.2f} the subject's own")
    print(f"{len(found)} planted bugs, {len(wrong)} taken for rounding", flush=True)
    return len(wrong)


if __name__ == "__main__":
    sys.exit(bool(main(*map(int, sys.argv[1:]))))
