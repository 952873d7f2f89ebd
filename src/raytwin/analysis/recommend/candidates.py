"""What may meet a tolerance, by what the few pixels that were looked at tell."""

import math
import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from raytwin.analysis.recommend.converged import MOST_SAMPLES, Error
from raytwin.analysis.recommend.probe_pixels import DEEP, Look
from raytwin.analysis.recommend.trial import Tried
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.subject_renderers import PathTraced, Supersampled, Traced, mean_of_shifts
from raytwin.rungs import RUNGS
from raytwin.speed import ENGINES, TRIMS, walk


def variants(look: Look, traced: Traced) -> Iterable[Renderer]:
    package = ENGINES[look.engine].package
    engines = [name for name, row in ENGINES.items() if row.package in ("numpy", package)]
    yield from (replace(traced, engine=name) for name in engines if name != traced.engine)
    yield from (replace(traced, trim=name) for name in TRIMS if name != traced.trim)


def grids(look: Look) -> Iterable[Tried]:
    """Several rays a pixel where a formula gives the light: the fewest that may do, and what fails before."""
    for rung in ("lambert", "shadow"):
        names = [name for name in look.low.parts[0] if RUNGS[rung].lacks(name)]
        if look.low.of(look.metric, *names).least > look.tolerance:
            continue
        for n in (4, 16, 64, 256):
            method = Supersampled(rung, look.engine, n)
            steps = ((np.arange(round(n**0.5)) + 0.5) / round(n**0.5) - 0.5) / look.step
            began = time.perf_counter()
            image = mean_of_shifts(
                look.thin, rung, look.engine, [(x, y) for y in steps.tolist() for x in steps.tolist()]
            )
            guess = (time.perf_counter() - began) * look.frame / look.pixels
            error = look.low.error(image, look.metric)
            if error.least <= look.tolerance:
                yield Tried(method, guess, error, look.pixels / look.frame)
            if error.most <= look.tolerance:
                break


def walks(look: Look) -> Iterable[Tried]:
    """Light that is followed: for each depth the samples that bring noise and what is left out to the tolerance."""
    variance = look.low.sample_noise()
    a_sample = _seconds_a_sample(look)
    seen = np.abs(look.low.mean).mean(dtype=float) or 1.0
    centered = False
    for depth in (2, 3, 4, 5, DEEP):
        left = [name for name in look.low.parts[0] if RUNGS["path"].lacks(name, depth)]
        bias = look.low.of(look.metric, *left) if left else Error(0.0, 0.0, 0.0)
        if bias.most > look.tolerance:
            continue
        room = look.tolerance**2 - bias.most**2 if look.metric != "relmse" else look.tolerance - bias.most
        guessed = variance / max(room, 1e-30) / (1.0 if look.metric != "relmse" else max(seen**2, 0.01))
        if not guessed <= MOST_SAMPLES:
            continue
        samples = 1 << max(0, math.ceil(math.log2(max(guessed / 4, 1.0))))  # a sequence does better
        method = PathTraced("sky" if depth == 2 else "path", look.engine, samples, depth=None if depth == 2 else depth)
        yield Tried(method, samples * a_sample * (0.8 + 0.2 * depth / DEEP))
        if samples > 1 and not centered and look.metric == "rmse":
            centered = True
            yield from _at_the_center(look, method, samples * a_sample)
        if bias.most <= look.tolerance / 10:
            break  # what is deeper would save no samples


def _at_the_center(look: Look, method: PathTraced, guess: float) -> Iterable[Tried]:
    """Fewer samples may do where none of them is spent on edges, at the price of the pixels' area."""
    few = 16
    image = walk(look.thin, method.rung, look.engine, sampling="center", samples=few, depth=method.depth, surface=False)
    assert image.variance is not None  # of more than one sample
    noise = float(image.variance.mean(dtype=float))
    bias = look.low.error(image.mean, look.metric).value ** 2 - noise
    if (room := look.tolerance**2 - bias) <= 0:
        return
    samples = 1 << max(0, math.ceil(math.log2(max(few * noise / room, 1.0))))
    if samples < method.samples:
        center = replace(method, over="center", samples=samples)
        yield Tried(center, guess * samples / method.samples)


def _seconds_a_sample(look: Look) -> float:
    """Return the whole frame's seconds per sample, timed in a second call, since the first one compiles."""
    for _ in range(2):
        began = time.perf_counter()
        walk(look.thin, "path", look.engine, samples=16, depth=DEEP, side=1 / look.step, surface=False)
    return (time.perf_counter() - began) / 16 * look.frame / look.pixels
