"""The ledger: the error of a rung against the whole light, as named parts that add up to it pixel by pixel.

What the tracer shows, minus all light over the pixel's area, is

    (shown - what its rung is, exactly) + (the rung at the pixel's centre - over its area) - (what the rung leaves out)

and what a rung leaves out are parts of one sum over random walks: light that shadows take away, the sky that other
objects hide, and each bounce. One run gives them all, from the same samples, so that nothing is lost between them.
"""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from raytwin.compare.report import Part
from raytwin.image import BACKGROUND, Image
from raytwin.rungs import RUNGS
from raytwin.scene import Rectangle, Scene, Shape
from raytwin.speed import ENGINES, light_parts, trace

LEFT_OUT = {
    "sun's shadow": "shadow", "sky's occlusion": "occlusion", "bounce 1": "bounce 1", "bounce 2": "bounce 2",
    "bounces 3 and more": "bounce 3+",
}  # fmt: skip
"""A part of the error -> the part of the light that is missing in it."""

PIXELS, PIXELS_NUMPY, SAMPLES = 1 << 18, 1 << 13, 8
"""A larger frame's ledger is made of every k-th pixel of every k-th row; twice so many samples each."""
SEEDS = 0xA11CE, 0xB0B
"""Others than a user's, so that no picture is held against its own samples."""
SMALL = 96
"""Pixels across, when objects are taken away one by one to see what they had to do with a part."""


@dataclass(frozen=True, eq=False)
class Ledger:
    """`parts` as comparison.json has them; `pictures`: each part of the error (h, w, 3), whose sum is `error`.

    Of every `step`-th pixel.
    """

    parts: tuple[Part, ...]
    pictures: dict[str, np.ndarray]
    error: np.ndarray
    step: int


class WholeLight:
    """All light of a scene, in parts, at every `step`-th pixel; what ledgers of pictures on any rung are made from.

    Two independent halves of the samples: products of one half's error with the other's have no noise in their mean.
    `engine`: the fastest here, of ENGINES. `seconds` that the halves took.
    """

    def __init__(self, scene: Scene, engine: str, depth: int = 8) -> None:
        self.scene, self.engine, self.depth = scene, engine, depth
        w, h = scene.camera.image_size
        self.step = math.ceil(math.sqrt(w * h / (PIXELS_NUMPY if ENGINES[engine].is_numpy else PIXELS)))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        began = time.perf_counter()
        self.halves = [
            light_parts(self.thin, engine, samples=SAMPLES, seed=k, depth=depth, side=1 / self.step) for k in SEEDS
        ]
        self.seconds = time.perf_counter() - began

    @cached_property
    def partners(self) -> dict[str, np.ndarray]:
        return _partners(self.scene, self.engine, self.depth)


def make_ledger(scene: Scene, shown: Image, rung: str, engine: str, depth: int = 8) -> Ledger:
    """The parts of `shown`'s error, a picture that stands on `rung`."""
    return split_error(WholeLight(scene, engine, depth), shown, rung)


def split_error(light: WholeLight, shown: Image, rung: str) -> Ledger:
    """The parts of the error of `shown`, a picture of the light's scene that stands on `rung`."""
    scene, step, seen = light.scene, light.step, shown.mean[:: light.step, :: light.step]
    exact = None if RUNGS[rung].noisy else _exact(light.thin, rung, light.engine)
    split = [_split(seen, exact, half, rung) for half in light.halves]
    errors = [_sum(pictures.values(), seen) for pictures in split]
    squared = float((errors[0] * errors[1]).sum(dtype=float))
    whole = sum(float(part.mean.mean(dtype=float)) for half in light.halves for part in half.values()) / 2
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
                seconds=light.seconds if name in LEFT_OUT else None,
                share_of_light=float(picture.mean(dtype=float)) / whole if whole else None,
                share_of_error=along / squared if squared > 0 else None,
                noise=float(np.sqrt(np.square(one - other, dtype=float).mean())) / 2 if sampled else None,
                between=() if ids is None else _between(scene, picture, ids, partners.get(LEFT_OUT.get(name, ""))),
            )
        )
    noise = float(np.sqrt(np.square(errors[0] - errors[1], dtype=float).mean())) / 2
    rows.append(Part("noise", rmse=noise, noise=noise))
    return Ledger(tuple(rows), pictures, (errors[0] + errors[1]) / 2, step)


