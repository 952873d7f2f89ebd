"""What a verdict sees: faults put into correct renders and how often each tool finds them; alarms where there is none.

`python -m measure.power [faults noise] [COUNT]` prints the tables of docs/measured.md; COUNT pairs of
each kind of noise (500). The tools, each at a setting its users take:

- raytwin: `compare` at a false-alarm rate of 1e-3;
- the others as measure.other_tools has them (idiff is left out where OpenImageIO is not installed: it is no
  dependency).
"""

import functools
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from measure import record
from measure.noise_models import KINDS, UNSEEN, half_steps, picture
from measure.other_tools import ON_IMAGES, sees_welch_of_images
from measure.sequences import interval
from scene_of import changed

from raytwin.compare import compare
from raytwin.compare.messages import percent
from raytwin.images.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene

EXPLAINED = (
    "rare events against the exact image", UNSEEN, "the same numbers in every pixel",
)  # fmt: skip
"""Kinds of noise that fail for good reason: events were never seen, in the image or in pixels of their own; and common
random numbers are a fault."""
DEPTH = 3
"""Of the reference: light, two surfaces, eye. The fault `a bounce missing` renders with one less."""

Fault = Callable[[Scene, int, int], Image]


@functools.lru_cache(maxsize=64)
def render(
    scene: Scene, samples: int, seed: int, depth: int = DEPTH, rung: str = "path", sampling: str = "center"
) -> Image:
    from raytwin import twin

    deepest = RUNGS[rung].depth or 0
    most = depth if deepest > depth else None
    return twin.render(scene, rung, sampling=sampling, samples=samples, seed=seed, cache=False, max_depth=most)


def scaled(factor: float) -> Fault:
    """What is lit, brighter; the background, whose value has no noise to hide in, as it is."""

    def fault(scene: Scene, samples: int, seed: int) -> Image:
        image = render(scene, samples, seed)
        mask = image.surface.mask if image.surface is not None else np.ones(image.shape[:2], bool)
        gain = np.where(mask[..., None], np.float32(factor), np.float32(1))
        return replace(image, mean=image.mean * gain, variance=image.variance * gain**2)

    return fault


def edited(edit: Callable[[np.ndarray], np.ndarray]) -> Fault:
    """The mean changed, and not its variance."""

    def fault(scene: Scene, samples: int, seed: int) -> Image:
        image = render(scene, samples, seed)
        return replace(image, mean=edit(image.mean).astype(np.float32))

    return fault


def box(mean: np.ndarray, y: int, x: int, high: int, wide: int = 0) -> np.ndarray:
    """(H, W, 1): `high` x `wide` pixels at (x, y), or a square."""
    there = np.zeros((*mean.shape[:2], 1), bool)
    there[y : y + high, x : x + (wide or high)] = True
    return there


def _sun(scene: Scene, samples: int, seed: int) -> Image:
    x, y, z = scene.sun.to_light
    c, s = np.cos(np.radians(1)), np.sin(np.radians(1))
    sun = msgspec.structs.replace(scene.sun, to_light=(c * x - s * y, s * x + c * y, z))
    return render(changed(scene, lights=(sun, scene.sky)), samples, seed)


def _moved(scene: Scene, samples: int, seed: int) -> Image:
    camera, first = scene.camera, scene.spheres[0]
    R, c = np.array(camera.R_cam_board), np.array(first.center)
    depth = float((R @ c + camera.t_cam_board)[2])
    center = c + R.T @ [0.1 * depth / camera.fx, 0, 0]
    moved = msgspec.structs.replace(first, center=tuple(center.tolist()))
    objects = tuple(moved if thing is first else thing for thing in scene.objects)
    return render(changed(scene, objects=objects), samples, seed)


FAULTS: dict[str, Fault] = {
    "none": lambda scene, samples, seed: render(scene, samples, seed),
    "0.1 % too bright": scaled(1.001),
    "0.3 % too bright": scaled(1.003),
    "1 % too bright": scaled(1.01),
    "3 % too bright": scaled(1.03),
    "a 16 x 16 tile 5 % too bright": edited(lambda mean: mean * np.where(box(mean, 60, 80, 16), 1.05, 1)),
    "24 x 24 pixels 2 % too bright": edited(lambda mean: mean * np.where(box(mean, 13, 19, 24), 1.02, 1)),
    "a bounce missing": lambda scene, samples, seed: render(scene, samples, seed, DEPTH - 1),
    "sun 1 degree off": _sun,
    "a sphere 0.1 px off": _moved,
    "gamma applied twice": edited(lambda mean: mean ** (1 / 2.2)),
    "one NaN pixel": edited(lambda mean: np.where(box(mean, 40, 53, 1), np.nan, mean)),
    "two black rows": edited(lambda mean: np.where(box(mean, 60, 0, 2, mean.shape[1]), 0, mean)),
}


