"""One submitted picture beside what is right, at chosen pixels: where it is wrong, and how well a change explains it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.grade.predict import RIGHT, Array, Bench, Steps
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, Sphere
from raytwin.scene.lens import without_ray
from raytwin.speed import trace
from raytwin.tracer import RADIANCE

WRONG, KEPT, EDGES = 700, 500, 250
"""Pixels that are looked at: of those that are wrong, those that are right, and those of them beside an outline."""
CLOSE = 3e-4
"""Of the scale: the largest error that a prediction may have and still be said to hit a value."""
DIGITS = 3e-6
"""Of the scale: what float32 rounds off."""


@dataclass(frozen=True, eq=False)
class View:
    """A submission's picture of one scene.

    `shown` (H, W, 3): linear radiance, or with `points` where each pixel's ray first meets a sphere, NaN for none.
    `right`: what it should be; the tracer's own picture where none is given. `half` (H, W, 3): what its format may have
    rounded off; `clipped`: it holds nothing above 1.
    """

    scene: Scene
    shown: Array
    right: Array | None = None
    rung: str = "shadow"
    points: bool = False
    half: Array | None = None
    clipped: bool = False


@dataclass(eq=False)
class Sight:
    """A view at N chosen pixels, weighted so that they stand for all.

    `shown`, `right` (N, 3); `slack` (N, 3): what rounding may do; `scale`: of the values; `tau`: an error of this size
    is one. `extra` (H, W, 3): light that no formula of the tracer gives, None where there is none. `wrong`, `edge`: (N,).
    """

    view: View
    index: Array
    weight: Array
    shown: Array
    right: Array
    slack: Array
    scale: float
    tau: float
    wrong: Array
    edge: Array
    bench: Bench
    noisy: bool
    moved: dict[Any, Array] = field(default_factory=dict)

    def predict(self, steps: Steps) -> Array:
        """(N, 3): what would be shown."""
        with np.errstate(all="ignore"):
            if self.view.points:
                return self.bench.points(steps)
            light = self.bench.radiance(steps)
            if self.noisy:
                light = light + self.beyond(steps)
            made = np.asarray(steps.output(light, self.bench.brightest), float)
        return np.clip(made, 0, 1) if self.view.clipped else made

    def beyond(self, steps: Steps) -> Array:
        """Light of the right picture that sun, shadow and open sky do not make, at the places that the steps look at."""
        if steps.place not in self.moved:
            alone = RIGHT._replace(place=steps.place)
            height, width = self.view.shown.shape[:2]
            u, v = (np.rint(x).astype(int) for x in steps.place(self.bench.u, self.bench.v, self.bench.scene.camera))
            right = _right(self.view)[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
            self.moved[steps.place] = right - self.bench.radiance(alone)
        return self.moved[steps.place]

    def errors(self, steps: Steps) -> Array:
        """(N,): the largest error of any channel, beyond what rounding may do."""
        return self.off(self.predict(steps))

    def off(self, made: Array) -> Array:
        """The same of a prediction (N, 3)."""
        with np.errstate(invalid="ignore", over="ignore"):
            e = np.abs(self.shown - made) - self.slack
        if self.view.points:
            e = np.where(np.isnan(self.shown) & np.isnan(made), 0.0, e)
        return np.minimum(np.maximum(np.where(np.isnan(e), np.inf, e), 0).max(axis=-1), 100 * self.scale)

    def cost(self, e: Array, tau: float | None = None) -> float:
        """Σ w log(1 + (e/τ)²): minus the log likelihood of errors (N,) that are mostly small, and sometimes any."""
        return float((self.weight * np.log1p(np.square(e / (tau or self.tau)))).sum())

    def squared(self, made: Array) -> float:
        """The mean squared error of a prediction (N, 3), in units of the scale."""
        with np.errstate(invalid="ignore", over="ignore"):
            e = np.nan_to_num(self.shown - made, nan=self.scale, posinf=self.scale, neginf=-self.scale)
        if self.view.points:
            e = np.where(np.isnan(self.shown) & np.isnan(made), 0.0, e)
        e = np.maximum(np.abs(e) - self.slack, 0)
        return float((self.weight * np.square(np.minimum(e / self.scale, 10)).sum(axis=-1)).sum())

    def fewer(self, step: int) -> "Sight":
        """The same at every step-th of its pixels."""
        bench = Bench(self.bench.scene, self.bench.u[::step], self.bench.v[::step], self.bench.shadows,
                      self.bench.brightest)  # fmt: skip
        cut: dict[str, Any] = {
            name: getattr(self, name)[::step] for name in ("index", "weight", "shown", "right", "slack", "wrong", "edge")
        }
        cut["weight"] = cut["weight"] / max(cut["weight"].sum(), 1e-300)
        return replace(self, **cut, bench=bench, moved={})


def _right(view: View) -> Array:
    assert view.right is not None
    return view.right


def whole(view: View) -> View:
    """The view with what is right in it, in float64."""
    height, width = view.scene.camera.height, view.scene.camera.width
    shown = np.asarray(view.shown)
    if shown.shape != (height, width, 3) or shown.dtype.kind not in "fiu":
        raise InputError("view.shown", f"an image ({height}, {width}, 3)", f"{shown.dtype} {shown.shape}")
    right = view.right
    if view.points:
        view = replace(view, scene=_of_spheres(view.scene))
        if right is None:
            v, u = np.indices((height, width), float).reshape(2, -1)
            right = Bench(view.scene, u, v).points(RIGHT).reshape(height, width, 3)
    elif right is None:
        if view.rung not in RADIANCE or not RUNGS[view.rung].lit:
            raise InputError("view.right", f"a reference, on the rung {view.rung}", "none")
        right = trace(view.scene, view.rung, "numpy64").mean
    right = np.asarray(right, float)
    if right.shape != shown.shape:
        raise InputError("view.right", f"an image {shown.shape}", f"{right.shape}")
    return replace(view, shown=shown.astype(float), right=np.clip(right, 0, 1) if view.clipped else right)


def _of_spheres(scene: Scene) -> Scene:
    return msgspec.structs.replace(scene, objects=tuple(x for x in scene.objects if isinstance(x, Sphere)))


def look(view: View, seed: int = 0) -> Sight:
    """Choose pixels: all kinds of wrong ones, and right ones that a wrong cause would spoil."""
    view = whole(view)
    right, shown = _right(view), view.shown
    height, width = shown.shape[:2]
    scale = _scale(view)
    half = np.zeros(shown.shape) if view.half is None else view.half
    with np.errstate(invalid="ignore"):
        e = np.abs(shown - right) - half
    if view.points:
        e = np.where(np.isnan(shown) & np.isnan(right), 0.0, e)
    e = np.maximum(np.where(np.isnan(e), np.inf, e), 0).max(axis=-1)
    lost = without_ray(view.scene.camera)
    if lost is not None:
        e[lost] = 0
    noisy = not view.points and RUNGS[view.rung].noisy
    tau = CLOSE * scale
    large = e[e > tau]
    if not large.size:  # all errors are small ones: look closer
        large = e[e > DIGITS * scale]
    typical = float(np.median(large)) if large.size else 0.0
    tau = float(np.clip(0.03 * typical, DIGITS * scale, tau))
    wrong = e > tau
    edge = _outlines(view.scene)
    use = np.ones(e.shape, bool) if lost is None else ~lost
    rng = np.random.default_rng(seed)
    chosen, weights = [], []
    for mask, most in ((wrong, WRONG), (~wrong & ~edge & use, KEPT), (~wrong & edge & use, EDGES)):
        there = np.flatnonzero(mask)
        if there.size:
            n = min(most, there.size)
            # One of each of n runs: spread over the picture, without a grid's beat.
            at = (np.arange(n) + rng.random(n)) * there.size // n
            chosen.append(there[at.astype(int)])
            weights.append(np.full(n, there.size / n))
    index, weight = np.concatenate(chosen), np.concatenate(weights)
    mixed = rng.permutation(index.size)
    index, weight = index[mixed], weight[mixed] / weight.sum()
    u, v = (index % width).astype(float), (index // width).astype(float)
    brightest = float(np.nanmax(right)) if right.size and not view.points else 1.0
    bench = Bench(view.scene, u, v, view.points or RUNGS[view.rung].shadows, brightest)
    flat = lambda x: x.reshape(-1, 3)[index]  # noqa: E731
    return Sight(
        view, index, weight, flat(shown), flat(right), flat(half), scale, tau, wrong.ravel()[index],
        edge.ravel()[index], bench, noisy,
    )  # fmt: skip


def _scale(view: View) -> float:
    right = _right(view)
    if view.points:
        found = np.linalg.norm(right - np.array(view.scene.camera.eye), axis=-1)
        return float(np.nanmedian(found)) if np.isfinite(found).any() else 1.0
    positive = right[np.isfinite(right) & (right > 0)]
    return float(np.quantile(positive, 0.99)) if positive.size else 1.0


def _outlines(scene: Scene) -> Array:
    """(H, W) bool: within two pixels of where another object begins."""
    surface = trace(scene, "surface", "numpy64").surface
    assert surface is not None
    ids = surface.ids
    beside = np.zeros(ids.shape, bool)
    for k in (1, 2):
        across, down = ids[:, k:] != ids[:, :-k], ids[k:] != ids[:-k]
        beside[:, k:] |= across
        beside[:, :-k] |= across
        beside[k:] |= down
        beside[:-k] |= down
    return beside


def many(views: Sequence[View], seed: int = 0) -> list[Sight]:
    return [look(view, seed) for view in views]
