"""The choice: the simplest of the fastest that meet the tolerance, and why what is cheaper does not."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from raytwin.analysis.ledger import LEFT_OUT
from raytwin.analysis.recommend.candidates import grids, variants, walks
from raytwin.analysis.recommend.converged import MOST_SAMPLES, SURE
from raytwin.analysis.recommend.probe_pixels import Look
from raytwin.analysis.recommend.recommendation import Row
from raytwin.analysis.recommend.trial import Tried, simplicity
from raytwin.compare.sequential import PER_OCTAVE, look_level
from raytwin.compare.significance import quantile
from raytwin.errors import MachineError
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import Filled, PathTraced, Speculated, Traced
from raytwin.rungs import RUNGS
from raytwin.speed import trace, walk

ROUNDS, PATIENCE, TIE = 5, 1.5, 1.1
"""Calls timed of each, about so many seconds of them; times within this ratio are a tie."""

OUT_OF_RACE = 2.0
"""What takes so many times the fastest's seconds is called no more."""

LONG, FINAL = 1.0, 4.0
"""Seconds: what is expected to take longer than the first at full size is verified on every k-th pixel, and its time is
scaled up; the choice is verified at full size too where that takes no longer than the second."""


LOOKS_RATE = 0.05
"""The probability that looks before the last are wrong, all together."""


