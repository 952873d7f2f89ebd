"""A submitted picture beside the correct one, at chosen pixels: where it is wrong, how well a change explains it."""

import functools
import math
import warnings
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np
from scipy import ndimage

from raytwin.explain.predict import NO_MISTAKE, Array, Pipeline, Predictor, UnknownScene, output, steps_of
from raytwin.images.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.lens import without_ray
from raytwin.tracer import RADIANCE, trace

MAX_WRONG, MAX_CORRECT, MAX_OUTLINE = 700, 500, 250
"""Pixels sampled per picture: wrong ones, correct ones, and correct ones beside an outline."""
PIXELS_BY_OBJECTS = 500_000
"""Upper limit of pixels times objects: scenes with more objects are sampled at fewer pixels."""
MATCH_WITHIN = 3e-4
"""Share of the scale: the largest error of a prediction that counts as a match."""
MAX_PIXELS_UNTHINNED = 100_000
"""Pixels: of larger pictures, only every k-th pixel of every k-th row is sampled."""
SPECKLE_PIXELS = 4
"""Pixels of the largest spot that counts as a speckle."""
FLOAT32_DIGITS = 3e-6
"""Share of the scale that float32 rounds off."""
NEAR_OUTLINE = (np.arange(5) == 2) | (np.arange(5) == 2)[:, None]
"""Pixels within two of another, along rows and columns: an outline lies beside it where they show several objects."""


@dataclass(frozen=True, eq=False)
class SubmittedImage:
    """A submission's picture of one scene, None where the scene is not known.

    `shown` (H, W, 3): linear radiance. With `points`: where each pixel's ray first meets a sphere, NaN for a miss.
    `correct` (H, W, 3): what it should be, by default the tracer's own picture. `half` (H, W, 3): the largest error by
    the file's format. `clipped`: the format holds nothing above 1. `bounds`: the darkest and the brightest picture that
    are stored as `correct`. `composed`: a picture by our tracer with the submission's functions in it, so that the
    camera's pose and the depth order are ours.
    """

    scene: Scene | None
    shown: Array
    correct: Array | None = None
    rung: str = "shadow"
    points: bool = False
    half: Array | None = None
    clipped: bool = False
    composed: bool = False
    bounds: tuple[Array, ...] = ()

    def stored(self, values: Array) -> Array:
        """What its format holds of these values."""
        return np.clip(values, 0, 1) if self.clipped else values


@dataclass(frozen=True, eq=False)
class Frame:
    """A view at every `step`-th pixel, in float64.

    `correct`, `slack` (H, W, 3): the correct picture, and the largest error by rounding. (H, W): `edge`, pixels beside
    an outline; `rays`, pixels that the lens gives a ray; `wrong`. `scale`: the size of the values. `tau`: errors from
    this size on count.
    """

    view: SubmittedImage
    step: int
    correct: Array
    slack: Array
    edge: Array
    rays: Array
    scale: float
    tau: float = 0.0
    wrong: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(eq=False)