def _split(seen: np.ndarray, exact: np.ndarray | None, light: dict[str, Image], rung: str) -> dict[str, np.ndarray]:
    """The parts of what is seen; `exact`: its rung without error, where no samples make it."""
    lacks = RUNGS[rung].lacks
    over_area = _sum((part.mean for name, part in light.items() if not lacks(name)), seen)
    if exact is None:
        own = {"its own samples": seen - over_area}
    else:
        own = {"numerics": seen - exact, "pixel sampling": exact - over_area}
    return own | {name: -light[part].mean for name, part in LEFT_OUT.items() if lacks(part)}


def _sum(pictures: Iterable[np.ndarray], like: np.ndarray) -> np.ndarray:
    return sum(pictures, start=np.zeros_like(like))


def _exact(scene: Scene, rung: str, engine: str) -> np.ndarray:
    """The rung at each pixel's centre, in float64."""
    double = next(name for name, row in ENGINES.items() if row == ENGINES[engine]._replace(precision="float64"))
    return trace(scene, rung, double).mean


def _between(scene: Scene, picture: np.ndarray, ids: np.ndarray, partners: np.ndarray | None) -> tuple[str, ...]:
    """The object on which the part's squared error is largest, and the one that has most to do with it there."""
    energy = np.square(picture, dtype=float).sum(axis=-1)
    on = np.bincount(ids[ids > BACKGROUND], energy[ids > BACKGROUND], minlength=len(scene.objects))
    if not on.any():
        return ()
    names, most = scene.names, int(on.argmax())
    if partners is None or not partners[most].any():
        return (names[most],)
    return names[most], names[int(partners[most].argmax())]


def _partners(scene: Scene, engine: str, depth: int) -> dict[str, np.ndarray]:
    """part -> (n, n): by how much it changes on object i (row) when object j is taken away: sum of |change|.

    On a small frame, from the same random numbers, so that what does not depend on j does not change.
    """
    n, parts = len(scene.objects), LEFT_OUT.values()
    if not 2 <= n <= 8:
        return {}
    w, h = scene.camera.image_size
    small = scene.with_camera(scene.camera.resized(SMALL, max(1, round(SMALL * h / w))))
    ids = _ids(small, engine)
    before = light_parts(small, engine, samples=16, depth=depth)
    found = {part: np.zeros((n, n)) for part in parts}
    for j in range(n):
        without = msgspec.structs.replace(
            small, objects=tuple(gone(thing) if i == j else thing for i, thing in enumerate(small.objects))
        )
        after, same = light_parts(without, engine, samples=16, depth=depth), ids == _ids(without, engine)
        for part in parts:
            change = np.abs(after[part].mean - before[part].mean).sum(axis=-1)
            use = same & (ids > BACKGROUND) & (ids != j)
            found[part][:, j] = np.bincount(ids[use], change[use], minlength=n)
    return found


def _ids(scene: Scene, engine: str) -> np.ndarray:
    surface = trace(scene, "surface", engine).surface
    assert surface is not None  # the tracer always has one
    return surface.ids


def gone(thing: Shape) -> Shape:
    """The same kind of object, too small and too far below to be met."""
    far: Any = (0.0, 0.0, -1e6)
    if isinstance(thing, Rectangle):
        return msgspec.structs.replace(thing, center=far, half_u=(1e-9, 0.0, 0.0), half_v=(0.0, 1e-9, 0.0))
    return msgspec.structs.replace(thing, center=far, radius=1e-9)
