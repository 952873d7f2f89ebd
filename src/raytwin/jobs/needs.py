"""The cheapest way to a scene's image that meets a tolerance, by measurement; and what the scene does not need.

Held against is the whole light over the pixels' area, from random walks in two independent halves a and b. The squared
error of an image c is estimated without bias by mean((c - a)(c - b)), since their noises have nothing in common; its
standard error follows from the halves' difference. So a tolerance far below the noise of a pixel can still be told:
what meets it does so with two standard errors added.

First every k-th pixel of every k-th row is looked at, each with its own area, so that edges and textures count as much
as in the whole frame. What is left is timed at full size, all in turns, and held against the whole frame.
"""

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin import files, twin
from raytwin.compare.metrics import METRICS
from raytwin.errors import InputError, MachineError, check_one_of
from raytwin.jobs.camera import find_camera
from raytwin.jobs.ledger import LEFT_OUT
from raytwin.jobs.unneeded import STILL, Bounds, still_terms
from raytwin.jobs.whole_light import gone
from raytwin.methods.method import Call, Method
from raytwin.methods.traced import Filled, Followed, Speculated, Supersampled, Traced, fast_engine, mean_of_shifts
from raytwin.progress import Progress, silent
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.scene.record import Record
from raytwin.speed import ENGINES, TRIMS, light_parts, trace, walk

ERRORS = "rmse", "relmse", "mae", "max_abs", "p999_abs", "p999_rel"
"""Of METRICS, those that are 0 where nothing errs."""

DEEP, BOUNCES = 16, 4
"""The whole light's depth, counted as a rung's; the bounces that are told apart, the last with all that follow."""

PIXELS, PIXELS_NUMPY = 1 << 15, 1 << 12
"""So many are looked at first."""

FIRST = 8, 2
"""Samples of each half to begin with: of a few pixels, of the whole frame."""

MOST_SAMPLES, MOST_WALKS, MOST_WALKS_NUMPY = 1 << 14, 1 << 27, 1 << 21
"""Nothing has more samples a pixel; a half of the truth has no more in all, and what is verified an eighth."""

ROUNDS, PATIENCE, TIE = 5, 1.5, 1.1
"""Calls timed of each, about so many seconds of them; times within this ratio are a tie."""

OUT_OF_RACE = 2.0
"""What takes so many times the fastest's seconds is called no more."""

LONG, FINAL = 1.0, 4.0
"""Seconds: what is expected to take longer than the first at full size is verified on every k-th pixel, and its time is
scaled up; the choice is verified at full size too where that takes no longer than the second."""


class Row(Record, frozen=True):
    """One way to the image. `speculation`: every n-th pixel traced. `pixels`: the share of the frame on which the error
    was taken. `error_most`: the error and two standard errors. `calls`: timed at full size; 0: scaled from less."""

    rung: str
    depth: int | None
    engine: str
    precision: int
    sampling: str
    samples: int
    speculation: int
    trim: str | None
    method: str
    error: float | None = None
    error_most: float | None = None
    pixels: float | None = None
    seconds: float | None = None
    spread: float | None = None
    calls: int = 0
    reason: str = ""


class NotNeeded(Record, frozen=True):
    """`bound`: proven, null where nothing is; `measured`: seen. Of the metric, but for the lens, which is in pixels."""

    what: str
    why: str
    bound: float | None
    measured: float | None


class Whole(Record, frozen=True):
    """The truth: `noise` is the largest error that it cannot tell from none; `beyond`: bound of what is deeper."""

    depth: int
    samples: int
    pixels: int
    noise: float
    beyond: float | None


class Needs(Record, frozen=True):
    """The answer; `choice` is null where none meets the tolerance or it cannot be told, and `reason` says which."""

    scene: str
    tolerance: float
    metric: str
    choice: Row | None
    rejected: tuple[Row, ...]
    not_needed: tuple[NotNeeded, ...]
    truth: Whole
    reason: str
    seconds: float


class Error(NamedTuple):
    """A metric's value, and two standard errors below and above."""

    value: float
    least: float
    most: float


