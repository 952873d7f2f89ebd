"""Lambert's law under sun and open sky: L = albedo/π E max(0, n·l) + albedo Lₛ."""

from collections.abc import Callable
from typing import Any

import numpy as np

from raytwin.contract.stage import Arrays, Case, Function, Stage, Variant, before, unit
from raytwin.tracer import lambert


def shade(points: Any, normals: Any, albedo: Any, to_light: Any, irradiance: Any, sky: Any) -> Any:
    """The radiance (N, 3) of each point: albedo / pi * irradiance * max(0, n·l) + albedo * sky.

    points: (N, 3), metres; the sun is so far away that they do not matter.
    normals: (N, 3), unit, on the side from which the point is seen.
    albedo: (N, 3), or (3,) for all points.
    to_light: (3,), unit, from the surface to the sun.
    irradiance: (3,), what a surface that faces the sun receives.
    sky: (3,), the sky's radiance, the same in every direction.
    """
    n, to_sun = tuple(np.asarray(normals, float).T), tuple(to_light)
    channels = np.broadcast_to(albedo, np.shape(normals)).T
    L = [lambert(a, n, to_sun, E, 1.0, s) for a, E, s in zip(channels, irradiance, sky, strict=True)]
    return np.stack(L, axis=-1)


def cases(seed: int) -> list[Case]:
    """24 points of each kind, with numbers that make every factor show."""
    rng = np.random.default_rng(seed)
    to_light = unit(rng.uniform([0.2, -0.8, 0.5], [0.8, -0.2, 0.9]))
    E, sky = rng.uniform([2.0, 2.6, 3.2], [2.4, 3.0, 3.8]), rng.uniform([0.1, 0.2, 0.3], [0.15, 0.26, 0.4])
    normals = unit(rng.normal(size=(200, 3)))
    cosine = normals @ to_light
    lit, away = normals[(cosine > 0.15) & (cosine < 0.9)][:24], normals[cosine < -0.1][:24]
    points, each, one = rng.uniform(-0.2, 0.2, (24, 3)), rng.uniform(0.1, 0.95, (24, 3)), rng.uniform(0.2, 0.9, 3)
    dark = np.zeros(3)
    drawn = (
        ("surfaces that face the sun, no sky", (points, lit, each, to_light, E, dark)),
        ("the sky alone", (points, lit, each, to_light, dark, sky)),
        ("surfaces that face the sun", (points, lit, each, to_light, E, sky)),
        ("surfaces turned away from the sun", (points, away, each, to_light, E, sky)),
        ("one albedo for all", (points, np.concatenate([lit[:12], away[:12]]), one, to_light, E, sky)),
        ("one point", (points[:1], lit[:1], each[:1], to_light, E, sky)),
        ("light brighter than 1", (points, lit, each, to_light, 4 * E, 3 * sky)),
    )
    return [Case(shows, args, (shade(*args),)) for shows, args in drawn]


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """|L - L₀| by the largest L₀ of the case."""
    return np.asarray(np.abs(got[0] - expected[0]) / np.abs(expected[0]).max())


def hint(expected: Arrays, got: Arrays) -> str:
    n = len(expected[0])
    return {
        (n,): "one number a point is returned: red, green and blue are wanted",
        (n, 1): "one number a point is returned: red, green and blue are wanted",
        (3, n): "colours belong on the last axis: (N, 3)",
        (n, n): "(N,) and (N, 1) were multiplied to (N, N): keep the cosine as (N, 1), and sum over the last axis only",
        (3,): "one colour is returned for all points: one a point is wanted",
    }.get(got[0].shape, "") if got else ""  # fmt: skip


# ------------------------------------------------------------------------------------------ typical mistakes


def _terms(change: Callable[..., Any]) -> Callable[[Function], Function]:
    """Of `change(albedo, n·l, irradiance, sky)`."""

    def wrong(points: Any, normals: Any, albedo: Any, to_light: Any, irradiance: Any, sky: Any) -> Any:
        return change(np.asarray(albedo), (normals @ to_light)[:, None], np.asarray(irradiance), np.asarray(sky))

    return lambda f: wrong


def _lamp(p: Any, n: Any, a: Any, to_light: Any, E: Any, sky: Any) -> Any:
    """to_light taken for the place of a lamp."""
    cosine = np.maximum(0, (n * unit(to_light - p)).sum(-1))
    return a / np.pi * E * cosine[:, None] + a * sky


def _lit(c: Any) -> Any:
    return np.maximum(0, c)


def _bounded(L: Any) -> Any:
    return np.clip(L, 0, 1)


