"""How often the right cause is named: `python tests/grade/measure_diagnosis.py alone | students | pairs [N]`.

Faults of the catalogue planted alone or by two on scenes as shipped, of 160 pixels across; mistakes in tracers that
students wrote; and right tracers, which must not be blamed.
"""

import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import numpy as np
from students import CORRECT, MISTAKES, mistaken, run

from raytwin import files
from raytwin.grade.catalogue import FAULTS, SAMPLING, Fault
from raytwin.grade.diagnosis import Diagnosis, View, diagnose
from raytwin.grade.predict import RIGHT, Bench
from raytwin.methods.exchange import as_arrays
from raytwin.scene import Scene

NAMES = ("eclipse", "overlap", "distorted", "grazing", "weekend")
ACROSS = 160


def small(name: str) -> Scene:
    scene = files.read_scene(files.SCENES / name).scene
    width, height = scene.camera.image_size
    return scene.with_camera(scene.camera.resized(ACROSS, round(ACROSS * height / width)))


def planted(changes: Iterable[Callable[[Any], Any]], scene: Scene) -> np.ndarray:
    h, w = scene.camera.height, scene.camera.width
    v, u = np.indices((h, w), float).reshape(2, -1)
    steps = RIGHT
    for change in changes:
        steps = change(steps)
    bench = Bench(scene, u, v)
    with np.errstate(all="ignore"):
        bench.brightest = float(bench.radiance(RIGHT).max())
        return np.asarray(steps.output(bench.radiance(steps), bench.brightest)).reshape(h, w, 3)


class Tally:
    """Counts, and a line for each that is not named first and alone."""

    def __init__(self) -> None:
        self.counts = dict.fromkeys(("all", "hidden", "detected", "named first", "among the named", "false at sure"), 0)
        self.seconds = 0.0

    def take(self, wanted: set[str], label: str, made: Diagnosis, allowed: set[str], seconds: float) -> None:
        """`wanted`: names that all must be found; `allowed`: any one of them is right where one is wanted."""
        first = {cause.name for cause in made.causes}
        all_ = first | {cause.name for others in made.alternatives for cause in others}
        self.seconds += seconds
        self.counts["all"] += 1
        self.counts["hidden"] += made.right
        self.counts["detected"] += not made.right
        good = first == wanted or (len(wanted) == 1 and len(first) == 1 and bool(first & allowed))
        near = wanted <= all_ or bool(all_ & allowed and len(wanted) == 1)
        self.counts["named first"] += good
        self.counts["among the named"] += good or near
        self.counts["false at sure"] += made.sureness == "sure" and not (good or near)
        if not good and not made.right:
            nearest = made.nearest.name if made.nearest else "-"
            print(f"{label}: {sorted(first)} or {sorted(all_ - first)}, nearest {nearest}, {made.sureness}", flush=True)

    def tell(self) -> None:
        print(self.counts, f"{self.seconds / max(self.counts['all'], 1):.2f} CPU seconds each", flush=True)


def timed(views: list[View]) -> tuple[Diagnosis, float]:
    start = time.process_time()
    return diagnose(views), time.process_time() - start


def of_students(scenes: list[Scene]) -> None:
    told, tally, blamed = [as_arrays(scene) for scene in scenes], Tally(), 0
    for variation in CORRECT:
        pictures = run(mistaken(*variation), told)
        blamed += bool(timed([View(s, p) for s, p in zip(scenes, pictures, strict=True)])[0].causes)
    for wanted, text, old, new in MISTAKES:
        pictures = run(mistaken(text, old, new), told)
        made, seconds = timed([View(s, p) for s, p in zip(scenes, pictures, strict=True)])
        tally.take({wanted[0]}, wanted[0], made, set(wanted), seconds)
    print(f"right tracers that were blamed: {blamed} of {len(CORRECT)}")
    tally.tell()


def of_faults(scenes: list[Scene], chosen: Iterable[tuple[Fault, ...]]) -> None:
    tally = Tally()
    for faults in chosen:
        views = [View(scene, planted([f.ways[0] for f in faults], scene)) for scene in scenes]
        names = {f.name for f in faults}
        tally.take(names, " + ".join(f.name for f in faults), *(lambda made, s: (made, names, s))(*timed(views)))
    tally.tell()


def main() -> None:
    what, number = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 40
    scenes = [msgspec.structs.replace(small(name), name=name) for name in NAMES]
    direct = [f for f in FAULTS if f.stage != SAMPLING]
    if what == "students":
        of_students(scenes)
    elif what == "alone":
        of_faults(scenes, ((f,) for f in direct))
    else:
        rng = np.random.default_rng(0)
        of_faults(scenes, (tuple(direct[i] for i in rng.choice(len(direct), 2, replace=False)) for _ in range(number)))


if __name__ == "__main__":
    main()
