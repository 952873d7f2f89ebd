"""A submitted picture beside what is right, at chosen pixels: where it is wrong, how well a change explains it."""

import functools
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np
from scipy import ndimage

from raytwin.diagnose.predict import RIGHT, Array, Pipeline, Predictor, UnknownScene, output
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.lens import without_ray
from raytwin.tracer import RADIANCE, trace

WRONG, RIGHT_ONES, EDGES = 700, 500, 250
"""Pixels that are looked at: of those that are wrong, those that are right, and those of them beside an outline."""
MET = 4_000_000
"""Most pixels times objects; a scene with more objects is sampled at fewer pixels."""
CLOSE = 3e-4
"""Share of the scale: the largest error of a prediction that counts as a match."""
GRID = 100_000
"""Pixels: of larger pictures, only every k-th pixel of every k-th row is sampled."""
SPOT = 4
"""Pixels of the largest spot that counts as a speckle."""
DIGITS = 3e-6
"""Share of the scale that float32 rounds off."""


Sampled = Callable[[int], Mapping[str, tuple[Array, Array]]]
"""k -> parts of the light (h, w, 3) at every k-th pixel, each twice, from independent samples."""


@dataclass(frozen=True, eq=False)
class SubmittedImage:
    """A submission's picture of one scene; of None, where nobody knows which.

    `shown` (H, W, 3): linear radiance, or with `points` where each pixel's ray first meets a sphere, NaN for none.
    `right`: what it should be; the tracer's own picture where none is given. `half` (H, W, 3): what its format may have
    rounded off; `clipped`: it holds nothing above 1. `bounds`: between which two pictures what is stored as `right` may
    lie. `sampled`: of the scene's light what chance finds. `composed`: made of the submission's stages, where the order
    along a ray is ours.
    """

    scene: Scene | None
    shown: Array
    right: Array | None = None
    rung: str = "shadow"
    points: bool = False
    half: Array | None = None
    clipped: bool = False
    sampled: Sampled | None = None
    composed: bool = False
    bounds: tuple[Array, ...] = ()


