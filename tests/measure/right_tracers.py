"""Count the causes named for correct tracers beside the twin. There may be none.

`python -m measure.right_tracers [SEEDS] [SCENE ...]`, in tests/, takes every shipped scene (or those named) at every
lit level, in three sizes, SEEDS (1) seeds of the sampled levels, the engines and samplings that a level knows. Each
pair is explained as if it had failed: as it is, and with 3 and with 12 values spoilt. What is named is listed.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from measure.correct_pairs import SHIPPED, Case, shipped

from raytwin import twin
from raytwin.images.image import Image
from raytwin.renderers.subject_renderers import fast_engine
from raytwin.rungs import RUNGS
from raytwin.study.compare_scene import find_causes

SIZES = (64, 96, 160)
"""Pixels of width."""
SPOILT = (0, 3, 12)
"""Wrong values in each pair."""


def spoilt(image: Image, count: int, seed: int) -> Image:
    """The image with `count` values off by up to a third of its brightest: as outlines and rare events leave them."""
    rng = np.random.default_rng(seed)
    mean = image.mean.copy()
    at = rng.choice(mean.size, count, replace=False)
    mean.reshape(-1)[at] = np.abs(mean.reshape(-1)[at] + rng.normal(0, 0.3 * mean.max(), count))
    return replace(image, mean=mean)


def named(case: Case, counts: tuple[int, ...] = SPOILT) -> Iterator[tuple[int, str]]:
    """(values spoilt, cause) for each cause that is named."""
    right = case.tracer()
    reference = twin.render(
        case.scene, case.level, sampling=case.sampling, samples=case.samples, seed=case.seed + 1000, cache=False
    )
    engine = fast_engine(twin.activate().variant)
    for count in counts:
        made = spoilt(right, count, case.seed)
        for found in find_causes(made, reference, case.scene, case.level, case.sampling, engine):
            if found.names_a_cause:
                yield count, found.reason


def cases(names: tuple[str, ...], seeds: int) -> Iterator[Case]:
    for name in names:
        for width in SIZES:
            scene, tolerance = shipped(name, width)
            for level, rung in RUNGS.items():
                if rung.noisy:
                    for seed in range(seeds):
                        for sampling in twin.SAMPLINGS:
                            yield Case(name, scene, tolerance, level, "drjit32", sampling, 16, seed)
                elif rung.lit:
                    for engine in ("numpy64", "drjit32"):
                        yield Case(name, scene, tolerance, level, engine)


def one_each(names: tuple[str, ...]) -> Iterator[Case]:
    """One of `cases` for each scene: levels, sizes, and engines or samplings take turns."""
    lit = [level for level, rung in RUNGS.items() if rung.lit]
    for i, name in enumerate(names):
        level = lit[i % len(lit)]
        scene, tolerance = shipped(name, SIZES[(i + i // 3) % len(SIZES)])
        turn = i // len(lit) % 2
        if RUNGS[level].noisy:
            yield Case(name, scene, tolerance, level, "drjit32", twin.SAMPLINGS[turn], 16, 0)
        else:
            yield Case(name, scene, tolerance, level, ("numpy64", "drjit32")[turn])


def main(seeds: int = 1, *names: str) -> int:
    """Print what is named, and the counts; return how many causes were named."""
    twin.activate()
    pairs: Counter[str] = Counter()
    found: Counter[str] = Counter()
    for case in cases(names or SHIPPED, seeds):
        pairs[case.level] += len(SPOILT)
        for count, words in named(case):
            found[case.level] += 1
            print(f"{case}, {count} values spoilt: {words}", flush=True)
    for level, count in pairs.items():
        print(f"{level}: {count} pairs, {found[level]} causes named")
    return found.total()


if __name__ == "__main__":
    sys.exit(bool(main(*map(int, sys.argv[1:2]), *sys.argv[2:])))
