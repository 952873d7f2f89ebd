"""The search: the simplest of the fastest ways that meet the tolerance, and why what is cheaper does not.

A few pixels are looked at first: every k-th of every k-th row, each with its own area, so that edges and textures count
as much among them as in the whole frame. They tell what may do; what is left is timed at full size, all in turns.
"""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from raytwin.analysis.ledger import LEFT_OUT
from raytwin.analysis.recommend.bounds import Bounds
from raytwin.analysis.recommend.converged import MOST_SAMPLES, SURE, Error, Truth, converge
from raytwin.analysis.recommend.recommendation import Row
from raytwin.compare.sequential import PER_OCTAVE, look_level
from raytwin.compare.significance import quantile
from raytwin.errors import MachineError
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.subject_renderers import Filled, PathTraced, Speculated, Supersampled, Traced, mean_of_shifts
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.speed import ENGINES, TRIMS, light_parts, trace, walk

DEEP, BOUNCES = 16, 4
"""The whole light's depth, counted as a rung's; the bounces that are told apart, the last with all that follow."""

PIXELS, PIXELS_NUMPY = 1 << 15, 1 << 12
"""Pixels of the first, coarse look: with compiled engines, with NumPy."""

FIRST = 8, 2
"""Samples of each half to begin with: of a few pixels, of the whole frame."""

MOST_WALKS, MOST_WALKS_NUMPY = 1 << 27, 1 << 21
"""A half of the truth has no more in all, and what is verified an eighth."""

ROUNDS, PATIENCE, TIE = 5, 1.5, 1.1
"""Timed calls per candidate, seconds for the timing of all, and the ratio of times that counts as a tie."""

OUT_OF_RACE = 2.0
"""A candidate slower than the fastest by this factor is not timed again."""

LONG, FINAL = 1.0, 4.0
"""Seconds: what is expected to take longer than the first at full size is verified on every k-th pixel, and its time is
scaled up; the choice is verified at full size too where that takes no longer than the second."""

LOOKS_RATE = 0.05
"""The probability that looks before the last are wrong, all together."""

GRIDS = 4, 16, 64, 256
"""Rays per pixel that are tried where a formula gives the light."""

STEPS = 8, 4
"""Every how many-th pixel is traced, where the others are guessed."""


@dataclass(eq=False)
class Tried:
    """A method, while it is looked at. `guess`: seconds at full size."""

    method: Renderer
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
        """Return the shortest time, which a busy machine distorts least."""
        return min(self.seconds, default=self.guess)

    @property
    def spread(self) -> float:
        return float(np.subtract(*np.quantile(self.seconds, (0.75, 0.25)))) if self.seconds else 0.0

    def row(self, reason: str) -> Row:
        m, e = self.method, self.error
        depth = m.depth if isinstance(m, PathTraced) else None
        engine = getattr(m, "engine", "numpy32")
        return Row(
            "none" if isinstance(m, Filled) else m.rung, 2 if depth is None and m.noisy else depth, engine, m.precision,
            m.sampling, m.samples, m.step, m.trim, m.name, e and e.value, e and e.most, self.pixels,
            self.median or None, self.spread if self.seconds else None, len(self.seconds), reason,
        )  # fmt: skip


def simplicity(method: Renderer) -> tuple[object, ...]:
    """Less is simpler: light, depth, rays, guesses; an engine and boxes that need less explaining."""
    light = 0 if isinstance(method, Filled) else list(RUNGS).index(method.rung)
    engine = list(ENGINES).index(getattr(method, "engine", "numpy64"))
    trim = ("none", "conic", "corners").index(method.trim or "none")  # the last may cut what is seen
    depth = (method.depth or 0) if isinstance(method, PathTraced) else 0
    return light, depth, method.samples, method.step, engine, trim


