"""Shadows: the sun is seen where the ray towards it meets no sphere."""

from typing import Any

import numpy as np

from raytwin.teach.contract.stage import Arrays, Case, Stage, text_variants, unit


def sun_visible(points: Any, to_light: Any, centers: Any, radii: Any) -> Any:
    """1 where the sun is seen from a point, 0 where a sphere is in the way: (N,)."""
    f = np.asarray(centers)[None] - np.asarray(points)[:, None]
    along = f @ np.asarray(to_light)
    square = np.asarray(radii) ** 2 - (f**2).sum(-1) + along**2
    own = np.abs(np.linalg.norm(f, axis=-1) / np.asarray(radii) - 1) < 1e-6
    ahead = along + np.sqrt(np.maximum(square, 0)) > 0
    blocked = (square > 0) & ahead & ~own
    return np.where(blocked.any(axis=1), 0.0, 1.0)


def cases(seed: int) -> list[Case]:
    """Points on a floor and on the spheres above it, none near a shadow's edge."""
    rng = np.random.default_rng(seed)
    to_light = unit(rng.uniform([0.3, 0.2, 0.8], [0.5, 0.4, 1.0]))
    centers = np.array([[0.0, 0.0, 0.3], [0.5, 0.1, 0.25], [-0.4, 0.4, 0.5]]) + rng.uniform(-0.05, 0.05, (3, 3))
    centers[1] = centers[0] + 0.55 * to_light  # it shades the first, and what that shades
    radii = rng.uniform(0.12, 0.2, 3)
    balls = list(zip(centers, radii, strict=True))
    away = rng.uniform(1.2, 1.5, (3, 8, 1)) * to_light
    floor = rng.uniform(-1, 1, (60, 3)) * [1, 1, 0]
    on = [c + r * unit(rng.normal(size=(12, 3)) + 2 * to_light) for c, r in balls]
    behind, before = ([c + sign * r * a for (c, r), a in zip(balls, away, strict=True)] for sign in (-1, 1))
    drawn = {
        "points on a floor": floor,
        "points behind a sphere": np.concatenate(behind),
        "points before a sphere, on the sun's side": np.concatenate(before),
        "points on the spheres themselves": np.concatenate(on),
    }
    made = []
    for shows, points in drawn.items():
        args = (points[_sure(points, to_light, centers, radii)], to_light, centers, radii)
        made.append(Case(shows, args, (sun_visible(*args),)))
    return made


def _sure(points: np.ndarray, to_light: np.ndarray, centers: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Points that are as lit with spheres a little smaller, or larger: no shadow's edge is near."""
    same = sun_visible(points, to_light, centers, radii)
    off = np.linalg.norm(points[:, None] - centers[None], axis=-1) / radii - 1
    others = [np.where(np.abs(off) < 1e-6, 0, k) * radii for k in (0.97, 1.03)]  # but for the own one
    found = [[sun_visible(points[i : i + 1], to_light, centers, np.maximum(each[i], 1e-12))[0]
              for i in range(len(points))] for each in others]  # fmt: skip
    return np.asarray((np.array(found) == same).all(axis=0))


def errors(case: Case, got: Arrays) -> np.ndarray:
    return np.asarray(np.abs(got[0] - case.expected[0]))


STAGE = Stage(sun_visible, ("visible",), cases, errors, 1e-6, "of 1", text_variants(sun_visible))
