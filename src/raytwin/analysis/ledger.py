"""The ledger: the error of a rung against the whole light, as named parts that add up to it pixel by pixel.

What the tracer shows, minus all light over the pixel's area, is

    (shown - what its rung is, exactly) + (the rung at the pixel's centre - over its area) - (what the rung leaves out)

and what a rung leaves out are parts of one sum over random walks: light that shadows take away, the sky that other
objects hide, and each bounce. One run gives them all, from the same samples, so that nothing is lost between them.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from raytwin.analysis.light_parts import SAMPLES, Arrays, WholeLight, sampled_parts
from raytwin.analysis.own_error import OWN, own_error
from raytwin.compare.report import Part
from raytwin.image import BACKGROUND, Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene

LEFT_OUT = {
    "sun's shadow": "shadow", "sky's occlusion": "occlusion", "bounce 1": "bounce 1", "bounce 2": "bounce 2",
    "bounces 3 and more": "bounce 3+",
}  # fmt: skip
"""A part of the error -> the part of the light that is missing in it."""


@dataclass(frozen=True, eq=False)
class Ledger:
    """`parts` as comparison.json has them; `pictures`: each part of the error (h, w, 3), whose sum is `error`.

    Of every `step`-th pixel.
    """

    parts: tuple[Part, ...]
    pictures: dict[str, np.ndarray]
    error: np.ndarray
    step: int


def make_ledger(
    scene: Scene, shown: Image, rung: str, engine: str, depth: int = 8, keep: bool = False, faulty: bool = False
) -> Ledger:
    """Split the error of `shown`, a picture at light level `rung`, into parts; `keep`: cache the light between runs."""
    return split_error(WholeLight(scene, engine, depth, keep), shown, rung, faulty)


def split_error(light: WholeLight, shown: Image, rung: str, faulty: bool = False) -> Ledger:
    """The parts of the error of `shown`, a picture of the light's scene that stands on `rung`.

    `faulty`: it fails on its own rung: what neither rounding nor variance explains is the subject's own error.
    """
    scene, step, seen = light.scene, light.step, shown.mean[:: light.step, :: light.step]
    exact = None if RUNGS[rung].noisy else light.exact(rung)
    split = [_split(seen, exact, half, rung) for half in light.halves]
    if faulty:
        split = _without_own(light, shown, exact, rung, split)
    errors = [_sum(pictures.values(), seen) for pictures in split]
    squared = float((errors[0] * errors[1]).sum(dtype=float))
    whole = sum(float(part.mean(dtype=float)) for half in light.halves for part in half.values()) / 2
    partners = light.partners if any(name in LEFT_OUT for name in split[0]) else {}
    ids = None if shown.surface is None else shown.surface.ids[::step, ::step]
    rows, pictures = [], {name: (split[0][name] + split[1][name]) / 2 for name in split[0]}
    for name, picture in pictures.items():
        one, other = split[0][name], split[1][name]
        along = sum(float((p * e).sum(dtype=float)) for p, e in ((one, errors[1]), (other, errors[0]))) / 2
        sampled = bool((one != other).any())
        rows.append(
            Part(
                name,
                rmse=math.sqrt(max(float((one * other).mean(dtype=float)), 0.0)),
                seconds=light.seconds.get(LEFT_OUT.get(name, "")),
                share_of_light=float(picture.mean(dtype=float)) / whole if whole else None,
                share_of_error=along / squared if squared > 0 else None,
                noise=float(np.sqrt(np.square(one - other, dtype=float).mean())) / 2 if sampled else None,
                between=() if ids is None else _between(scene, picture, ids, partners.get(LEFT_OUT.get(name, ""))),
            )
        )
    noise = float(np.sqrt(np.square(errors[0] - errors[1], dtype=float).mean())) / 2
    rows.append(Part("noise", rmse=noise, noise=noise))
    return Ledger(tuple(rows), pictures, (errors[0] + errors[1]) / 2, step)


def _split(seen: np.ndarray, exact: np.ndarray | None, light: Arrays, rung: str) -> dict[str, np.ndarray]:
    """The parts of what is seen; `exact`: its rung without error, where no samples make it."""
    lacks = RUNGS[rung].lacks
    over_area = _sum((part for name, part in light.items() if not lacks(name)), seen)
    if exact is None:
        own = {"its own samples": seen - over_area}
    else:
        own = {"numerics": seen - exact, "pixel sampling": exact - over_area}
    return own | {name: -light[part] for name, part in LEFT_OUT.items() if lacks(part)}


def _without_own(
    light: WholeLight, shown: Image, exact: np.ndarray | None, rung: str, split: list[dict[str, np.ndarray]]
) -> list[dict[str, np.ndarray]]:
    """The parts with the subject's own error taken out of numerics or samples, which stand first, into rows of its own.

    The rest of the own error, which no name explains, is the last of these rows.
    """
    step, first = light.step, next(iter(split[0]))
    variance = None if shown.variance is None else shown.variance[::step, ::step]
    seen = Image(shown.mean[::step, ::step], variance=variance, samples=shown.samples)
    one, other = (half[first] for half in split)
    right = Image(seen.mean - (one + other) / 2, np.square(one - other) / 4, samples=len(split) * SAMPLES)
    right = right if exact is None else Image(exact)
    found = own_error(light.thin, seen, right, rung, sampled_parts(light.thin, rung, light.engine, "area"))
    rest = found.whole - _sum((picture for _, picture in found.named), found.whole)
    rows = {f"{OWN}: {name}": picture for name, picture in found.named} | {OWN: rest}
    rows = {name: picture for name, picture in rows.items() if picture.any()}
    return [rows | half | {first: half[first] - found.whole} for half in split]


def _sum(pictures: Iterable[np.ndarray], like: np.ndarray) -> np.ndarray:
    return sum(pictures, start=np.zeros_like(like))


def _between(scene: Scene, picture: np.ndarray, ids: np.ndarray, partners: np.ndarray | None) -> tuple[str, ...]:
    """The object on which the part's squared error is largest, and the one that has most to do with it there."""
    energy = np.einsum("hwc,hwc->hw", picture, picture)
    on = np.bincount(ids[ids > BACKGROUND], energy[ids > BACKGROUND], minlength=len(scene.objects))
    if not on.any():
        return ()
    names, most = scene.names, int(on.argmax())
    if partners is None or not partners[most].any():
        return (names[most],)
    return names[most], names[int(partners[most].argmax())]
