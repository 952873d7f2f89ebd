"""The ledger: the error of a light level against all light, as named parts that add up to it pixel by pixel.

What the tracer shows, minus all light over the pixel's area, is

    (shown - what its rung is, exactly) + (the rung at the pixel's center - over its area) - (what the rung leaves out)

and what a rung leaves out are parts of one sum over random walks: light that shadows take away, the sky that other
objects hide, and each bounce. One run gives them all, from the same samples, so that nothing is lost between them.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from raytwin.compare.comparison import Part
from raytwin.fast import ENGINES, light_parts, trace
from raytwin.images.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

LIGHT_LEFT_OUT = {
    "sun's shadow": "shadow", "sky's occlusion": "occlusion", "bounce 1": "bounce 1", "bounce 2": "bounce 2",
    "bounces 3 and more": "bounce 3+",
}  # fmt: skip
"""Name of an error part -> name of the missing light part."""
OWN_ERROR, SAMPLE_NOISE = "the subject's own error", "its own samples"
"""Names of the parts that are the subject's: what it does wrong, and the noise of its samples."""
ROUNDING_SHARE = 1e-5
"""Share of the image's 99 % quantile: a larger error of a subject that fails is not rounding."""
MISSING_FROM_SHARE = 0.9
"""Share of the subject's own squared error that a part of the light has to explain to be called missing."""
PIXELS, PIXELS_NUMPY, SAMPLES = 1 << 16, 1 << 13, 4
"""Of a larger frame every k-th pixel of every k-th row is used. Samples per pixel of each half."""
FEW_OBJECTS, MIN_PIXELS = 64, 1 << 12
"""From so many objects on, pixels get fewer as objects get more, down to so many: the time stays the same."""
SEEDS = 0xA11CE, 0xB0B
"""Seeds that no user's render has, so that no image is compared with its own samples."""
DEPTH_2_TIME = 0.7
"""Time at depth 2 over that at full depth, in scenes with balls on a floor."""
REMOVED_BY = {"shadow": ("shadow", 0), "occlusion": ("sky", 2), "bounce 1": ("path", 3), "bounce 2": ("path", 4)}
"""A part of the light -> the cheapest rung that has it, and to what depth; `path` to the whole depth for the others."""


@dataclass(frozen=True, eq=False)
class Ledger:
    """`parts` as comparison.json has them; `pictures`: each part of the error (h, w, 3), whose sum is `error`.

    All of them hold every `step`-th pixel. `missing`: the light whose lack would be the subject's own error; or empty.
    """

    parts: tuple[Part, ...]
    pictures: dict[str, np.ndarray]
    error: np.ndarray
    step: int
    missing: str = ""


