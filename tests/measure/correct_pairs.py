"""Count how often a correct tracer fails beside the twin on the same light level. None may.

`python -m measure.correct_pairs [SCENES] [SEEDS]`, in tests/, compares the tracer with the twin on every shipped scene,
at every level, three sizes, SEEDS seeds (3), the engines and the samplings that a level knows; then on SCENES (40)
random scenes of each kind at every level. Failures are listed with their first reason, undecided ones counted.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

from measure import record
from measure.random_scenes import KINDS, random_scene

from raytwin import twin
from raytwin.compare import Comparison
from raytwin.fast import trace
from raytwin.images.image import Image
from raytwin.photos.find_camera import find_camera
from raytwin.renderers.subject_renderers import PathTraced
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, Tolerance
from raytwin.study.compare_scene import compare_with_twin

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = tuple(sorted(p.parent.name for p in ROOT.glob("scenes/*/scene.toml")))
SIZES = (96, 128, 160)
"""Pixels of width."""
SAMPLES = 64


class Case(NamedTuple):
    """A pair to compare: `level` of light, `engine` of the tracer, `sampling` of both."""

    name: str
    scene: Scene
    tolerance: Tolerance
    level: str
    engine: str
    sampling: str = "center"
    samples: int = SAMPLES
    seed: int = 0

    def tracer(self) -> Image:
        if not RUNGS[self.level].noisy:
            return trace(self.scene, self.level, self.engine)
        return PathTraced(self.level, self.engine, self.samples, self.sampling, surface=True)(self.scene, self.seed)

    def compared(self) -> Comparison:
        reference = twin.render(
            self.scene, self.level, sampling=self.sampling, samples=self.samples, seed=self.seed + 1000, cache=False
        )
        return compare_with_twin(self.tracer(), reference, self.scene, self.tolerance)

    def __str__(self) -> str:
        width = self.scene.camera.width
        return f"{self.name} {self.level} {width} px {self.engine} {self.sampling} x{self.samples} seed {self.seed}"


@cache
def shipped(name: str, width: int) -> tuple[Scene, Tolerance]:
    scene = find_camera(ROOT / "scenes" / name)[0]
    camera = scene.camera
    return scene.with_camera(camera.resized(width, round(width * camera.height / camera.width))), scene.tolerance


def shipped_cases(seeds: int) -> Iterator[Case]:
    for name, width, level in product(SHIPPED, SIZES, RUNGS):
        scene, tolerance = shipped(name, width)
        if RUNGS[level].noisy:
            for seed, sampling, samples in product(range(seeds), twin.SAMPLINGS, (16, 64)):
                yield Case(name, scene, tolerance, level, "drjit32", sampling, samples, seed)
        else:
            yield from (Case(name, scene, tolerance, level, engine) for engine in ("numpy64", "numpy32", "drjit32"))


def random_case(kind: str, level: str, seed: int) -> Case:
    noisy = RUNGS[level].noisy
    sampling, engine = twin.SAMPLINGS[seed % 2] if noisy else "center", ("numpy64", "drjit32")[noisy or seed % 2]
    return Case(kind, random_scene(kind, seed), Tolerance(), level, engine, sampling, SAMPLES, seed)


def every_pair() -> Iterator[Case]:
    """Few of `shipped_cases` that meet every pair of a scene, a level, a size, an engine or a sampling, and a seed."""
    engines, samples = ("numpy64", "numpy32", "drjit32"), (16, 64)
    for i, name in enumerate(SHIPPED):
        sized = [shipped(name, width) for width in SIZES]
        for k, (level, rung) in enumerate(RUNGS.items()):
            scene, tolerance = sized[(i + k + i // 3) % 3]
            if not rung.noisy:
                yield Case(name, scene, tolerance, level, engines[(i + k) % 3])
                continue
            for j, sampling in enumerate(twin.SAMPLINGS):
                seed = (i + k) % 3
                yield Case(name, scene, tolerance, level, "drjit32", sampling, samples[(i + k + j) % 2], seed)


def main(scenes: int = 40, seeds: int = 3) -> int:
    """Print the counts; return how many failed."""
    twin.activate()
    counts: dict[str, Counter] = {}
    random = (random_case(kind, level, seed) for kind in KINDS for seed in range(scenes) for level in RUNGS)
    for case in (*shipped_cases(seeds), *random):
        found = case.compared()
        group = f"{'random' if case.name in KINDS else 'shipped'} scenes, {case.level}"
        counts.setdefault(group, Counter())[found.verdict] += 1
        if found.verdict != "pass":
            print(f"{found.verdict}: {case}: {found.reasons[0]}", flush=True)
    counts["all"] = sum(counts.values(), Counter())
    rows = [[group, *(c[v] for v in ("pass", "undecided", "fail"))] for group, c in counts.items()]
    command = f"python -m measure.correct_pairs {scenes} {seeds}"
    record.table("verdict", "correct-pairs", ["pairs", "pass", "undecided", "fail"], rows, command)
    return counts["all"]["fail"]


if __name__ == "__main__":
    sys.exit(bool(main(*map(int, record.arguments()))))