def sees_raytwin(test: Image, reference: Image) -> bool:
    return compare(test, reference).verdict == "fail"


TOOLS = {"raytwin": sees_raytwin, "Welch": sees_welch_of_images, **ON_IMAGES}


def power_table(
    scene: Scene, samples: Sequence[int], seeds: int = 5, reference_samples: int = 16384
) -> list[list[str]]:
    """Rows: fault, then for each tool in how many per cent of the seeds it was seen, at each number of samples."""
    reference = render(scene, reference_samples, seed=999_983)
    rows = []
    for name, fault in FAULTS.items():
        images = [[fault(scene, n, seed) for seed in range(seeds)] for n in samples]
        row = [name]
        for sees in TOOLS.values():
            try:
                found = [sum(sees(image, reference) for image in of_count) / seeds for of_count in images]
                row.append(" / ".join(f"{100 * share:.0f}" for share in found))
            except ImportError:
                row.append(" / ".join("-" for _ in samples))
        rows.append(row)
    return rows


def noise_table(count: int = 500, shape: tuple[int, int] = (48, 64), rate: float = 1e-3) -> list[list[str]]:
    """Made-up noise of every kind: how many of `count` correct pairs alarm or stay undecided, and what faults are seen.

    Rows: kind, alarms, undecided, the median of the stated minimum detectable bias, and in how many of a tenth as many
    pairs 1 % and 3 % too much light is seen.
    """
    truth = picture(*shape)
    rows = []
    for name, make in KINDS.items():
        rng, tenth = np.random.default_rng([20_000, *name.encode()]), max(count // 10, 1)
        found = {}
        for fault, pairs in ((1.0, count), (1.01, tenth), (1.03, tenth)):
            made = [make(rng, truth, fault) for _ in range(pairs)]
            found[fault] = [compare(*p, false_alarm_rate=rate, half_steps=half_steps(name, *p)) for p in made]
        counts = {fault: Counter(c.verdict for c in comparisons) for fault, comparisons in found.items()}
        biases = [b for c in found[1.0] if (b := c.statistics.minimum_detectable_bias) is not None]
        shares = (f"{100 * counts[fault]['fail'] / tenth:.0f} %" for fault in (1.01, 1.03))
        alarms, undecided = f"{counts[1.0]['fail']} of {count}", str(counts[1.0]["undecided"])
        rows.append([name, alarms, undecided, percent(float(np.median(biases or [np.nan]))), *shares])
    return rows


def main(*parts: str, scenes: str = str(Path(__file__).resolve().parents[2] / "scenes")) -> None:
    numbers = [int(part) for part in parts if part.isdecimal()]
    chosen = [part for part in parts if not part.isdecimal()] or ["faults", "noise"]
    if "faults" in chosen:
        overlap, counts = read_scene(f"{scenes}/overlap"), [16, 64, 256, 1024, 4096]
        overlap = overlap.with_camera(overlap.camera.resized(160, 120))
        tools = [f"{tool} at {' / '.join(map(str, counts))}" for tool in TOOLS]
        rows = power_table(overlap, counts, seeds=3)
        record.table("verdict", "faults", ["fault", *tools], rows, "python -m measure.power faults")
    if "noise" in chosen:
        count = (*numbers, 500)[0]
        command, found = f"python -m measure.power noise {count}", noise_table(count)
        columns = ["noise", "alarms", "undecided", "detectable", "1 % caught", "3 % caught"]
        record.table("verdict", "noise", columns, found, command)
        alarms = sum(int(row[1].split(" of ")[0]) for row in found if row[0] not in EXPLAINED)
        pairs = count * sum(row[0] not in EXPLAINED for row in found)
        total = ["all but the three", f"{alarms} of {pairs}", interval(alarms, pairs)]
        columns = ["kinds of noise", "alarms", "95 % interval of the rate"]
        record.table("verdict", "noise-total", columns, [total], command)


if __name__ == "__main__":
    main(*record.arguments())
