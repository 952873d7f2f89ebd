"""What a verdict sees: faults put into correct renders and how often each tool finds them; alarms where there is none.

`python -m measure.power [faults noise] [COUNT]` prints the tables of docs/measured.md; COUNT pairs of
each kind of noise (500). The tools, each at a setting its users take:

- raytwin: `compare` at a false-alarm rate of 1e-3;
- the others as measure.other_tools has them (idiff is left out where OpenImageIO is not installed: it is no
  dependency).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

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


def edited(edit: Callable[[np.ndarray], None]) -> Fault:
    """The mean changed in place."""

    def fault(scene: Scene, samples: int, seed: int) -> Image:
        image = render(scene, samples, seed)
        mean = image.mean.copy()
        edit(mean)
        return replace(image, mean=mean)

    return fault


def _tile(mean: np.ndarray) -> None:
    h, w = mean.shape[:2]
    mean[h // 2 : h // 2 + 16, w // 2 : w // 2 + 16] *= np.float32(1.05)


def _square(mean: np.ndarray) -> None:
    mean[13:37, 19:43] *= np.float32(1.02)


def _gamma(mean: np.ndarray) -> None:
    mean[:] = mean ** np.float32(1 / 2.2)


def _nan(mean: np.ndarray) -> None:
    mean[mean.shape[0] // 3, mean.shape[1] // 3] = np.nan


def _black(mean: np.ndarray) -> None:
    mean[mean.shape[0] // 2 : mean.shape[0] // 2 + 2] = 0


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
    "a 16 x 16 tile 5 % too bright": edited(_tile),
    "24 x 24 pixels 2 % too bright": edited(_square),
    "a bounce missing": lambda scene, samples, seed: render(scene, samples, seed, DEPTH - 1),
    "sun 1 degree off": _sun,
    "a sphere 0.1 px off": _moved,
    "gamma applied twice": edited(_gamma),
    "one NaN pixel": edited(_nan),
    "two black rows": edited(_black),
}


def sees_raytwin(test: Image, reference: Image) -> bool:
    return compare(test, reference).verdict == "fail"


TOOLS = {"raytwin": sees_raytwin, "Welch": sees_welch_of_images, **ON_IMAGES}


def power_table(
    scene: Scene, samples=(16, 64, 256, 1024), seeds: int = 5, reference_samples: int = 16384
) -> list[dict[str, object]]:
    """Rows {"fault", "samples", tool: share of the seeds in which it saw the fault}; idiff None where not installed."""
    reference = render(scene, reference_samples, seed=999_983)
    rows = []
    for name, fault in FAULTS.items():
        for n in samples:
            images = [fault(scene, n, seed) for seed in range(seeds)]
            row: dict[str, object] = {"fault": name, "samples": n}
            for tool, sees in TOOLS.items():
                try:
                    row[tool] = sum(sees(image, reference) for image in images) / seeds
                except ImportError:
                    row[tool] = None
            rows.append(row)
    return rows


def noise_table(count: int = 500, shape: tuple[int, int] = (48, 64), rate: float = 1e-3) -> list[dict[str, Any]]:
    """Made-up noise of every kind: how many of `count` correct pairs alarm or stay undecided, and what faults are seen.

    Rows {"what", "comparisons", "alarms", "undecided", "detectable", "seen": {1.01: share, 1.03: ...}};
    `detectable` is the median of the stated minimum detectable bias, `seen` of a tenth as many pairs each.
    """
    truth = picture(*shape)
    rows: list[dict[str, Any]] = []
    for name, make in KINDS.items():
        rng = np.random.default_rng([20_000, *name.encode()])
        found = {}
        for fault, pairs in ((1.0, count), (1.01, max(count // 10, 1)), (1.03, max(count // 10, 1))):
            made = [make(rng, truth, fault) for _ in range(pairs)]
            found[fault] = [compare(*p, false_alarm_rate=rate, half_steps=half_steps(name, *p)) for p in made]
        verdicts = {fault: [c.verdict for c in comparisons] for fault, comparisons in found.items()}
        biases = [b for c in found[1.0] if (b := c.statistics.minimum_detectable_bias) is not None]
        rows.append(
            {
                "what": name,
                "comparisons": count,
                "alarms": verdicts[1.0].count("fail"),
                "undecided": verdicts[1.0].count("undecided"),
                "detectable": float(np.median(biases or [np.nan])),
                "seen": {f: verdicts[f].count("fail") / len(verdicts[f]) for f in (1.01, 1.03)},
            }
        )
    return rows


def by_fault(rows: list[dict[str, Any]], samples: list[int]) -> list[list[str]]:
    """Return a row per fault: for each tool the share caught at each number of samples, in per cent."""
    lines = []
    for fault in FAULTS:
        mine = {row["samples"]: row for row in rows if row["fault"] == fault}
        shares = ([mine[n][tool] for n in samples] for tool in TOOLS)
        lines.append([fault, *(" / ".join("-" if s is None else f"{100 * s:.0f}" for s in row) for row in shares)])
    return lines


def noise_cells(row: dict[str, Any]) -> list[str]:
    shares = (f"{100 * share:.0f} %" for share in row["seen"].values())
    alarms, undecided = f"{row['alarms']} of {row['comparisons']}", str(row["undecided"])
    return [row["what"], alarms, undecided, percent(row["detectable"]), *shares]


def main(*parts: str, scenes: str = str(Path(__file__).resolve().parents[2] / "scenes")) -> None:
    def table(name: str, columns: Sequence[str], rows: list[list[str]]) -> None:
        part = name.partition("-")[0]
        counted = f" {count}" if part == "noise" else ""
        record.table("verdict", name, columns, rows, f"python -m measure.power {part}{counted}")

    count = next((int(part) for part in parts if part.isdecimal()), 500)
    chosen = [part for part in parts if not part.isdecimal()] or ["faults", "noise"]
    if "faults" in chosen:
        overlap = read_scene(f"{scenes}/overlap")
        overlap, counts = overlap.with_camera(overlap.camera.resized(160, 120)), [16, 64, 256, 1024, 4096]
        tools = [f"{tool} at {' / '.join(map(str, counts))}" for tool in TOOLS]
        table("faults", ["fault", *tools], by_fault(power_table(overlap, counts, seeds=3), counts))
    if "noise" in chosen:
        rows = noise_table(count)
        columns = ["noise", "alarms", "undecided", "detectable", "1 % caught", "3 % caught"]
        table("noise", columns, [noise_cells(row) for row in rows])
        counted = [row for row in rows if row["what"] not in EXPLAINED]
        alarms, pairs = (sum(row[key] for row in counted) for key in ("alarms", "comparisons"))
        total = ["all but the three", f"{alarms} of {pairs}", interval(alarms, pairs)]
        table("noise-total", ["kinds of noise", "alarms", "95 % interval of the rate"], [total])


if __name__ == "__main__":
    main(*record.arguments())
