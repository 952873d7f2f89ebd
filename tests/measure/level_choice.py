"""Check the recommendations of `raytwin levels` with other random numbers.

`python -m measure.level_choice`, in tests/, asks for each of three tolerances on each of eight shipped scenes, at 160 x
120. The choice is correct if it meets the tolerance with another seed, and the next cheaper method does not, by rmse
against a path-traced reference of another renderer and another seed than the command's. Where the next cheaper one
misses or meets by less than two per cent, which its samples decide, the two are a tie. The last column tells what the
order by counted rays costs: the seconds of the choice, over those of the fastest measured method that meets it.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from raytwin.fast import walk
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene
from raytwin.study.converged import unbiased_error
from raytwin.study.levels import Row, levels, method_of

SCENES = "ball", "distorted", "eclipse", "gloss", "grazing", "overlap", "studio", "wedge"
TOLERANCES = 0.1, 0.03, 0.01
SIZE = 160, 120
TIE = 0.02
"""Share of the tolerance within which another seed gives another answer."""
ROOT = Path(__file__).resolve().parents[2] / "scenes"


class Checked(NamedTuple):
    """Errors of the choice and of the next cheaper method with another seed; and the ratio of seconds."""

    choice: str
    error: float
    cheaper: str
    cheaper_error: float
    slower: float


def results() -> Iterator[tuple[str, float, Checked]]:
    for name in SCENES:
        scene = read_scene(ROOT / name)
        scene = scene.with_camera(scene.camera.resized(*SIZE))
        halves = [walk(scene, "path", "drjit32", samples=2048, seed=k, depth=16, surface=False).mean for k in (71, 72)]
        for tolerance in TOLERANCES:
            found = levels(scene, tolerance).found
            assert found.choice is not None, found.reason
            rows = [row for row in found.rows if row.side == "tracer"]
            place = rows.index(found.choice)
            meeting = [row.seconds for row in rows if row.error_most <= tolerance]
            pair = (rows[place], rows[place - 1] if place else None)
            errors = [error_of(scene, row, halves) if row else np.inf for row in pair]
            cheaper = pair[1].method if pair[1] else "-"
            yield (
                name,
                tolerance,
                Checked(found.choice.method, errors[0], cheaper, errors[1], found.choice.seconds / min(meeting)),
            )


def error_of(scene: Scene, row: Row, halves: list[np.ndarray]) -> float:
    image = method_of(row)(scene, seed=5).mean
    one, other = (image - half for half in halves)
    return unbiased_error("rmse", one, other, halves[0]).value


def main() -> int:
    """Print every recommendation and how many are correct; return how many are wrong."""
    counts = {"right": 0, "tie": 0, "wrong": 0}
    for name, tolerance, found in results():
        word = "right" if found.error <= tolerance < found.cheaper_error else "wrong"
        if found.error <= tolerance and abs(found.cheaper_error / tolerance - 1) < TIE:
            word = "tie"
        counts[word] += 1
        print(
            f"{name:10} {tolerance:<5g} {found.choice:26} {found.error:.5f}  {found.cheaper:26} "
            f"{found.cheaper_error:.5f}  {found.slower:5.2f} x  {word}",
            flush=True,
        )
    print(", ".join(f"{count} {word}" for word, count in counts.items()))
    return counts["wrong"]


if __name__ == "__main__":
    sys.exit(bool(main()))