class WholeLight:
    """The parts of the light at every `step`-th pixel, each over its own area: `halves`, part -> (h, w, 3) each.

    The halves are independent: products of one half's error with the other's have no noise in their mean. `engine`:
    the fastest here, of ENGINES.
    """

    def __init__(self, scene: Scene, engine: str, depth: int = 8) -> None:
        self.scene, self.engine, self.depth = scene, engine, depth
        w, h = scene.camera.image_size
        pixels = PIXELS_NUMPY if ENGINES[engine].is_numpy else PIXELS
        pixels = max(MIN_PIXELS, pixels * FEW_OBJECTS // max(FEW_OBJECTS, len(scene.objects)))
        self.step = math.ceil(math.sqrt(w * h / pixels))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        self.shape = (self.thin.camera.height, self.thin.camera.width, 3)
        self.halves: list[dict[str, np.ndarray]] = []
        for seed in SEEDS:
            began = time.perf_counter()
            half = light_parts(self.thin, engine, samples=SAMPLES, seed=seed, depth=depth, side=1 / self.step)
            self.walked = (time.perf_counter() - began) * len(SEEDS) * self.step**2  # the second: the first compiles
            self.halves.append({name: image.mean for name, image in half.items()})

    def seconds(self, part: str) -> float:
        """Estimate the seconds of a frame on the cheapest rung that has the part, with the samples of both halves.

        Sampled rungs cost what the walks here did: DEPTH_2_TIME of it at depth 2, and linearly more with depth. The
        others are timed in their second call.
        """
        rung, depth = REMOVED_BY.get(part, ("path", self.depth))
        if depth:
            return self.walked * (DEPTH_2_TIME + (1 - DEPTH_2_TIME) * (depth - 2) / max(self.depth - 2, 1))
        began = 0.0
        for _ in range(2):
            began = time.perf_counter()
            trace(self.thin, rung, self.engine)
        return (time.perf_counter() - began) * self.step**2

    def exact(self, rung: str) -> np.ndarray:
        """A rung that a formula gives, at each pixel's center, in float64."""
        row = ENGINES[self.engine]._replace(precision="float64")
        double = next(name for name, known in ENGINES.items() if known == row)
        return np.asarray(trace(self.thin, rung, double).mean)


def make_ledger(scene: Scene, shown: Image, rung: str, engine: str, depth: int = 8, faulty: bool = False) -> Ledger:
    """Split the error of `shown`, a picture at light level `rung`, into parts.

    `faulty`: it fails on its own rung. What is not rounding is then the subject's own error; where its light is
    sampled, that error and the samples' noise are one part.
    """
    light = WholeLight(scene, engine, depth)
    seen = shown.mean[:: light.step, :: light.step]
    exact = None if RUNGS[rung].noisy else light.exact(rung)
    split = [_split(seen, exact, half, rung, faulty) for half in light.halves]
    errors = [_sum(pictures.values(), seen) for pictures in split]
    squared = float((errors[0] * errors[1]).sum(dtype=float))
    whole = sum(float(part.mean(dtype=float)) for half in light.halves for part in half.values()) / 2
    rows, pictures = [], {name: (split[0][name] + split[1][name]) / 2 for name in split[0]}
    for name, picture in pictures.items():
        one, other = split[0][name], split[1][name]
        along = sum(float((p * e).sum(dtype=float)) for p, e in ((one, errors[1]), (other, errors[0]))) / 2
        sampled = bool((one != other).any())
        rows.append(
            Part(
                name,
                rmse=math.sqrt(max(float((one * other).mean(dtype=float)), 0.0)),
                seconds=light.seconds(LIGHT_LEFT_OUT[name]) if name in LIGHT_LEFT_OUT else None,
                share_of_light=float(picture.mean(dtype=float)) / whole if whole else None,
                share_of_error=along / squared if squared > 0 else None,
                noise=float(np.sqrt(np.square(one - other, dtype=float).mean())) / 2 if sampled else None,
            )
        )
    noise = float(np.sqrt(np.square(errors[0] - errors[1], dtype=float).mean())) / 2
    rows.append(Part("noise", rmse=noise, noise=noise))
    scatter = 0.0 if shown.variance is None else float(shown.variance.mean(dtype=float))
    missing = _missing(light.halves, split, scatter, rung) if faulty else ""
    return Ledger(tuple(rows), pictures, (errors[0] + errors[1]) / 2, light.step, missing)


def _split(
    seen: np.ndarray, exact: np.ndarray | None, light: Mapping[str, np.ndarray], rung: str, faulty: bool
) -> dict[str, np.ndarray]:
    """The parts of what is seen; `exact`: the exact picture at this light level, None if it is sampled."""
    lacks = RUNGS[rung].lacks
    over_area = _sum((part for name, part in light.items() if not lacks(name)), seen)
    if exact is None:
        own = {f"{OWN_ERROR} and {SAMPLE_NOISE}" if faulty else SAMPLE_NOISE: seen - over_area}
    else:
        own = {"numerics": seen - exact, "pixel sampling": exact - over_area}
        if faulty:
            scale = float(np.quantile(exact, 0.99)) or 1.0
            far = np.abs(own["numerics"]).max(axis=-1, keepdims=True) > ROUNDING_SHARE * scale
            own = {OWN_ERROR: np.where(far, own["numerics"], 0)} | own | {"numerics": np.where(far, 0, own["numerics"])}
    return own | {name: -light[part] for name, part in LIGHT_LEFT_OUT.items() if lacks(part)}


def _missing(
    light: Sequence[Mapping[str, np.ndarray]], split: Sequence[Mapping[str, np.ndarray]], scatter: float, rung: str
) -> str:
    """The part of the light, or all bounces from one on, whose lack would be the subject's own error; or empty.

    `split`: the error's parts by each half of the light, whose products have no noise of the light in their mean;
    `scatter`: the mean variance of what is shown.
    """
    names = [name for name, part in LIGHT_LEFT_OUT.items() if not RUNGS[rung].lacks(part)]
    some = {name: [name] for name in names}
    some |= {f"{name} and more": names[k:] for k, name in enumerate(names[:-1]) if name.startswith("bounce")}
    like = light[0]["open"]
    own = [_sum((part for name, part in half.items() if name not in LIGHT_LEFT_OUT), like) for half in split]

    def left(lost: list[str]) -> float:
        gone = (_sum((half[LIGHT_LEFT_OUT[name]] for name in lost), like) for half in light)
        one, other = (error + light_of_it for error, light_of_it in zip(own, gone, strict=True))
        return float((one * other).mean(dtype=float)) - scatter

    best = min(some, key=lambda name: left(some[name]), default="")
    return best if best and left(some[best]) < (1 - MISSING_FROM_SHARE) * left([]) else ""


def _sum(pictures: Iterable[np.ndarray], like: np.ndarray) -> np.ndarray:
    return sum(pictures, start=np.zeros_like(like))
