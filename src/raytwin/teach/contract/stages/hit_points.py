"""Where each pixel's ray first meets a sphere: eye + t d, in the board's frame."""

from typing import Any

import numpy as np

from raytwin.explain import textbook
from raytwin.teach.contract.stage import Arrays, Case, Stage
from raytwin.teach.contract.stages.stage_scenes import AROUND, LENS, SceneDict, draw_scene


def hit_points(scene: SceneDict) -> Any:
    """Where each pixel's ray first meets a sphere: points (H, W, 3) in the board's frame, metres; NaN for none.

    Planes are left out: they hide no sphere here.
    """
    with np.errstate(all="ignore"):
        return textbook.hit_points(scene)


def cases(seed: int) -> list[Case]:
    """Pictures of 26 x 18 pixels; planes are given and stand in nobody's way."""
    rng = np.random.default_rng(seed)
    drawn = (
        ("one sphere", draw_scene(rng, ((0.3, 0.2, 0.6, 0.6),), 0, "lambert")),
        ("a sphere that fills the picture", draw_scene(rng, (), 0, "lambert")),
        (
            "three spheres",
            draw_scene(rng, ((0.4, 0.4, 0.7, 0.7), (-0.6, -0.5, 1.3, 0.3), (-0.3, 0.0, 0.9, 0.4)), 1, "lambert"),
        ),
        ("spheres on all sides", draw_scene(rng, AROUND, 0, "lambert")),
        ("spheres on all sides, through a lens", draw_scene(rng, AROUND, 0, "lambert", LENS)),
    )
    return [Case(shows, (scene,), (hit_points(scene),)) for shows, scene in drawn]


def errors(case: Case, got: Arrays) -> np.ndarray:
    """The distance of each point from where it should be, metres; infinity where a hit is missed or made up."""
    right, p = case.expected[0], got[0]
    missed = np.isnan(right).all(axis=-1)
    off = np.where(missed, 0.0, np.linalg.norm(p - right, axis=-1))
    # NaN in one coordinate is as much a miss as in all three.
    return np.where(np.isnan(p).any(axis=-1) != missed, np.inf, off)


STAGE = Stage(hit_points, ("points",), cases, errors, 1e-4, "m")