class PixelSample:
    """A frame at N chosen pixels, with weights by which they stand for all.

    `more`: the correct picture has light beyond sun, shadow and open sky, such as bounces. `moved`: that light, by how
    the rays are changed. `made`: the latest predictions.
    """

    frame: Frame
    index: Array
    weight: Array
    more: bool = False
    moved: dict[Pipeline, Array] = field(default_factory=dict, init=False)
    made: list[tuple[Pipeline, Array]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        frame = self.frame
        self.view, self.scale, self.tau, self.step = frame.view, frame.scale, frame.tau, frame.step
        self.shown, self.correct, self.slack = (self.at(x) for x in (self.view.shown, frame.correct, frame.slack))
        self.wrong, self.edge = self.at(frame.wrong), self.at(frame.edge)
        v, u = (self.step * x.astype(float) for x in np.divmod(self.index, frame.edge.shape[1]))
        brightest = 1.0 if self.view.points else float(np.nanmax(frame.correct, initial=0.0))
        self.bench: Predictor | UnknownScene
        if self.view.scene is None:
            low_and_high = (np.asarray(x, float) for x in self.view.bounds)
            self.bench = UnknownScene((frame.correct, *low_and_high), u, v, brightest)
        else:
            shadows = self.view.points or RUNGS[self.view.rung].shadows
            self.bench = Predictor(self.view.scene, u, v, shadows, brightest)

    def at(self, picture: Array) -> Array:
        """The values (N, ...) of a picture (H, W, ...) of the frame."""
        return picture.reshape(-1, *picture.shape[2:])[self.index]

    def predict(self, pipeline: Pipeline) -> Array:
        """Predict the picture (N, 3). NaN where the changes of the pipeline exclude one another."""
        for key, made in self.made:
            if key is pipeline:
                return made
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made = self._predict(pipeline)
        except Exception:  # a slip may ask for what is not there
            if not pipeline:
                raise
            made = np.full(self.shown.shape, np.nan)
        self.made[:] = [*self.made[-3:], (pipeline, made)]
        return made

    def _predict(self, pipeline: Pipeline) -> Array:
        if isinstance(self.bench, UnknownScene):
            made, *bounds = (self._stored(pipeline, light) for light in self.bench.radiances(pipeline))
            ends = [made, *bounds]
            return np.clip(self.shown, np.min(ends, axis=0), np.max(ends, axis=0)) if bounds else made
        if self.view.composed:
            pipeline = tuple(step for step in pipeline if not _is_ours(*step))
        if self.view.points:
            return self.bench.points(pipeline)
        light = self.bench.radiance(pipeline)
        return self._stored(pipeline, light + self._beyond(pipeline, self.bench) if self.more else light)

    def _stored(self, pipeline: Pipeline, light: Array) -> Array:
        made = self.view.stored(output(pipeline, light, self.bench.brightest))
        if made.shape != self.shown.shape:
            raise ValueError(made.shape)
        return made

    def _beyond(self, pipeline: Pipeline, bench: Predictor) -> Array:
        """Light of the correct picture beyond sun, shadow and open sky, at the pixels that the changed camera sees."""
        places = steps_of(pipeline, "pixel")
        if places not in self.moved:
            height, width = self.frame.edge.shape
            u, v = (np.rint(x / self.step).astype(int) for x in bench.place(places))
            there = self.frame.correct[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
            self.moved[places] = there - bench.radiance(places)
        return self.moved[places]

    def errors(self, steps: Pipeline) -> Array:
        """(N,): the largest error of any channel, beyond rounding."""
        return self.off(self.predict(steps))

    def off(self, made: Array) -> Array:
        """(N,): the same errors, of a prediction (N, 3)."""
        return np.minimum(_error(self.shown, made, self.slack, self.view.points), 100 * self.scale)

    def cost(self, e: Array) -> float:
        """Σ w log(1 + (e/τ)²): minus the log likelihood of errors (N,) that are mostly small and rarely of any size."""
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
        """The sample with all pixels of the frame, or every k-th if there are more than `most`."""
        index = np.flatnonzero(self.frame.rays)
        index = index[:: max(1, -(-index.size // most))]
        return replace(self, index=index, weight=np.full(index.size, 1 / max(index.size, 1)))

    def only(self, part: Any) -> "PixelSample":
        """The sample with a part of its pixels: a slice, or (N,) bool."""
        weight = self.weight[part]
        return replace(self, index=self.index[part], weight=weight / max(weight.sum(), 1e-300))


def _is_ours(name: str, what: Any) -> bool:
    """Whether a step changes what is ours in a composed tracer: the camera's pose, and which hit is seen first."""
    return name in ("to_board", "nearest") or (name == "met" and isinstance(what, tuple) and "nearest(" in what[0][0])


def _error(shown: Array, made: Array, slack: Array, points: bool) -> Array:
    """The largest error of any channel (...,) beyond the slack. NaN: infinite, or 0 if both points are NaN."""
    with np.errstate(invalid="ignore", over="ignore"):
        e = np.abs(shown - made) - slack
    if points:
        e = np.where(np.isnan(shown) & np.isnan(made), 0.0, e)
    return np.maximum(np.where(np.isnan(e), np.inf, e), 0).max(axis=-1)


def mixed(wrong: Array) -> float:
    """Return how speckled a mask (H, W) of wrong pixels is: about 0.2 if chance decides, near 0 for whole regions.

    Of the pixels at a border between wrong and correct, it is the share in spots of at most SPECKLE_PIXELS.
    """
    spots, beside = np.zeros(wrong.shape, bool), np.zeros(wrong.shape, bool)
    for one in (wrong, ~wrong):
        labels = ndimage.label(one)[0]
        spots |= one & (np.bincount(labels.ravel()) <= SPECKLE_PIXELS)[labels]
        beside |= one & ndimage.binary_dilation(~one)
    return float((spots & beside).sum() / max(beside.sum(), 1))


@functools.lru_cache(maxsize=16)
def traced_once(scene: Scene, rung: str) -> Image:
    """Return the tracer's picture, computed once for all that are compared with it."""
    return trace(scene, rung)


def _frame(view: SubmittedImage) -> Frame:
    """Every step-th pixel of the view, with what is correct there."""
    shown, none = np.asarray(view.shown, float), np.zeros(view.shown.shape[:2], bool)
    slack = np.zeros(shown.shape) if view.half is None else view.half
    if view.scene is None:
        assert view.correct is not None
        return Frame(replace(view, shown=shown), 1, np.asarray(view.correct, float), slack, none, ~none, 1.0)
    camera, scene = view.scene.camera, view.scene
    if view.points:
        scene = msgspec.structs.replace(scene, planes=())
    step = math.ceil(math.sqrt(camera.width * camera.height / MAX_PIXELS_UNTHINNED))
    cut = slice(None, None, step), slice(None, None, step)
    thin = scene.with_camera(camera.every(step))
    traced = traced_once(thin, view.rung if view.rung in RADIANCE and RUNGS[view.rung].lit else "lambert")
    assert traced.surface is not None
    ids = traced.surface.ids
    if view.correct is not None:
        correct = np.asarray(view.correct, float)[cut]
    elif view.points:
        v, u = np.indices(ids.shape, float).reshape(2, -1)
        correct = Predictor(thin, u, v).points(NO_MISTAKE).reshape(*ids.shape, 3)
    else:
        correct = traced.mean.astype(float)
    most, least = ndimage.maximum_filter, ndimage.minimum_filter
    edge = most(ids, footprint=NEAR_OUTLINE, mode="nearest") != least(ids, footprint=NEAR_OUTLINE, mode="nearest")
    lost = without_ray(camera)
    rays = ~none[cut] if lost is None else ~lost[cut]
    made = replace(view, scene=scene, shown=shown[cut])
    return Frame(made, step, view.stored(correct), slack[cut], edge, rays, 1.0)


def sample_pixels(view: SubmittedImage, seed: int = 0) -> PixelSample:
    """Choose pixels: all kinds of wrong ones, and correct ones that a wrong cause would spoil."""
    frame = _frame(view)
    view, scale = frame.view, _scale(frame)
    low, high = map(view.stored, view.bounds or (frame.correct, frame.correct))
    with np.errstate(invalid="ignore"):
        nearest = np.clip(view.shown, low, high)
    e = _error(view.shown, nearest, frame.slack, view.points) * frame.rays
    tau = MATCH_WITHIN * scale
    large = e[e > tau]
    if large.size < 1e-4 * e.size:  # all errors are small: use a smaller threshold
        large = e[e > FLOAT32_DIGITS * scale]
    typical = float(np.median(large)) if large.size else 0.0
    tau = float(np.clip(0.03 * typical, FLOAT32_DIGITS * scale, tau))
    if view.scene is not None and RUNGS[view.rung].noisy:
        tau = max(tau, 0.3 * typical)
    wrong, edge, rays = e > tau, frame.edge, frame.rays
    rng = np.random.default_rng(seed)
    objects = len(view.scene.objects) if view.scene else 0
    fewer = max(1, (MAX_WRONG + MAX_CORRECT + MAX_OUTLINE) * objects // PIXELS_BY_OBJECTS)
    chosen, weights = [], []
    for mask, most in (
        (wrong, MAX_WRONG),
        (~wrong & ~edge & rays, MAX_CORRECT),
        (~wrong & edge & rays, MAX_OUTLINE),
    ):
        there = np.flatnonzero(mask)
        if there.size:
            n = min(max(most // fewer, 1), there.size)
            # One pixel from each of n runs: spread over the picture, without the aliasing of a grid.
            at = (np.arange(n) + rng.random(n)) * there.size // n
            chosen.append(there[at.astype(int)])
            weights.append(np.full(n, there.size / n))
    index, weight = np.concatenate(chosen), np.concatenate(weights)
    order = rng.permutation(index.size)
    sample = PixelSample(replace(frame, scale=scale, tau=tau, wrong=wrong), index[order], weight[order] / weight.sum())
    return replace(sample, more=_has_more(sample))


def _has_more(sample: PixelSample) -> bool:
    """Whether the correct picture has light that the textbook's tracer does not make."""
    view = sample.view
    if view.points or not isinstance(sample.bench, Predictor):
        return False
    beyond = np.abs(view.stored(sample.bench.radiance()) - sample.correct).max(axis=-1) > 0.01 * sample.scale
    return RUNGS[view.rung].noisy or float((sample.weight * beyond).sum()) > 0.02


def _scale(frame: Frame) -> float:
    """The size of the values: the 99 % quantile of radiance, or the points' median distance from the eye."""
    correct = frame.correct
    if frame.view.points:
        assert frame.view.scene is not None
        found = np.linalg.norm(correct - np.array(frame.view.scene.camera.eye), axis=-1)
        return float(np.nanmedian(found)) if np.isfinite(found).any() else 1.0
    positive = frame.view.stored(correct[np.isfinite(correct) & (correct > 0)])
    return float(np.quantile(positive, 0.99)) if positive.size else 1.0