class Choice(Look):
    """Looking at a scene until the cheapest way is known."""

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
        cheaper = sorted((f for f in fail if simplicity(f.method) < simplicity(best.method)), key=lambda f: -_rank(f))
        others = [f for f in fail if f not in cheaper]
        words = f"{self.metric} {best.error.value:.2g} <= {self.tolerance:g}" if best.error else ""
        rows = _rows(cheaper + others, self._why) + tuple(m.row(_slower(m, best)) for m in slower)
        return best.row(words), rows, ""

    def _confirmed(self, best: Tried) -> bool:
        """At full size too, where that has not been looked at and takes no more than FINAL seconds."""
        if best.pixels != 1 and best.median <= FINAL:
            self._look(best)
        return self._meets(best)

    def _why(self, tried: Tried) -> str:
        """What stands against it."""
        e = tried.error
        if e is None:
            return "not tried"
        if e.least <= self.tolerance:
            return f"{self.metric} {e.value:.2g}, which cannot be told from {self.tolerance:g}"
        return f"{self.metric} {e.value:.2g} > {self.tolerance:g}{self._lacks(tried.method, e.value)}"

    def _lacks(self, method: Renderer, value: float) -> str:
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

    def _left_out(self, method: Renderer) -> list[str]:
        depth = method.depth if isinstance(method, PathTraced) else None
        return [name for name in self.low.parts[0] if RUNGS[method.rung].lacks(name, depth)]

    def _meets(self, tried: Tried) -> bool:
        return tried.error is not None and tried.error.most <= self.tolerance

    # ---------------------------------------------------------------------------- one ray a pixel, or less

    def _one_ray(self) -> tuple[list[Tried], list[Tried]]:
        """Fill, lambert and shadow at the pixels' centres; then speculation, engines and boxes of what meets."""
        meet: list[Tried] = []
        fail: list[Tried] = []
        first: tuple[Filled | Traced, ...] = (Filled(), Traced("lambert", self.engine), Traced("shadow", self.engine))
        for method in first:
            tried = Tried(method, 0.0)
            image = self._thinly(method)
            tried.error, tried.pixels = self.low.error(image, self.metric), self.pixels / self.frame
            if tried.error.least <= self.tolerance:
                self._look(tried)
            (meet if self._meets(tried) else fail).append(tried)
            if meet:
                break
        if meet and isinstance(meet[0].method, Traced):
            for variant in variants(self, meet[0].method):
                tried = Tried(variant, 0.0)
                if self._look(tried, whole=False):
                    (meet if self._meets(tried) else fail).append(tried)
            self._guesses(meet, fail)
        return meet, fail

    def _guesses(self, meet: list[Tried], fail: list[Tried]) -> None:
        """Every 8-th pixel traced; other steps only where that is nearly as fast as tracing all."""
        traced = meet[0]
        for engine in dict.fromkeys((self.engine, "numpy32")):
            for n in (8, 4, 16, 2):
                tried = Tried(Speculated(traced.method.rung, engine, n=n), 0.0)
                if not self._look(tried, whole=False):
                    break
                (meet if self._meets(tried) else fail).append(tried)
                seconds = [self._called(t) for t in (tried, traced)]
                if seconds[0] > 2 * seconds[1]:
                    break

    def _called(self, tried: Tried) -> float:
        """Seconds of one call more."""
        assert tried.call is not None
        began = time.perf_counter()
        tried.call(1)
        return time.perf_counter() - began

    def _thinly(self, method: Renderer) -> np.ndarray:
        if isinstance(method, Filled):
            return method(self.thin).mean
        return trace(self.thin, method.rung, self.engine).mean

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

    # ---------------------------------------------------------------------------- many rays

    def _many_rays(self) -> tuple[list[Tried], list[Tried]]:
        """From the cheapest that may do upwards, until one does and the next would cost more."""
        queue = [*grids(self), *walks(self)]
        meet: list[Tried] = []
        fail: list[Tried] = []
        while queue:
            tried = queue.pop(min(range(len(queue)), key=lambda i: queue[i].guess))
            if meet and tried.guess > min(m.median for m in meet) * TIE:
                continue  # it would cost more
            self._verify(tried)
            (meet if self._meets(tried) else fail).append(tried)
            if not isinstance(tried.method, PathTraced):
                continue
            if self._meets(tried):
                self._fewer(tried, tried.method, meet, fail)
            elif tried.method.over == "area" and 2 * tried.method.samples <= MOST_SAMPLES:
                queue.append(Tried(replace(tried.method, samples=2 * tried.method.samples), 2 * tried.guess))
        return meet, fail

    def _fewer(self, tried: Tried, method: PathTraced, meet: list[Tried], fail: list[Tried]) -> None:
        """Half the samples, and half again, until they no longer do: the next cheaper is known to fail."""
        tested = {t.method for t in fail}
        while method.samples > 1 and (method := replace(method, samples=method.samples // 2)) not in tested:
            half = Tried(method, tried.guess * method.samples / tried.method.samples)
            self._verify(half)
            (meet if self._meets(half) else fail).append(half)
            if not self._meets(half):
                break
        if (between := replace(method, samples=method.samples * 3 // 2)).samples not in (method.samples, 1):
            middle = Tried(between, tried.guess * between.samples / tried.method.samples)
            self._verify(middle)
            (meet if self._meets(middle) else fail).append(middle)

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

    def _fastest(self, meet: list[Tried]) -> Tried:
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
            if m.call is None and isinstance(m.method, PathTraced):
                m.guess = self._scaled(m.method, m.guess)
        slack = TIE * min(m.least for m in meet)
        return min((m for m in meet if m.least <= slack), key=lambda m: simplicity(m.method))

    def _scaled(self, method: PathTraced, guess: float) -> float:
        """The seconds at full size, by the median of three calls with fewer samples."""
        fewer = max(1, min(method.samples, int(method.samples * LONG / 4 / guess)))
        call, seconds = replace(method, samples=fewer).prepare(self.scene), []
        call(0)  # it compiles
        for seed in range(3):
            began = time.perf_counter()
            call(seed)
            seconds.append(time.perf_counter() - began)
        return float(np.median(seconds)) * method.samples / fewer


def _rank(tried: Tried) -> float:
    """The least error is what was cheaper by least."""
    return -tried.error.value if tried.error else -math.inf


def _rows(tried: list[Tried], why: Callable[[Tried], str]) -> tuple[Row, ...]:
    return tuple(t.row(why(t)) for t in tried)


def _slower(tried: Tried, best: Tried) -> str:
    ratio = tried.median / best.median if best.median else math.inf
    if ratio <= TIE:
        return "meets it too in about the same time, but is no simpler"
    return f"meets it too, but takes {ratio:.2g} times as long"