def measure(metric: str, one: np.ndarray, other: np.ndarray, whole: np.ndarray, sampled: bool = False) -> Error:
    """The metric of an error, of which `one` and `other` (H, W, 3) are two estimates with independent noise.

    With d their difference and m their mean the product's variance is at most m² d² + (d²/2)², the noise of the three
    channels of a pixel being taken as one; where the pixels are only `sampled` from more, it is what their products
    scatter by, if that is larger. Metrics that are no mean of squares have no such estimate: theirs is of m,
    which the noise only makes larger, and the same of d/2 says by how much.
    """
    mean, apart = (one + other) / 2, one - other
    if metric not in ("rmse", "relmse"):
        function = METRICS[metric].function
        value, noise = function(whole + mean, whole), function(whole + apart / 2, whole)
        return Error(value, max(value - noise, 0.0), value)
    if metric == "relmse":  # the same with both errors divided
        root_weight = 1 / np.sqrt(np.square(whole) + np.float32(0.01))
        one, other, mean, apart = (x * root_weight for x in (one, other, mean, apart))
    value = float((one * other).mean(dtype=float))
    per_pixel = (np.square(x[..., 0] + x[..., 1] + x[..., 2]) for x in (np.abs(mean * apart), np.square(apart) / 2))
    sigma = math.sqrt(sum(float(x.sum(dtype=float)) for x in per_pixel)) / one.size
    if sampled:
        sigma = max(sigma, float((one * other).mean(axis=-1).std(dtype=float)) / math.sqrt(one.size / one.shape[-1]))
    root = math.sqrt if metric == "rmse" else float
    return Error(*(root(max(x, 0.0)) for x in (value, value - 2 * sigma, max(value, 0.0) + 2 * sigma)))


@dataclass(frozen=True, eq=False)
class Truth:
    """The whole light in two halves, each of `samples`; `parts` of each half where they are told apart.

    `sampled`: at some of the pixels that are judged.
    """

    halves: tuple[np.ndarray, np.ndarray]
    samples: int
    parts: tuple[dict[str, np.ndarray], ...] = ()
    sampled: bool = False

    @cached_property
    def mean(self) -> np.ndarray:
        return np.asarray((self.halves[0] + self.halves[1]) / 2)

    def error(self, image: np.ndarray, metric: str, noisy: bool = False) -> Error:
        """`noisy`: another seed gives another image, whose error must be covered too."""
        one, other = (image - half for half in self.halves)
        return measure(metric, one, other, self.mean, self.sampled or noisy)

    def noise(self, metric: str) -> float:
        """The largest error that cannot be told from none."""
        a, b = self.halves
        if metric in ("rmse", "relmse"):
            return measure(metric, (a - b) / 2, (b - a) / 2, self.mean).most
        return float(METRICS[metric].function(self.mean + (a - b) / 2, self.mean))

    def of(self, metric: str, *names: str) -> Error:
        """The error of an image that lacks these parts and has all others."""
        one, other = (-sum((half[name] for name in names), np.zeros_like(self.mean)) for half in self.parts)
        return measure(metric, one, other, self.mean, self.sampled)

    def every(self, step: int) -> "Truth":
        """At every `step`-th of its pixels."""
        one, other = (np.ascontiguousarray(half[::step, ::step]) for half in self.halves)
        return Truth((one, other), self.samples, sampled=True)

    def sample_noise(self) -> float:
        """The variance of one sample a pixel, on average."""
        return float(np.square(self.halves[0] - self.halves[1], dtype=float).mean()) / 2 * self.samples


Render = Callable[[int, int], dict[str, np.ndarray]]
"""samples, seed -> parts of the whole light."""


