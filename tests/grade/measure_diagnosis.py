"""How often the right cause is named: `python tests/grade/measure_diagnosis.py alone | students | pairs [N]`.

Faults of the catalogue planted alone or by two on drawn scenes, as a rubric has them: three with shadows, one without;
mistakes in tracers that students wrote; and right tracers, which must not be blamed. Then the faults that look alike:
which is named where which was planted.
"""

import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from students import CORRECT, MISTAKES, mistaken, run

from raytwin.grade.catalogue import FAULTS, SAMPLING, Fault
from raytwin.grade.diagnosis import Diagnosis, View, diagnose
from raytwin.grade.draw import draw_scene
from raytwin.grade.predict import RIGHT, Bench
from raytwin.methods.exchange import as_arrays

SCENES = [(draw_scene(seed), "shadow" if seed < 3 else "lambert") for seed in range(4)]


def planted(changes: Iterable[Callable[[Any], Any]]) -> list[View]:
    steps, made = RIGHT, []
    for change in changes:
        steps = change(steps)
    for scene, rung in SCENES:
        h, w = scene.camera.height, scene.camera.width
        v, u = np.indices((h, w), float).reshape(2, -1)
        bench = Bench(scene, u, v, rung == "shadow")
        with np.errstate(all="ignore"):
            bench.brightest = float(bench.radiance(RIGHT).max())
            shown = np.asarray(steps.output(bench.radiance(steps), bench.brightest)).reshape(h, w, 3)
        made.append(View(scene, shown, rung=rung))
    return made


class Tally:
    """Counts, and a line for each that is not named first and alone."""

    def __init__(self) -> None:
        self.counts = dict.fromkeys(("all", "hidden", "detected", "named first", "first three", "false at sure"), 0)
        self.seconds = 0.0

    def take(self, wanted: set[str], label: str, made: Diagnosis, allowed: set[str], seconds: float) -> None:
        """`wanted`: names that all must be found; `allowed`: any one of them is right where one is wanted."""
        first = {cause.name for cause in made.causes}
        all_ = first | {cause.name for others in made.alternatives for cause in others[:2]}
        self.seconds += seconds
        self.counts["all"] += 1
        self.counts["hidden"] += made.right
        self.counts["detected"] += not made.right
        good = first == wanted or (len(wanted) == 1 and len(first) == 1 and bool(first & allowed))
        near = wanted <= all_ or bool(all_ & allowed and len(wanted) == 1)
        self.counts["named first"] += good
        self.counts["first three"] += good or near
        self.counts["false at sure"] += made.sureness == "sure" and not (good or near)
        if not good and not made.right:
            nearest = made.nearest.name if made.nearest else "-"
            print(f"{label}: {sorted(first)} or {sorted(all_ - first)}, nearest {nearest}, {made.sureness}", flush=True)

    def tell(self) -> None:
        print(self.counts, f"{self.seconds / max(self.counts['all'], 1):.2f} CPU seconds each", flush=True)


def timed(views: list[View]) -> tuple[Diagnosis, float]:
    start = time.process_time()
    return diagnose(views), time.process_time() - start


def pictures(text: str) -> list[View]:
    made = run(text, [as_arrays(scene, rung) for scene, rung in SCENES])
    return [View(scene, picture, rung=rung) for (scene, rung), picture in zip(SCENES, made, strict=True)]


def of_students() -> None:
    tally, blamed = Tally(), 0
    for variation in CORRECT:
        blamed += bool(timed(pictures(mistaken(*variation)))[0].causes)
    for wanted, text, old, new in MISTAKES:
        made, seconds = timed(pictures(mistaken(text, old, new)))
        tally.take({wanted[0]}, wanted[0], made, set(wanted), seconds)
    print(f"right tracers that were blamed: {blamed} of {len(CORRECT)}")
    tally.tell()


def of_faults(chosen: Iterable[tuple[Fault, ...]]) -> None:
    tally = Tally()
    for faults in chosen:
        names = {f.name for f in faults}
        made, seconds = timed(planted([f.ways[0] for f in faults]))
        tally.take(names, " + ".join(f.name for f in faults), made, names, seconds)
    tally.tell()


def main() -> None:
    what, number = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 60
    direct = [f for f in FAULTS if f.stage != SAMPLING]
    if what == "students":
        of_students()
    elif what == "alone":
        of_faults((f,) for f in direct)
    else:
        rng = np.random.default_rng(0)
        of_faults(tuple(direct[i] for i in rng.choice(len(direct), 2, replace=False)) for _ in range(number))


if __name__ == "__main__":
    main()
