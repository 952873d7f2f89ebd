"""The ledger: the error of a light level against all light, as named parts that add up to it pixel by pixel.

What the tracer shows, minus all light over the pixel's area, is

    (shown - what its rung is, exactly) + (the rung at the pixel's center - over its area) - (what the rung leaves out)

and what a rung leaves out are parts of one sum over random walks: light that shadows take away, the sky that other
objects hide, and each bounce. One run gives them all, from the same samples, so that nothing is lost between them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from raytwin.compare.comparison import Part
from raytwin.explain.light_parts import WholeLight
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


@dataclass(frozen=True, eq=False)
class Ledger:
    """`parts` as comparison.json has them; `pictures`: each part of the error (h, w, 3), whose sum is `error`.

    All of them hold every `step`-th pixel.
    """

    parts: tuple[Part, ...]
    pictures: dict[str, np.ndarray]
    error: np.ndarray
    step: int


def make_ledger(scene: Scene, shown: Image, rung: str, engine: str, depth: int = 8, faulty: bool = False) -> Ledger:
    """Split the error of `shown`, a picture at light level `rung`, into parts."""
    return split_error(WholeLight(scene, engine, depth), shown, rung, faulty)


def split_error(light: WholeLight, shown: Image, rung: str, faulty: bool = False) -> Ledger:
    """The parts of the error of `shown`, a picture of the light's scene at light level `rung`.

    `faulty`: it fails on its own rung. What is not rounding is then the subject's own error; where its light is
    sampled, that error and the samples' noise are one part.
    """
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
    return Ledger(tuple(rows), pictures, (errors[0] + errors[1]) / 2, light.step)


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


def _sum(pictures: Iterable[np.ndarray], like: np.ndarray) -> np.ndarray:
    return sum(pictures, start=np.zeros_like(like))
