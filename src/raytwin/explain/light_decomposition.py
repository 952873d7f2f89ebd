"""An image of unknown origin, as the light it is made of: image = Σ factor · part, each factor fitted, by object.

The parts: the sun that nothing hides, what its shadows take away, the sky; and where they are given, what hides the sky
and each bounce. A forgotten 1/π shows as "the sun's part is 3.142 times too bright", though in the whole the sky hides
it. Parts that were sampled are given twice, from independent samples: products of the one with the other have no noise
in their mean, so that noise does not pull factors towards 0. Bounces look alike, and would take each other's place in
the noise: the fewest factors are told that explain the image.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from raytwin.explain.parametric_faults import bright
from raytwin.explain.pixel_sample import PixelSample
from raytwin.explain.predict import Array, Predictor

PART_NAMES = {
    "sun": "the sun's part", "shadow": "what shadows take away", "sky": "the sky's part",
    "occlusion": "what hides the sky", "bounce 1": "the first bounce", "bounce 2": "the second bounce",
    "bounce 3+": "what later bounces bring", "bounce 2 on": "what all bounces but the first bring",
    "bounce 1 on": "what all bounces bring",
}  # fmt: skip
PARTS_TAKEN_AWAY = "shadow", "occlusion"
"""Parts that light is lost by."""
CORRECT_WITHIN = 0.01
"""A factor that is off by less is correct."""
FACTOR_SIGMAS = 4.0
"""Standard errors: a factor off by less is correct."""
MAX_FACTORS = 4
"""Factors, at most so many of which are told."""
LEAST_PIXELS = 10
"""Pixels of objects below which nothing is fitted."""
TOLD_FROM_SHARE = 0.9
"""FittedFactor of the error: factors that leave more of it are not reported."""
Halves = tuple[Array, Array]


@dataclass(frozen=True)
class FittedFactor:
    """On `where` (an object's name; empty: on all) the `part` has this `factor`, 1 if correct; `error`: standard."""

    where: str
    part: str
    factor: float
    error: float

    @property
    def words(self) -> str:
        name = PART_NAMES[self.part]
        if abs(self.factor) <= CORRECT_WITHIN + 3 * self.error:
            text = f"{name} is missing"
        elif self.part in PARTS_TAKEN_AWAY:
            text = f"{name} is {self.factor:.4g} times what it should be"
        else:
            text = f"{name} is {bright(self.factor)}"
        return f"{text} on {self.where}" if self.where else text


@dataclass(frozen=True)
class Split:
    """`shares`: of the parts that are wrong; `explained`: share of the squared error on objects that they explain."""

    shares: tuple[FittedFactor, ...] = ()
    explained: float = 0.0

    @property
    def words(self) -> str:
        """What is wrong, if that explains the image; else nothing."""
        wrong = [s.words for s in self.shares if abs(s.factor - 1) > max(CORRECT_WITHIN, FACTOR_SIGMAS * s.error)]
        return " and ".join(wrong) if self.explained >= TOLD_FROM_SHARE else ""


def split(sample: PixelSample, given: Mapping[str, Halves] | None = None) -> Split:
    """Split one view's light; `given`: sampled parts (H, W, 3), twice each, beside the sun, its shadow and the sky."""
    bench = sample.bench
    assert isinstance(bench, Predictor)
    if given is None and sample.view.sampled is not None:
        given = sample.view.sampled(sample.step)
    seen, scene = bench.seen(), bench.scene
    sun = seen.albedo / pi * np.array(scene.sun.irradiance) * np.maximum(seen.cos, 0)[:, None]
    dark = (seen.visible & (seen.cos > 0))[:, None] - 1.0
    own = {"sun": sun, "shadow": sun * dark, "sky": seen.albedo * np.array(scene.sky_radiance)}
    parts = {name: (part, part) for name, part in own.items()}
    parts |= {name: (sample.at(one), sample.at(other)) for name, (one, other) in (given or {}).items()}
    on_all = {"": np.ones(len(seen.ids), bool)}
    everywhere = _fewest(sample, parts, seen.ids, on_all)
    on_each = {name: seen.ids == k for k, name in enumerate(scene.names)}
    return everywhere if everywhere.words else _fewest(sample, parts, seen.ids, on_each)


def _fewest(sample: PixelSample, parts: dict[str, Halves], ids: Array, where: Mapping[str, Array]) -> Split:
    """The fewest factors g + 1 that leave no more than noise, of parts on each of these places.

    With the parts' halves x and y, and what all of them lack of the image, d and e, Σ w (d - x g)(e - y g) is least.
    Errors as far as pixels scatter, each pixel's channels as one (a sandwich). Not where outlines cross pixels.
    """
    keep = (ids >= 0) & ~sample.edge & (np.abs(sample.shown) < 1e6 * sample.scale).all(axis=-1)  # NaN is none
    if keep.sum() < LEAST_PIXELS:
        return Split()
    w, shown = sample.weight[keep, None], sample.shown[keep]
    halves = {name: (one[keep], other[keep]) for name, (one, other) in parts.items()}
    d, e = (shown - half for half in _sum(halves, list(halves)))
    halves["sun"] = _sum(halves, ["sun", "shadow"])  # a sun of another strength casts shadows of another strength
    bounces = [name for name in halves if name.startswith("bounce")]
    halves |= {f"{name} on": _sum(halves, bounces[k:]) for k, name in enumerate(bounces[:-1])}
    columns = {
        (place, part): (x * there[keep, None], y * there[keep, None])
        for part, (x, y) in halves.items() for place, there in where.items()
    }  # fmt: skip
    columns = {key: (x, y) for key, (x, y) in columns.items() if (w * x * y).sum() > 1e-8 * sample.scale**2 * w.sum()}
    before = float((w * d * e).sum())
    noise = min(float((w * np.square(sample.slack[keep] / 3)).sum()), before)
    found, left = Split(), before
    chosen: list[tuple[str, str]] = []
    while len(chosen) < MAX_FACTORS and left - noise > CORRECT_WITHIN * (before - noise):
        fits = [(*_fit(w, d, e, [columns[k] for k in (*chosen, new)]), new) for new in columns if new not in chosen]
        least, g, errors, best = min(fits, key=lambda fit: fit[0], default=(left, d, d, None))
        if best is None or not least < left or abs(g[-1]) < max(CORRECT_WITHIN, FACTOR_SIGMAS * errors[-1]):
            break
        left = least
        chosen.append(best)
        shares = (FittedFactor(*key, float(a + 1), float(b)) for key, a, b in zip(chosen, g, errors, strict=True))
        found = Split(tuple(shares), 1 - max(left - noise, 0.0) / max(before - noise, 1e-300))
    return found


def _sum(halves: Mapping[str, Halves], names: Sequence[str]) -> Halves:
    x, y = (np.sum([halves[name][k] for name in names], axis=0) for k in (0, 1))
    return x, y


def _fit(w: Array, d: Array, e: Array, columns: Sequence[Halves]) -> tuple[float, Array, Array]:
    """(what is left, g, its standard errors)."""
    X, Y = (np.stack([pair[k] for pair in columns], axis=-1) for k in (0, 1))
    A = np.einsum("nci,ncj->ij", w[..., None] * X, Y)
    A = (A + A.T) / 2
    g = np.linalg.lstsq(A, (np.einsum("nci,nc->i", X, w * e) + np.einsum("nci,nc->i", Y, w * d)) / 2, rcond=1e-9)[0]
    one, other = d - X @ g, e - Y @ g
    scores = (np.einsum("nci,nc->ni", X, w * other) + np.einsum("nci,nc->ni", Y, w * one)) / 2
    inverse = np.linalg.pinv(A)
    errors = np.sqrt(np.maximum(np.diag(inverse @ (scores.T @ scores) @ inverse.T), 0))
    return float((w * one * other).sum()), g, errors