VARIANTS = (
    Variant("no clamp", "n·l is not clamped: where a surface is turned away from the sun, max(0, n·l) is 0",
            _terms(lambda a, c, E, s: a / np.pi * E * c + a * s)),
    Variant("|n·l|", "|n·l| is used where max(0, n·l) is wanted: a surface turned away gets no sun",
            _terms(lambda a, c, E, s: a / np.pi * E * np.abs(c) + a * s)),
    Variant("half Lambert", "the cosine is (n·l + 1) / 2: Lambert's law has max(0, n·l)",
            _terms(lambda a, c, E, s: a / np.pi * E * (c + 1) / 2 + a * s)),
    Variant("squared cosine", "the cosine is squared", _terms(lambda a, c, E, s: a / np.pi * E * _lit(c) ** 2 + a * s)),
    Variant("clamped at the end", "the sum is clamped, not the cosine: max(0, n·l) comes first, then the sky is added",
            _terms(lambda a, c, E, s: np.maximum(0, a / np.pi * E * c + a * s))),
    Variant("no cosine", "the cosine is left out: the sun's part is albedo / pi * E * max(0, n·l)",
            _terms(lambda a, c, E, s: a / np.pi * E * (c > 0) + a * s)),
    Variant("light reversed", "the light comes from the wrong side: to_light points from the surface to the sun",
            before(lambda p, n, a, d, E, s: (p, n, a, -d, E, s))),
    Variant("lamp for sun", "to_light is taken for the place of a lamp: it is a direction, the same at every point",
            lambda f: _lamp),
    Variant("albedo missing", "the albedo is missing in the sun's part", _terms(lambda a, c, E,
            s: E / np.pi * _lit(c) + a * s)),
    Variant("sky without albedo", "the albedo is missing in the sky's part: it is albedo * sky",
            _terms(lambda a, c, E, s: a / np.pi * E * _lit(c) + s + 0 * a)),
    Variant("albedo missing", "the albedo is missing in both parts", _terms(lambda a, c, E,
            s: E / np.pi * _lit(c) + s)),
    Variant("albedo squared", "the albedo is multiplied twice",
            before(lambda p, n, a, d, E, s: (p, n, a * a, d, E, s))),
    Variant("missing pi", "the sun's part is pi times too bright: albedo / pi * E * max(0, n·l)",
            _terms(lambda a, c, E, s: a * E * _lit(c) + a * s)),
    Variant("pi multiplied", "the sun's part is multiplied by pi: it is divided by it",
            _terms(lambda a, c, E, s: a * np.pi * E * _lit(c) + a * s)),
    Variant("pi twice", "the sun's part is divided by pi twice", _terms(lambda a, c, E,
            s: a / np.pi**2 * E * _lit(c) + a * s)),
    Variant("2 pi", "the sun's part is divided by 2 pi: it is divided by pi",
            _terms(lambda a, c, E, s: a / (2 * np.pi) * E * _lit(c) + a * s)),
    Variant("pi in the sky", "the sky's part is divided by pi: a sky of radiance Ls gives irradiance pi Ls, so pi "
            "cancels",
            _terms(lambda a, c, E, s: a / np.pi * E * _lit(c) + a / np.pi * s)),
    Variant("pi in the sky", "the sky's part is multiplied by pi: it is albedo * sky",
            _terms(lambda a, c, E, s: a / np.pi * E * _lit(c) + a * np.pi * s)),
    Variant("no sky", "the sky's part, albedo * sky, is missing",
            before(lambda p, n, a, d, E, s: (p, n, a, d, E, 0 * s))),
    Variant("no sun", "the sun's part is missing", before(lambda p, n, a, d, E, s: (p, n, a, d, 0 * E, s))),
    Variant("sky twice", "the sky is added twice", before(lambda p, n, a, d, E, s: (p, n, a, d, E, 2 * s))),
    Variant("sky only in the dark", "the sky is added only where the sun does not shine: it is added everywhere",
            _terms(lambda a, c, E, s: np.where(c > 0, a / np.pi * E * c, a * s))),
    Variant("sky only in the sun", "the sky is added only where the sun shines: it is added everywhere",
            _terms(lambda a, c, E, s: (c > 0) * (a / np.pi * E * c + a * s))),
    Variant("sky times the cosine", "the sky is multiplied by the cosine, too: only the sun is",
            _terms(lambda a, c, E, s: _lit(c) * (a / np.pi * E + a * s))),
    Variant("irradiance left out", "the irradiance is left out: the sun's part is albedo / pi * E * max(0, n·l)",
            before(lambda p, n, a, d, E, s: (p, n, a, d, (np.asarray(E) != 0) * 1.0, s))),
    Variant("grey light", "the sun's colour is lost: irradiance has one number a channel",
            before(lambda p, n, a, d, E, s: (p, n, a, d, 0 * E + np.mean(E), s))),
    Variant("clipped at 1", "radiance is cut off at 1: it has no upper bound", lambda f: lambda *x: _bounded(f(*x))),
    Variant("gamma", "a gamma of 1/2.2 is applied: radiance is linear", lambda f: lambda *x: _lit(f(*x)) ** (1 / 2.2)),
    Variant("BGR", "red and blue are swapped", lambda f: lambda *x: f(*x)[:, ::-1]),
)  # fmt: skip

STAGE = Stage(shade, ("radiance",), cases, errors, 1e-5, "of the brightest", VARIANTS, hint=hint)