@dataclass(eq=False)
class PixelSample:
    """A view at N chosen pixels, weighted so that they stand for all.

    `shown`, `right` (N, 3); `slack` (N, 3): what rounding may do; `scale`: of the values; `tau`: an error of this size
    is one. `wrong`, `edge`: (N,). `more`: the right picture has light that sun, shadow and open sky do not make;
    `whole`: (H, W) bool, the outlines, and where a ray belongs to a pixel; `mixed`: how speckled
    the wrong pixels are, 0 to 1. `made`: last predictions.
    """

    view: SubmittedImage
    index: Array
    weight: Array
    shown: Array
    right: Array
    slack: Array
    scale: float
    tau: float
    wrong: Array
    edge: Array
    bench: Predictor | UnknownScene
    more: bool
    step: int
    whole: tuple[Array, Array]
    mixed: float = 0.0
    moved: dict[Pipeline, Array] = field(default_factory=dict, init=False)
    made: list[tuple[Pipeline, Array]] = field(default_factory=list, init=False)

    def predict(self, pipeline: Pipeline) -> Array:
        """(N, 3): what would be shown; NaN where slips do not go with what else is changed."""
        for key, made in self.made:
            if key is pipeline:
                return made
        try:
            made = self._predict(pipeline)
        except Exception:  # a slip may ask for what is not there
            if not pipeline:
                raise
            made = np.full(self.shown.shape, np.nan)
        self.made[:] = [*self.made[-3:], (pipeline, made)]
        return made

    def _predict(self, pipeline: Pipeline) -> Array:
        if self.view.composed:
            pipeline = tuple(step for step in pipeline if not _of_order(*step))
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if self.view.points and isinstance(self.bench, Predictor):
                return self.bench.points(pipeline)
            light = self.bench.radiance(pipeline)
            if self.more:
                light = light + self.beyond(pipeline)
            made = self._stored(pipeline, light)
            if isinstance(self.bench, UnknownScene) and self.bench.bounds:
                ends = [made, *(self._stored(pipeline, end.radiance(pipeline)) for end in self.bench.ends)]
                made = np.clip(self.shown, np.min(ends, axis=0), np.max(ends, axis=0))
        return made

    def _stored(self, pipeline: Pipeline, light: Array) -> Array:
        """What the image's format holds of the values that are handed in."""
        made = output(pipeline, light, self.bench.brightest)
        if made.shape != self.shown.shape:
            raise ValueError(made.shape)
        return np.clip(made, 0, 1) if self.view.clipped else made

    def beyond(self, pipeline: Pipeline) -> Array:
        """Light of the right picture that sun, shadow and open sky do not make, where the tracer looks."""
        places = tuple(step for step in pipeline if step[0] == "pixel")
        if places not in self.moved:
            height, width = _right(self.view).shape[:2]
            u, v = (np.rint(x / self.step).astype(int) for x in self.bench.place(places))
            right = _right(self.view)[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
            self.moved[places] = right - self.bench.radiance(places)
        return self.moved[places]

    def errors(self, steps: Pipeline) -> Array:
        """(N,): the largest error of any channel, beyond what rounding may do."""
        return self.off(self.predict(steps))

    def off(self, made: Array) -> Array:
        """The same of a prediction (N, 3)."""
        with np.errstate(invalid="ignore", over="ignore"):
            e = np.abs(self.shown - made) - self.slack
        if self.view.points:
            e = np.where(np.isnan(self.shown) & np.isnan(made), 0.0, e)
        return np.minimum(np.maximum(np.where(np.isnan(e), np.inf, e), 0).max(axis=-1), 100 * self.scale)

    def cost(self, e: Array) -> float:
        """Σ w log(1 + (e/τ)²): minus the log likelihood of errors (N,) that are mostly small, and sometimes any."""
        return float((self.weight * np.log1p(np.square(e / self.tau))).sum())

    def squared(self, made: Array) -> float:
        """The mean squared error of a prediction (N, 3), in units of the scale."""
        with np.errstate(invalid="ignore", over="ignore"):
            e = np.nan_to_num(self.shown - made, nan=self.scale, posinf=self.scale, neginf=-self.scale)
        if self.view.points:
            e = np.where(np.isnan(self.shown) & np.isnan(made), 0.0, e)
        e = np.maximum(np.abs(e) - self.slack, 0)
        return float((self.weight * np.square(np.minimum(e / self.scale, 10)).sum(axis=-1)).sum())

    def everywhere(self, most: int) -> "PixelSample":
        """The same at all of its pixels; at every k-th, where those are more than `most`."""
        edge, rays = self.whole
        index = np.flatnonzero(rays)
        index = index[:: max(1, -(-index.size // most))]
        shown, right, slack = (x.reshape(-1, 3)[index] for x in (self.view.shown, _right(self.view), _half(self.view)))
        v, u = (self.step * x.astype(float) for x in np.divmod(index, edge.shape[1]))
        weight = np.full(index.size, 1 / max(index.size, 1))
        made = replace(self, index=index, weight=weight, shown=shown, right=right, slack=slack)
        made = replace(made, bench=self.bench.at(u, v), edge=edge.ravel()[index])
        return replace(made, wrong=made.errors(RIGHT) > self.tau)

    def only(self, part: Any) -> "PixelSample":
        """The same at some of its pixels: a slice, or (N,) bool."""
        bench = self.bench.at(self.bench.u[part], self.bench.v[part])
        cut: dict[str, Any] = {
            name: getattr(self, name)[part] for name in ("index", "weight", "shown", "right", "slack", "wrong", "edge")
        }
        cut["weight"] = cut["weight"] / max(cut["weight"].sum(), 1e-300)
        return replace(self, **cut, bench=bench)


def _of_order(name: str, what: Any) -> bool:
    """Whether a step says which hit is seen first."""
    return name == "nearest" or (name == "met" and isinstance(what, tuple) and "nearest(" in what[0][0])


def _right(view: SubmittedImage) -> Array:
    assert view.right is not None
    return view.right


def _half(view: SubmittedImage) -> Array:
    """What the format may have rounded off, 0 where it rounds nothing."""
    return np.zeros(view.shown.shape) if view.half is None else view.half


def thinned(view: SubmittedImage) -> tuple[SubmittedImage, int, Array, Array]:
    """Every step-th pixel, in float64, with what is right; the step; outlines and pixels with a ray (H, W)."""
    if view.scene is None:
        return _unknown(view)
    camera = view.scene.camera
    shown = np.asarray(view.shown)
    if shown.shape != (camera.height, camera.width, 3) or shown.dtype.kind not in "fiu":
        expected = f"an image ({camera.height}, {camera.width}, 3)"
        raise InputError("view.shown", expected, f"{shown.dtype} {shown.shape}")
    if view.right is not None and np.shape(view.right) != shown.shape:
        raise InputError("view.right", f"an image {shown.shape}", f"{np.shape(view.right)}")
    if not view.points and view.right is None and (view.rung not in RADIANCE or not RUNGS[view.rung].lit):
        raise InputError("view.right", f"a reference, on the rung {view.rung}", "none")
    scene = _of_spheres(view.scene) if view.points else view.scene
    step = math.ceil(math.sqrt(camera.width * camera.height / GRID))
    thin = scene.with_camera(camera.every(step))
    traced = traced_once(thin, view.rung if view.rung in RADIANCE and RUNGS[view.rung].lit else "lambert")
    assert traced.surface is not None
    half, right = view.half, view.right
    cut = slice(None, None, step)
    if right is not None:
        right = np.asarray(right, float)[cut, cut]
    elif view.points:
        v, u = np.indices(traced.surface.ids.shape, float).reshape(2, -1)
        right = Predictor(thin, u, v).points(RIGHT).reshape(*traced.surface.ids.shape, 3)
    else:
        right = traced.mean.astype(float)
    right = np.clip(right, 0, 1) if view.clipped else right
    lost = without_ray(camera)
    rays = np.ones(right.shape[:2], bool) if lost is None else ~lost[cut, cut]
    half = None if half is None else half[cut, cut]
    made = replace(view, scene=scene, shown=shown[cut, cut].astype(float), right=right, half=half)
    return made, step, outlines(traced.surface.ids), rays


@functools.lru_cache(maxsize=16)
def traced_once(scene: Scene, rung: str) -> Image:
    """Return the tracer's picture, computed once for all that are compared with it."""
    return trace(scene, rung)


def _unknown(view: SubmittedImage) -> tuple[SubmittedImage, int, Array, Array]:
    """The same of a picture whose scene is not known."""
    shown, right = np.asarray(view.shown), np.asarray(view.right)
    if view.right is None or right.shape != shown.shape or shown.ndim != 3:
        raise InputError("view.right", f"an image {shown.shape}", f"{None if view.right is None else right.shape}")
    none = np.zeros(shown.shape[:2], bool)
    return replace(view, shown=shown.astype(float), right=right.astype(float)), 1, none, ~none


def _of_spheres(scene: Scene) -> Scene:
    return msgspec.structs.replace(scene, planes=())


def look(view: SubmittedImage, seed: int = 0) -> PixelSample:
    """Choose pixels: all kinds of wrong ones, and right ones that a wrong cause would spoil."""
    view, step, edge, rays = thinned(view)
    right, shown = _right(view), view.shown
    width = shown.shape[1]
    scale = _scale(view)
    low, high = (np.clip(x, 0, 1) if view.clipped else x for x in view.bounds or (right, right))
    with np.errstate(invalid="ignore"):
        e = np.abs(shown - np.clip(shown, low, high)) - _half(view)
    if view.points:
        e = np.where(np.isnan(shown) & np.isnan(right), 0.0, e)
    e = np.maximum(np.where(np.isnan(e), np.inf, e), 0).max(axis=-1) * rays
    tau = CLOSE * scale
    large = e[e > tau]
    if large.size < 1e-4 * e.size:  # errors are small ones: look closer
        large = e[e > DIGITS * scale]
    typical = float(np.median(large)) if large.size else 0.0
    tau = float(np.clip(0.03 * typical, DIGITS * scale, tau))
    if view.scene is not None and RUNGS[view.rung].noisy:
        tau = max(tau, 0.3 * typical)
    wrong = e > tau
    rng = np.random.default_rng(seed)
    objects = len(view.scene.objects) if view.scene else 0
    fewer = max(1, (WRONG + RIGHT_ONES + EDGES) * objects // MET)
    chosen, weights = [], []
    for mask, most in ((wrong, WRONG), (~wrong & ~edge & rays, RIGHT_ONES), (~wrong & edge & rays, EDGES)):
        there = np.flatnonzero(mask)
        if there.size:
            n = min(max(most // fewer, 1), there.size)
            # One of each of n runs: spread over the picture, without a grid's beat.
            at = (np.arange(n) + rng.random(n)) * there.size // n
            chosen.append(there[at.astype(int)])
            weights.append(np.full(n, there.size / n))
    index, weight = np.concatenate(chosen), np.concatenate(weights)
    mixed = rng.permutation(index.size)
    index, weight = index[mixed], weight[mixed] / weight.sum()
    u, v = (index % width * step).astype(float), (index // width * step).astype(float)
    brightest = float(np.nanmax(right)) if right.size and not view.points else 1.0
    bench: Predictor | UnknownScene = UnknownScene(right, u, v, brightest, view.bounds)
    if view.scene is not None:
        shadows = view.points or RUNGS[view.rung].shadows
        bench = Predictor(view.scene, u, v, shadows, brightest)
    flat = lambda x: x.reshape(-1, 3)[index]  # noqa: E731
    more = False
    if not view.points and view.scene is not None:
        with np.errstate(all="ignore"):
            alone = bench.radiance(RIGHT)
        beyond = np.abs((np.clip(alone, 0, 1) if view.clipped else alone) - flat(right)).max(axis=-1)
        more = RUNGS[view.rung].noisy or float((weight * (beyond > 0.01 * scale)).sum()) > 0.02
    return PixelSample(
        view, index, weight, flat(shown), flat(right), flat(_half(view)), scale, tau, wrong.ravel()[index],
        edge.ravel()[index], bench, more, step, (edge, rays), _mixed(wrong),
    )  # fmt: skip


def _mixed(wrong: Array) -> float:
    """Of the pixels (H, W) beside one of the other sort, wrong or correct, the share in spots of at most SPOT pixels.

    About .2 where chance decides, whether few pixels are wrong or most, and near 0 for regions, however large.
    """
    spots = np.zeros(wrong.shape, bool)
    beside = np.zeros(wrong.shape, bool)
    for one in (wrong, ~wrong):
        labels = ndimage.label(one)[0]
        sizes = np.bincount(labels.ravel())
        spots |= one & (sizes <= SPOT)[labels]
        beside |= one & ndimage.binary_dilation(~one)
    return float((spots & beside).sum() / max(beside.sum(), 1))


def _scale(view: SubmittedImage) -> float:
    right = _right(view)
    if view.points:
        assert view.scene is not None
        found = np.linalg.norm(right - np.array(view.scene.camera.eye), axis=-1)
        return float(np.nanmedian(found)) if np.isfinite(found).any() else 1.0
    positive = right[np.isfinite(right) & (right > 0)]
    positive = np.minimum(positive, 1) if view.clipped else positive
    return float(np.quantile(positive, 0.99)) if positive.size else 1.0


def outlines(ids: Array) -> Array:
    """(H, W) bool: within two pixels of where another object begins."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(ids, 2, mode="edge"), (5, 5))
    across, down = (beside != ids[..., None] for beside in (windows[..., 2, :], windows[..., :, 2]))
    return np.asarray((across | down).any(axis=-1))