def converge(render: Render, metric: str, enough: float, pixels: int, first: int, most: int) -> Truth:
    """Halves with as many samples as it takes to bring the noise below `enough`, or as many as may be."""

    def halves(samples: int, seed: int) -> Truth:
        parts = render(samples, seed), render(samples, seed + 1)
        one, other = (sum(half.values(), np.float32(0)) for half in parts)
        return Truth((np.asarray(one), np.asarray(other)), samples, parts)

    truth = halves(first, 1001)
    falls = 0.5 if metric != "relmse" else 1.0  # the noise is a power of the samples
    for seed in range(2001, 9001, 1000):
        missing = truth.noise(metric) / enough
        if missing <= 1:
            break
        # No more than six times as many at once: samples of a sequence often do better than chance.
        wanted = truth.samples * min(1.1 * missing ** (1 / falls), 6.0)
        wanted = int(min(wanted, MOST_SAMPLES, most // pixels)) - truth.samples
        if wanted <= 0:
            break
        truth = _together(truth, halves(wanted, seed))
    return truth


def _together(a: Truth, b: Truth) -> Truth:
    share = np.float32(b.samples / (a.samples + b.samples))

    def mixed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(x + (y - x) * share)

    one, other = (mixed(x, y) for x, y in zip(a.halves, b.halves, strict=True))
    parts = tuple({k: mixed(x[k], y[k]) for k in x} for x, y in zip(a.parts, b.parts, strict=True))
    return Truth((one, other), a.samples + b.samples, parts)


def needs_of(
    path: str | Path,
    tolerance: float,
    metric: str = "rmse",
    *,
    photo: str | None = None,
    size: tuple[int, int] | None = None,
    progress: Progress = silent,
) -> Needs:
    """What the scene at `path` needs; see `find_needs`."""
    _check(tolerance, metric)
    scene = find_camera(files.read_scene(path), photo, progress)[0]
    return find_needs(scene.with_camera(scene.camera.resized(*size)) if size else scene, tolerance, metric, progress)


def find_needs(
    scene: Scene, tolerance: float, metric: str = "rmse", progress: Progress = silent, engine: str | None = None
) -> Needs:
    """The cheapest way to the image whose error against the whole light meets `tolerance`, and what is not needed.

    `engine`: for the random walks, by default the fastest here. Raises InputError for a tolerance that is none.
    """
    _check(tolerance, metric)
    began = time.perf_counter()
    search = _Search(scene, tolerance, metric, engine or fast_engine(twin.activate().variant))
    progress("truth", 0, 1)
    noise = search.low.noise(metric)
    progress("truth", 1, 1)
    progress("candidates", 0, 1)
    choice: Row | None = None
    rejected: tuple[Row, ...] = ()
    if noise > tolerance / 3:
        reason = f"cannot tell: the truth's own noise is {noise:.2g} {metric}, more than a third of {tolerance:g}"
    else:
        choice, rejected, reason = search.choose()
    progress("candidates", 1, 1)
    whole = Whole(DEEP, 2 * search.low.samples, search.pixels, noise, search.bound(search.bounds.beyond(DEEP - 2)))
    found = _not_needed(search) if noise <= tolerance / 3 else ()
    seconds = time.perf_counter() - began
    return Needs(scene.name, tolerance, metric, choice, rejected, found, whole, reason, seconds)


def _check(tolerance: float, metric: str) -> None:
    check_one_of("--metric", metric, ERRORS)
    if not (math.isfinite(tolerance) and tolerance > 0):
        raise InputError("--tolerance", "a finite number > 0", tolerance)


@dataclass(eq=False)
class _Tried:
    """A method, while it is looked at. `guess`: seconds at full size."""

    method: Method
    guess: float
    error: Error | None = None
    pixels: float | None = None
    call: Call | None = None
    seconds: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        return float(np.median(self.seconds)) if self.seconds else self.guess

    @property
    def least(self) -> float:
        """What a busy machine makes longer least."""
        return min(self.seconds, default=self.guess)

    @property
    def spread(self) -> float:
        return float(np.subtract(*np.quantile(self.seconds, (0.75, 0.25)))) if self.seconds else 0.0

    def row(self, reason: str) -> Row:
        m, e = self.method, self.error
        depth = m.depth if isinstance(m, Followed) else None
        engine = getattr(m, "engine", "numpy32")
        return Row(
            "none" if isinstance(m, Filled) else m.rung, 2 if depth is None and m.noisy else depth, engine, m.precision,
            m.sampling, m.samples, m.step, m.trim, m.name, e and e.value, e and e.most, self.pixels,
            self.median or None, self.spread if self.seconds else None, len(self.seconds), reason,
        )  # fmt: skip


def _simplicity(method: Method) -> tuple[object, ...]:
    """Less is simpler: light, depth, rays, guesses; an engine and boxes that need less explaining."""
    light = 0 if isinstance(method, Filled) else list(RUNGS).index(method.rung)
    engine = list(ENGINES).index(getattr(method, "engine", "numpy64"))
    trim = ("none", "conic", "corners").index(method.trim or "none")  # the last may cut what is seen
    depth = (method.depth or 0) if isinstance(method, Followed) else 0
    return light, depth, method.samples, method.step, engine, trim


class _Search:
    """What is known while the scene is looked at: at every `step`-th pixel, and where needed at all."""

    def __init__(self, scene: Scene, tolerance: float, metric: str, engine: str) -> None:
        self.scene, self.tolerance, self.metric, self.engine = scene, tolerance, metric, engine
        self.slow = ENGINES[engine].is_numpy
        self.bounds = Bounds(scene)
        w, h = scene.camera.image_size
        self.step = math.ceil(math.sqrt(w * h / (PIXELS_NUMPY if self.slow else PIXELS)))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        self.pixels = self.thin.camera.width * self.thin.camera.height
        self.most = MOST_WALKS_NUMPY if self.slow else MOST_WALKS
        self.low = converge(self.parts, metric, tolerance / 3, self.pixels, FIRST[0], self.most)
        self.low = replace(self.low, sampled=self.step > 1)
        self._full: Truth | None = None
        self.sample_seconds = 0.0

    def parts(self, samples: int, seed: int, scene: Scene | None = None) -> dict[str, np.ndarray]:
        found = light_parts(
            scene or self.thin, self.engine, samples=samples, seed=seed, depth=DEEP, side=1 / self.step, bounces=BOUNCES
        )
        return {name: image.mean for name, image in found.items()}

    def bound(self, largest: float) -> float | None:
        return self.bounds.of_metric(self.metric, largest)

    @property
    def full(self) -> Truth:
        """The truth at full size, made when it is first asked for."""
        if self._full is None:
            w, h = self.scene.camera.image_size
            self._full = converge(self._whole, self.metric, self.tolerance / 3, w * h, FIRST[1], self.most)
        return self._full

    def _whole(self, samples: int, seed: int) -> dict[str, np.ndarray]:
        began = time.perf_counter()
        image = walk(self.scene, "path", self.engine, samples=samples, seed=seed, depth=DEEP, surface=False)
        self.sample_seconds = (time.perf_counter() - began) / samples  # the last is the warmest
        return {"whole": image.mean}

    def choose(self) -> tuple[Row | None, tuple[Row, ...], str]:
        """The simplest of the fastest that meet the tolerance; the others, the next cheaper first; in words."""
        meet, fail = self._one_ray()
        if not meet:
            more, failed = self._many_rays()
            meet, fail = more, fail + failed
        while meet and not self._confirmed(best := self._fastest(meet)):
            meet.remove(best)
            fail.append(best)
        if not meet:
            near = max(fail, key=_rank)
            words = f"nothing that was tried is known to meet {self.tolerance:g}; nearest comes {near.method.name}"
            return None, _rows(fail, self._why), f"{words}: {self._why(near)}"
        slower = sorted((m for m in meet if m is not best), key=lambda m: m.median)
        cheaper = sorted((f for f in fail if _simplicity(f.method) < _simplicity(best.method)), key=lambda f: -_rank(f))
        others = [f for f in fail if f not in cheaper]
        words = f"{self.metric} {best.error.value:.2g} <= {self.tolerance:g}" if best.error else ""
        told = _rows(cheaper + others, self._why) + tuple(m.row(_slower(m, best)) for m in slower)
        return best.row(words), told, ""

    def _confirmed(self, best: _Tried) -> bool:
        """At full size too, where that has not been looked at and takes no more than FINAL seconds."""
        if best.pixels != 1 and best.median <= FINAL:
            self._look(best)
        return self._meets(best)

    def _why(self, tried: _Tried) -> str:
        """What stands against it."""
        e = tried.error
        if e is None:
            return "not tried"
        if e.least <= self.tolerance:
            return f"{self.metric} {e.value:.2g}, which cannot be told from {self.tolerance:g}"
        return f"{self.metric} {e.value:.2g} > {self.tolerance:g}{self._lacks(tried.method, e.value)}"

    def _lacks(self, method: Method, value: float) -> str:
        """The part of the light that it errs by most; or else what remains to err by."""
        if isinstance(method, Filled):
            return ": no object is drawn"
        left = self._left_out(method)
        if method.noisy and self.low.of(self.metric, *left).value < 0.7 * value:
            return ": noise"
        errors = {name: self.low.of(self.metric, name).value for name in left}
        worst = max(errors, key=errors.__getitem__, default="")
        if worst and errors[worst] > self.tolerance / 2:
            names = {part: name for name, part in LEFT_OUT.items()}
            return f": without {names.get(worst, worst)} alone {errors[worst]:.2g}"
        few = "too few rays a pixel" if method.sampling == "area" else "a ray through the centre is not the pixel"
        return f": {few}"

    def _left_out(self, method: Method) -> list[str]:
        depth = method.depth if isinstance(method, Followed) else None
        return [name for name in self.low.parts[0] if RUNGS[method.rung].lacks(name, depth)]

    def _meets(self, tried: _Tried) -> bool:
        return tried.error is not None and tried.error.most <= self.tolerance

    # ---------------------------------------------------------------------------- one ray a pixel, or less

    def _one_ray(self) -> tuple[list[_Tried], list[_Tried]]:
        """Fill, lambert and shadow at the pixels' centres; then speculation, engines and boxes of what meets."""
        meet: list[_Tried] = []
        fail: list[_Tried] = []
        first: tuple[Filled | Traced, ...] = (Filled(), Traced("lambert", self.engine), Traced("shadow", self.engine))
        for method in first:
            tried = _Tried(method, 0.0)
            image = self._thinly(method)
            tried.error, tried.pixels = self.low.error(image, self.metric), self.pixels / self._frame
            if tried.error.least <= self.tolerance:
                self._look(tried)
            (meet if self._meets(tried) else fail).append(tried)
            if meet:
                break
        if meet and isinstance(meet[0].method, Traced):
            for variant in self._variants(meet[0].method):
                tried = _Tried(variant, 0.0)
                if self._look(tried, whole=False):
                    (meet if self._meets(tried) else fail).append(tried)
            self._guesses(meet, fail)
        return meet, fail

    def _guesses(self, meet: list[_Tried], fail: list[_Tried]) -> None:
        """Every 8-th pixel traced; other steps only where that is nearly as fast as tracing all."""
        traced = meet[0]
        for engine in dict.fromkeys((self.engine, "numpy32")):
            for n in (8, 4, 16, 2):
                tried = _Tried(Speculated(traced.method.rung, engine, n=n), 0.0)
                if not self._look(tried, whole=False):
                    break
                (meet if self._meets(tried) else fail).append(tried)
                seconds = [self._called(t) for t in (tried, traced)]
                if seconds[0] > 2 * seconds[1]:
                    break

    def _called(self, tried: _Tried) -> float:
        """Seconds of one call more."""
        assert tried.call is not None
        began = time.perf_counter()
        tried.call(1)
        return time.perf_counter() - began

    def _variants(self, traced: Traced) -> Iterable[Method]:
        package = ENGINES[self.engine].package
        engines = [name for name, row in ENGINES.items() if row.package in ("numpy", package)]
        yield from (replace(traced, engine=name) for name in engines if name != traced.engine)
        yield from (replace(traced, trim=name) for name in TRIMS if name != traced.trim)

    @property
    def _frame(self) -> int:
        return self.scene.camera.width * self.scene.camera.height

    def _thinly(self, method: Method) -> np.ndarray:
        if isinstance(method, Filled):
            return method(self.thin).mean
        return trace(self.thin, method.rung, self.engine).mean

    def _look(self, tried: _Tried, whole: bool = True) -> bool:
        """Its first call at full size, and its error there, or at every k-th pixel; not where the machine cannot."""
        try:
            tried.call = tried.method.prepare(self.scene)
            image = tried.call(0).mean
        except MachineError:
            return False
        if whole:
            tried.error, tried.pixels = self.full.error(image, self.metric, tried.method.noisy), 1.0
        else:
            few = np.ascontiguousarray(image[:: self.step, :: self.step])
            tried.error, tried.pixels = self.low.error(few, self.metric), self.pixels / self._frame
        return True

    # ---------------------------------------------------------------------------- many rays

    def _many_rays(self) -> tuple[list[_Tried], list[_Tried]]:
        """From the cheapest that may do upwards, until one does and the next would cost more."""
        queue = [*self._grids(), *self._walks()]
        meet: list[_Tried] = []
        fail: list[_Tried] = []
        while queue:
            tried = queue.pop(min(range(len(queue)), key=lambda i: queue[i].guess))
            if meet and tried.guess > min(m.median for m in meet) * TIE:
                continue  # it would cost more
            self._verify(tried)
            (meet if self._meets(tried) else fail).append(tried)
            if not isinstance(tried.method, Followed):
                continue
            if self._meets(tried):
                self._fewer(tried, tried.method, meet, fail)
            elif tried.method.over == "area" and 2 * tried.method.samples <= MOST_SAMPLES:
                queue.append(_Tried(replace(tried.method, samples=2 * tried.method.samples), 2 * tried.guess))
        return meet, fail

    def _grids(self) -> Iterable[_Tried]:
        """Several rays a pixel where a formula gives the light: the fewest that may do, and what fails before."""
        for rung in ("lambert", "shadow"):
            names = [name for name in self.low.parts[0] if RUNGS[rung].lacks(name)]
            if self.low.of(self.metric, *names).least > self.tolerance:
                continue
            for n in (4, 16, 64, 256):
                method = Supersampled(rung, self.engine, n)
                steps = ((np.arange(round(n**0.5)) + 0.5) / round(n**0.5) - 0.5) / self.step
                began = time.perf_counter()
                image = mean_of_shifts(
                    self.thin, rung, self.engine, [(x, y) for y in steps.tolist() for x in steps.tolist()]
                )
                guess = (time.perf_counter() - began) * self._frame / self.pixels
                error = self.low.error(image, self.metric)
                if error.least <= self.tolerance:
                    yield _Tried(method, guess, error, self.pixels / self._frame)
                if error.most <= self.tolerance:
                    break

    def _walks(self) -> Iterable[_Tried]:
        """Light that is followed: for each depth the samples that bring noise and what is left out to the tolerance."""
        variance = self.low.sample_noise()
        a_sample = self._seconds_a_sample()
        seen = np.abs(self.low.mean).mean(dtype=float) or 1.0
        centered = False
        for depth in (2, 3, 4, 5, DEEP):
            left = [name for name in self.low.parts[0] if RUNGS["path"].lacks(name, depth)]
            bias = self.low.of(self.metric, *left) if left else Error(0.0, 0.0, 0.0)
            if bias.most > self.tolerance:
                continue
            room = self.tolerance**2 - bias.most**2 if self.metric != "relmse" else self.tolerance - bias.most
            guessed = variance / max(room, 1e-30) / (1.0 if self.metric != "relmse" else max(seen**2, 0.01))
            if not guessed <= MOST_SAMPLES:
                continue
            samples = 1 << max(0, math.ceil(math.log2(max(guessed / 4, 1.0))))  # a sequence does better
            method = Followed(
                "sky" if depth == 2 else "path", self.engine, samples, depth=None if depth == 2 else depth
            )
            yield _Tried(method, samples * a_sample * (0.8 + 0.2 * depth / DEEP))
            if samples > 1 and not centered and self.metric == "rmse":
                centered = True
                yield from self._at_the_center(method, samples * a_sample)
            if bias.most <= self.tolerance / 10:
                break  # what is deeper would save no samples

    def _at_the_center(self, method: Followed, guess: float) -> Iterable[_Tried]:
        """Fewer samples may do where none of them is spent on edges, at the price of the pixels' area."""
        few = 16
        image = walk(
            self.thin, method.rung, self.engine, sampling="center", samples=few, depth=method.depth, surface=False
        )
        assert image.variance is not None  # of more than one sample
        noise = float(image.variance.mean(dtype=float))
        bias = self.low.error(image.mean, self.metric).value ** 2 - noise
        if (room := self.tolerance**2 - bias) <= 0:
            return
        samples = 1 << max(0, math.ceil(math.log2(max(few * noise / room, 1.0))))
        if samples < method.samples:
            center = replace(method, over="center", samples=samples)
            yield _Tried(center, guess * samples / method.samples)

    def _seconds_a_sample(self) -> float:
        """Of the whole frame, by a second call: the first compiles."""
        for _ in range(2):
            began = time.perf_counter()
            walk(self.thin, "path", self.engine, samples=16, depth=DEEP, side=1 / self.step, surface=False)
        return (time.perf_counter() - began) / 16 * self._frame / self.pixels

    def _fewer(self, tried: _Tried, method: Followed, meet: list[_Tried], fail: list[_Tried]) -> None:
        """Half the samples, and half again, until they no longer do: the next cheaper is known to fail."""
        tested = {t.method for t in fail}
        while method.samples > 1 and (method := replace(method, samples=method.samples // 2)) not in tested:
            half = _Tried(method, tried.guess * method.samples / tried.method.samples)
            self._verify(half)
            (meet if self._meets(half) else fail).append(half)
            if not self._meets(half):
                break
        if (between := replace(method, samples=method.samples * 3 // 2)).samples not in (method.samples, 1):
            middle = _Tried(between, tried.guess * between.samples / tried.method.samples)
            self._verify(middle)
            (meet if self._meets(middle) else fail).append(middle)

    def _verify(self, tried: _Tried) -> None:
        """Its error: at full size, or on every k-th pixel where that would take long; noise is the same everywhere."""
        method = tried.method
        if tried.guess <= LONG or not isinstance(method, Followed):
            self._look(tried)
            return
        for walks in (self.most / 8, self.most):
            times = math.ceil(math.sqrt(method.samples * self.pixels / walks))
            few = self.scene.with_camera(self.scene.camera.every(self.step * times))
            image = walk(
                few, method.rung, self.engine, sampling=method.over, samples=method.samples, seed=1, depth=method.depth,
                side=1 / (self.step * times), surface=False,
            )  # fmt: skip
            tried.error = self.low.every(times).error(image.mean, self.metric)
            tried.pixels = few.camera.width * few.camera.height / self._frame
            if times == 1 or not tried.error.least <= self.tolerance < tried.error.most:
                return

    def _fastest(self, meet: list[_Tried]) -> _Tried:
        """Timed in turns: each is called ROUNDS times, or as often as there is time; the simplest of a tie."""
        timed = [m for m in meet if m.call is not None]
        until = time.perf_counter() + PATIENCE
        for turn in range(ROUNDS):
            for m in timed[:: 1 if turn % 2 == 0 else -1]:
                least = min((x.median for x in timed if x.seconds), default=math.inf)
                lost = bool(m.seconds) and min(m.seconds) > OUT_OF_RACE * least
                if not lost and (time.perf_counter() < until or turn < 3):
                    m.seconds = (*m.seconds, self._called(m))
        for m in meet:
            if m.call is None and isinstance(m.method, Followed):
                m.guess = self._scaled(m.method, m.guess)
        slack = TIE * min(m.least for m in meet)
        return min((m for m in meet if m.least <= slack), key=lambda m: _simplicity(m.method))

    def _scaled(self, method: Followed, guess: float) -> float:
        """The seconds at full size, by the median of three calls with fewer samples."""
        fewer = max(1, min(method.samples, int(method.samples * LONG / 4 / guess)))
        call, seconds = replace(method, samples=fewer).prepare(self.scene), []
        call(0)  # it compiles
        for seed in range(3):
            began = time.perf_counter()
            call(seed)
            seconds.append(time.perf_counter() - began)
        return float(np.median(seconds)) * method.samples / fewer


def _rank(tried: _Tried) -> float:
    """The least error is what was cheaper by least."""
    return -tried.error.value if tried.error else -math.inf


def _rows(tried: list[_Tried], why: Callable[[_Tried], str]) -> tuple[Row, ...]:
    return tuple(t.row(why(t)) for t in tried)


def _slower(tried: _Tried, best: _Tried) -> str:
    ratio = tried.median / best.median if best.median else math.inf
    if ratio <= TIE:
        return "meets it too, and is no simpler for about the same seconds"
    return f"meets it too, for {ratio:.2g} times the seconds"


def _not_needed(search: _Search) -> tuple[NotNeeded, ...]:
    """Each thing alone: what lies below the tolerance by measurement, beside what is proven of it."""
    return (*_lens(search), *_light(search), *_bounces(search), *_unseen(search))


def _lens(search: _Search) -> Iterable[NotNeeded]:
    moves = still_terms(search.scene.camera)
    if moves.terms:
        why = f"without {' and '.join(moves.terms)} no pixel moves by {STILL:g} px"
        yield NotNeeded(f"distortion {', '.join(moves.terms)}", why, moves.bound, moves.measured)


def _light(search: _Search) -> Iterable[NotNeeded]:
    parts = (
        ("shadow", "shadows of the sun", search.bounds.shadow()),
        ("occlusion", "occlusion of the sky", search.bounds.occlusion()),
    )
    for part, what, largest in parts:
        error = search.low.of(search.metric, part)
        if error.most <= search.tolerance:
            yield NotNeeded(what, _below(search, error), search.bound(largest), error.value)


def _bounces(search: _Search) -> Iterable[NotNeeded]:
    names = [name for name in search.low.parts[0] if name.startswith("bounce")]
    for n in range(len(names)):
        error = search.low.of(search.metric, *names[n:])
        if error.most <= search.tolerance:
            bounds = ((k, search.bound(search.bounds.beyond(k))) for k in range(n, 1000))
            proven = next((k for k, most in bounds if most is not None and most <= search.tolerance), None)
            why = _below(search, error) + (f"; the bound alone proves it beyond {proven}" if proven is not None else "")
            what = "bounces" if n == 0 else f"bounces beyond {n}"
            yield NotNeeded(what, why, search.bound(search.bounds.beyond(n)), error.value)
            return


def _unseen(search: _Search) -> Iterable[NotNeeded]:
    """Spheres whose boxes hold no pixel, taken away one by one, from the same random numbers."""
    scene, low = search.thin, search.low
    unseen = [i for i, thing in enumerate(scene.objects) if thing in scene.spheres and not search.bounds.seen[i]][:8]
    if not unseen:
        return
    samples = min(low.samples, 64)
    before = [sum(search.parts(samples, seed).values(), np.float32(0)) for seed in (1, 2)]
    for i in unseen:
        others = tuple(gone(thing) if i == k else thing for k, thing in enumerate(scene.objects))
        without = msgspec.structs.replace(scene, objects=others)
        after = [sum(search.parts(samples, seed, without).values(), np.float32(0)) for seed in (1, 2)]
        one, other = (np.asarray(x - y) for x, y in zip(after, before, strict=True))
        error = measure(search.metric, one, other, low.mean, low.sampled)
        if error.most <= search.tolerance:
            why = f"no pixel sees it, and what it does to the light of others is {_below(search, error)}"
            yield NotNeeded(scene.names[i], why, search.bound(search.bounds.without(i)), error.value)


def _below(search: _Search, error: Error) -> str:
    return f"{search.metric} {error.value:.2g} <= {search.tolerance:g} without"
