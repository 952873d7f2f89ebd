"""The sky's occlusion by spheres: each takes (r/d)² cos θ of the light (Quilez, "Sphere ambient occlusion")."""

from collections.abc import Callable
from typing import Any

import numpy as np

from raytwin.contract.stage import Arrays, Case, Function, Stage, Variant, before


def sky_visible(points: Any, normals: Any, centers: Any, radii: Any) -> Any:
    """The share (N,) of an even sky's light that reaches each surface element past the spheres.

    1/π ∫ V max(0, n·ω) dω: a sphere of radius r at the distance d, whose centre is seen at the angle θ from the normal,
    hides (r/d)² cos θ of it, where it is wholly above the element's horizon; below it, nothing. No two spheres hide
    the same part of the sky here, and none is cut by a horizon.

    points, normals: (N, 3), metres and unit. centers: (M, 3), radii: (M,), metres.
    """
    return _share(points, normals, centers, radii, lambda s, c: s * s * np.maximum(c, 0))


def _share(points: Any, normals: Any, centers: Any, radii: Any, hidden: Callable[[Any, Any], Any]) -> np.ndarray:
    """1 - sum of `hidden(r/d, cos θ)`."""
    f = np.asarray(centers)[None] - np.asarray(points)[:, None]
    d = np.linalg.norm(f, axis=-1)
    cosine = (f * np.asarray(normals)[:, None]).sum(-1) / d
    return np.asarray(1 - hidden(np.asarray(radii) / d, cosine).sum(axis=1))


def cases(seed: int) -> list[Case]:
    rng = np.random.default_rng(seed)
    ball = np.array([0.1, -0.1, 0.6]) + rng.uniform(-0.05, 0.05, 3), float(rng.uniform(0.15, 0.25))
    made = []
    for shows, side, centers, radii in (
        ("one sphere above a floor", 0.8, [ball[0]], [ball[1]]),
        ("two spheres", 0.12, [[-1.0, 0.2, 0.7], [0.9, 0.1, 0.8]], [0.3, 0.4]),
        ("a sphere below the horizon", 0.3, [[0.0, 0.0, -1.0]], [0.4]),
    ):
        points = rng.uniform(-side, side, (16, 3)) * [1, 1, 0]
        args = (points, np.tile([0.0, 0.0, 1.0], (16, 1)), np.array(centers), np.array(radii))
        made.append(Case(shows, args, (sky_visible(*args),)))
    tilted = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.25, 0.25, (16, 3))
    args = (
        np.zeros((16, 3)),
        tilted / np.linalg.norm(tilted, axis=-1, keepdims=True),
        np.array([[0.2, 0.1, 1.0]]),
        np.array([0.3]),
    )
    return [*made, Case("tilted surfaces", args, (sky_visible(*args),))]


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    return np.asarray(np.abs(got[0] - expected[0]))


# ------------------------------------------------------------------------------------------ typical mistakes


def _by(hidden: Callable[[Any, Any], Any]) -> Callable[[Function], Function]:
    return lambda f: lambda p, n, c, r: _share(p, n, c, r, hidden)


VARIANTS = (
    Variant("no cosine", "the cosine is missing: light from the side counts less, (r/d)² cos θ",
            _by(lambda s, c: s * s * (c > 0))),
    Variant("not squared", "r/d is not squared: seen from twice as far a sphere hides a quarter",
            _by(lambda s, c: s * np.maximum(c, 0))),
    Variant("solid angle", "the solid angle is taken, 1 - √(1 - (r/d)²), without the cosine law: (r/d)² cos θ",
            _by(lambda s, c: (1 - np.sqrt(np.maximum(1 - s * s, 0))) * (c > 0))),
    Variant("half of it", "half too little is hidden: the whole sky sends π, not 2π",
            _by(lambda s, c: s * s * np.maximum(c, 0) / 2)),
    Variant("below the horizon", "a sphere below the horizon adds light: clamp the cosine, max(0, cos θ)",
            _by(lambda s, c: s * s * c)),
    Variant("occlusion for light", "that is what is hidden: 1 - it is what is seen",
            lambda f: lambda *args: 1 - f(*args)),
    Variant("only the first sphere", "only the first sphere hides the sky: sum over all",
            before(lambda p, n, c, r: (p, n, c[:1], r[:1]))),
    Variant("cosine of a vector that is not unit", "the cosine is that of a vector which is not unit: divide n·f by d",
            lambda f: lambda p, n, c, r: _scaled(p, n, c, r)),
    Variant("no occlusion", "nothing is hidden", lambda f: lambda p, n, c, r: np.ones(len(p))),
)  # fmt: skip


def _scaled(points: Any, normals: Any, centers: Any, radii: Any) -> np.ndarray:
    d = np.linalg.norm(np.asarray(centers)[None] - np.asarray(points)[:, None], axis=-1)
    f = ((np.asarray(centers)[None] - np.asarray(points)[:, None]) * np.asarray(normals)[:, None]).sum(-1)
    return np.asarray(1 - ((np.asarray(radii) / d) ** 2 * np.maximum(f, 0)).sum(axis=1))


STAGE = Stage(sky_visible, ("share",), cases, errors, 1e-6, "of 1", VARIANTS)