class Search:
    """What is known of a scene, and every way that was tried: `low`, all light at every `step`-th pixel."""

    def __init__(self, scene: Scene, tolerance: float, metric: str, engine: str) -> None:
        self.scene, self.tolerance, self.metric, self.engine = scene, tolerance, metric, engine
        slow = ENGINES[engine].is_numpy
        self.bounds = Bounds(scene)
        w, h = scene.camera.image_size
        self.frame = w * h
        self.step = math.ceil(math.sqrt(self.frame / (PIXELS_NUMPY if slow else PIXELS)))
        self.thin = scene.with_camera(scene.camera.every(self.step))
        self.pixels = self.thin.camera.width * self.thin.camera.height
        self.most = MOST_WALKS_NUMPY if slow else MOST_WALKS
        self.low = converge(self.parts, metric, tolerance / 3, self.pixels, FIRST[0], self.most)
        self.low = replace(self.low, sampled=self.step > 1)
        self._full: Truth | None = None
        self.meet: list[Tried] = []
        self.fail: list[Tried] = []

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

        def whole(samples: int, seed: int) -> dict[str, np.ndarray]:
            image = walk(self.scene, "path", self.engine, samples=samples, seed=seed, depth=DEEP, surface=False)
            return {"whole": image.mean}

        if self._full is None:
            self._full = converge(whole, self.metric, self.tolerance / 3, self.frame, FIRST[1], self.most)
        return self._full

    def choose(self) -> tuple[Row | None, tuple[Row, ...], str]:
        """The simplest of the fastest that meet the tolerance; the others, the next cheaper first; in words."""
        self._one_ray()
        if not self.meet:
            self._many_rays()
        while self.meet and not self._confirmed(best := self._fastest()):
            self.meet.remove(best)
            self.fail.append(best)
        if not self.meet:
            near = max(self.fail, key=_rank)
            words = f"nothing that was tried is known to meet {self.tolerance:g}; nearest comes {near.method.name}"
            return None, self._rows(self.fail), f"{words}: {self._why(near)}"
        slower = sorted((m for m in self.meet if m is not best), key=lambda m: m.median)
        cheaper = sorted((f for f in self.fail if simplicity(f.method) < simplicity(best.method)), key=_rank)[::-1]
        others = [f for f in self.fail if f not in cheaper]
        words = f"{self.metric} {best.error.value:.2g} <= {self.tolerance:g}" if best.error else ""
        return best.row(words), (*self._rows(cheaper + others), *(m.row(_slower(m, best)) for m in slower)), ""

    def _rows(self, tried: list[Tried]) -> tuple[Row, ...]:
        return tuple(one.row(self._why(one)) for one in tried)

    def _confirmed(self, best: Tried) -> bool:
        """At full size too, where that has not been looked at and takes no more than FINAL seconds."""
        if best.pixels != 1 and best.median <= FINAL:
            self._look(best)
        return self._meets(best)

    def _why(self, tried: Tried) -> str:
        """Return why it was rejected."""
        e = tried.error
        if e is None:
            return "not tried"
        if e.least <= self.tolerance:
            return f"{self.metric} {e.value:.2g}, which cannot be told from {self.tolerance:g}"
        return f"{self.metric} {e.value:.2g} > {self.tolerance:g}{self._lacks(tried.method, e.value)}"

    def _lacks(self, method: Renderer, value: float) -> str:
        """Return the part of the light whose absence costs most, or else what remains as the cause of its error."""
        if isinstance(method, Filled):
            return ": no object is drawn"
        depth = method.depth if isinstance(method, PathTraced) else None
        left = [name for name in self.low.parts[0] if RUNGS[method.rung].lacks(name, depth)]
        if method.noisy and self.low.of(self.metric, *left).value < 0.7 * value:
            return ": noise"
        errors = {name: self.low.of(self.metric, name).value for name in left}
        worst = max(errors, key=errors.__getitem__, default="")
        if worst and errors[worst] > self.tolerance / 2:
            names = {part: name for name, part in LEFT_OUT.items()}
            return f": without {names.get(worst, worst)} alone {errors[worst]:.2g}"
        few = "too few rays per pixel" if method.sampling == "area" else "a ray through the centre is not the pixel"
        return f": {few}"

    def _meets(self, tried: Tried) -> bool:
        return tried.error is not None and tried.error.most <= self.tolerance

    def _sort_in(self, tried: Tried) -> bool:
        """Note whether it meets the tolerance."""
        meets = self._meets(tried)
        (self.meet if meets else self.fail).append(tried)
        return meets

    def _look(self, tried: Tried, whole: bool = True) -> bool:
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
            tried.error, tried.pixels = self.low.error(few, self.metric), self.pixels / self.frame
        return True

    # ---------------------------------------------------------------------------- one ray a pixel, or less

    def _one_ray(self) -> None:
        """Fill, lambert and shadow at the pixels' centres; then other engines, boxes and guesses of what meets."""
        for method in (Filled(), Traced("lambert", self.engine), Traced("shadow", self.engine)):
            filled = isinstance(method, Filled)
            image = method(self.thin).mean if filled else trace(self.thin, method.rung, self.engine).mean
            tried = Tried(method, 0.0, self.low.error(image, self.metric), self.pixels / self.frame)
            if tried.error is not None and tried.error.least <= self.tolerance:
                self._look(tried)
            if self._sort_in(tried):
                for variant in () if filled else self._variants(method):
                    if self._look(other := Tried(variant, 0.0), whole=False):
                        self._sort_in(other)
                return

    def _variants(self, traced: Renderer) -> Iterable[Renderer]:
        package = ENGINES[self.engine].package
        engines = [name for name, row in ENGINES.items() if row.package in ("numpy", package)]
        yield from (Traced(traced.rung, name) for name in engines if name != self.engine)
        yield from (Traced(traced.rung, self.engine, name) for name in TRIMS if name != traced.trim)
        guessing = dict.fromkeys((self.engine, "numpy32"))
        yield from (Speculated(traced.rung, engine, n=n) for engine in guessing for n in STEPS)

    # ---------------------------------------------------------------------------- many rays

    def _many_rays(self) -> None:
        """Try the candidates from the cheapest up, until one meets the tolerance and the next would cost more."""
        queue = [*self._grids(), *self._walks()]
        while queue:
            tried = queue.pop(min(range(len(queue)), key=lambda i: queue[i].guess))
            method = tried.method
            if self.meet and tried.guess > min(m.median for m in self.meet) * TIE:
                continue  # it would cost more
            self._verify(tried)
            meets = self._sort_in(tried)
            if isinstance(method, PathTraced) and meets:
                self._fewer(tried, method)
            elif isinstance(method, PathTraced) and 2 * method.samples <= MOST_SAMPLES:
                queue.append(Tried(replace(method, samples=2 * method.samples), 2 * tried.guess))

    def _grids(self) -> Iterable[Tried]:
        """Several rays a pixel where a formula gives the light: the fewest that may do, and what fails before."""
        for rung in ("lambert", "shadow"):
            names = [name for name in self.low.parts[0] if RUNGS[rung].lacks(name)]
            if self.low.of(self.metric, *names).least > self.tolerance:
                continue
            for n in GRIDS:
                steps = (((np.arange(round(n**0.5)) + 0.5) / round(n**0.5) - 0.5) / self.step).tolist()
                began = time.perf_counter()
                image = mean_of_shifts(self.thin, rung, self.engine, [(x, y) for y in steps for x in steps])
                guess = (time.perf_counter() - began) * self.frame / self.pixels
                error = self.low.error(image, self.metric)
                if error.least <= self.tolerance:
                    yield Tried(Supersampled(rung, self.engine, n), guess, error, self.pixels / self.frame)
                if error.most <= self.tolerance:
                    break

    def _walks(self) -> Iterable[Tried]:
        """Light that is followed: for each depth the samples that bring noise and what is left out to the tolerance."""
        variance, a_sample = self.low.sample_noise(), self._seconds_a_sample()
        seen = np.abs(self.low.mean).mean(dtype=float) or 1.0
        for depth in (2, 3, 4, 5, DEEP):
            left = [name for name in self.low.parts[0] if RUNGS["path"].lacks(name, depth)]
            bias = self.low.of(self.metric, *left) if left else Error(0.0, 0.0, 0.0)
            if bias.most > self.tolerance:
                continue
            relative = self.metric == "relmse"
            room = self.tolerance - bias.most if relative else self.tolerance**2 - bias.most**2
            guessed = variance / max(room, 1e-30) / (max(seen**2, 0.01) if relative else 1.0)
            if not guessed <= MOST_SAMPLES:
                continue
            samples = 1 << max(0, math.ceil(math.log2(max(guessed / 4, 1.0))))  # a sequence does better
            rung, deep = ("sky", None) if depth == 2 else ("path", depth)
            method = PathTraced(rung, self.engine, samples, depth=deep)
            yield Tried(method, samples * a_sample * (0.8 + 0.2 * depth / DEEP))
            if bias.most <= self.tolerance / 10:
                break  # what is deeper would save no samples

    def _seconds_a_sample(self) -> float:
        """Return the whole frame's seconds per sample, timed in a second call, since the first one compiles."""
        for _ in range(2):
            began = time.perf_counter()
            walk(self.thin, "path", self.engine, samples=16, depth=DEEP, side=1 / self.step, surface=False)
        return (time.perf_counter() - began) / 16 * self.frame / self.pixels

    def _fewer(self, tried: Tried, method: PathTraced) -> None:
        """Halve the samples until the tolerance is no longer met: the next cheaper variant is then known to fail."""
        known = {t.method for t in self.fail}
        while method.samples > 1 and (method := replace(method, samples=method.samples // 2)) not in known:
            half = Tried(method, tried.guess * method.samples / tried.method.samples)
            self._verify(half)
            if not self._sort_in(half):
                return

    def _verify(self, tried: Tried) -> None:
        """Its error: at full size; where that would take long, at more and more of the pixels until it is certain.

        Looks before the last ask for more standard errors, as those of a SequentialComparison do.
        """
        method = tried.method
        if tried.guess <= LONG or not isinstance(method, PathTraced):
            self._look(tried)
            return
        last = math.ceil(math.sqrt(method.samples * self.pixels / self.most))
        for look, times in enumerate((4 * last, 2 * last, last)):
            few = self.scene.with_camera(self.scene.camera.every(self.step * times))
            image = walk(
                few, method.rung, self.engine, sampling=method.over, samples=method.samples, seed=1, depth=method.depth,
                side=1 / (self.step * times), surface=False,
            )  # fmt: skip
            early = float(quantile(look_level(LOOKS_RATE, 2 * PER_OCTAVE * look), math.inf))
            truth = self.low.every(times)
            tried.error = truth.error(image.mean, self.metric, errors=SURE if times == last else early)
            tried.pixels = few.camera.width * few.camera.height / self.frame
            if not tried.error.least <= self.tolerance < tried.error.most:
                return

    def _fastest(self) -> Tried:
        """Timed in turns: each is called ROUNDS times, or as often as there is time; the simplest of a tie."""
        meet, timed = self.meet, [(m, m.call) for m in self.meet if m.call is not None]
        until = time.perf_counter() + PATIENCE
        for turn in range(ROUNDS):
            for m, call in timed[:: 1 if turn % 2 == 0 else -1]:
                least = min((x.median for x, _ in timed if x.seconds), default=math.inf)
                lost = bool(m.seconds) and min(m.seconds) > OUT_OF_RACE * least
                if not lost and (time.perf_counter() < until or turn < 3):
                    m.seconds = (*m.seconds, _timed(call, 1))
        for m in meet:
            if m.call is None and isinstance(m.method, PathTraced):
                m.guess = self._scaled(m.method, m.guess)
        slack = TIE * min(m.least for m in meet)
        return min((m for m in meet if m.least <= slack), key=lambda m: simplicity(m.method))

    def _scaled(self, method: PathTraced, guess: float) -> float:
        """The seconds at full size, by the median of three calls with fewer samples."""
        fewer = max(1, min(method.samples, int(method.samples * LONG / 4 / guess)))
        call = replace(method, samples=fewer).prepare(self.scene)
        call(0)  # it compiles
        return float(np.median([_timed(call, seed) for seed in range(3)])) * method.samples / fewer


def _timed(call: Call, seed: int) -> float:
    began = time.perf_counter()
    call(seed)
    return time.perf_counter() - began


def _rank(tried: Tried) -> float:
    """The least error is what was cheaper by least."""
    return -tried.error.value if tried.error else -math.inf


def _slower(tried: Tried, best: Tried) -> str:
    ratio = tried.median / best.median if best.median else math.inf
    if ratio <= TIE:
        return "meets it too in about the same time, but is no simpler"
    return f"meets it too, but takes {ratio:.2g} times as long"
