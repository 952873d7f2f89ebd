"""The whole tracer: a ray for every pixel, the nearest object for every ray, its light for every hit."""

from typing import Any

import numpy as np

from raytwin.explain import textbook
from raytwin.teach.contract.stage import Arrays, Case, Stage, Variant, wrong
from raytwin.teach.contract.stages.stage_scenes import AROUND, LENS, SceneDict, around_eye, draw_scene


def render(scene: SceneDict) -> Any:
    """The picture (H, W, 3), linear radiance, row 0 on top.

    Each pixel shows what the ray through its centre meets first: shaded by sun and sky, or the sky's radiance where
    it meets nothing. With scene["rung"] == "shadow" the sun does not reach points that an object hides from it: another
    one, or, seen from inside a sphere, its own wall; with "lambert" nothing casts shadows. Planes are rectangles,
    center ± half_u ± half_v, lit from both sides.
    """
    with np.errstate(all="ignore"):
        return textbook.render(scene)


def cases(seed: int) -> list[Case]:
    """Pictures of 26 x 18 pixels, from one sphere to shadows of all on all."""
    rng = np.random.default_rng(seed)
    front, back, high = (-0.6, -0.5, 1.3, 0.3), (0.4, 0.4, 0.7, 0.7), (0.87, -0.26, 1.6, 0.4)
    drawn = (
        ("a sphere that fills the picture", draw_scene(rng, (), 0, "lambert")),
        ("three spheres on a floor, no shadows", draw_scene(rng, (back, front, high), 1, "lambert")),
        ("three spheres on a floor, with shadows", draw_scene(rng, (front, back, high), 1, "shadow")),
        ("spheres, a floor and a wall, with shadows", draw_scene(rng, (back, high, front), 2, "shadow")),
        ("spheres on all sides, through a lens", draw_scene(rng, AROUND, 2, "lambert", LENS)),
    )
    return [Case(shows, (scene,), (render(scene),)) for shows, scene in drawn]


def last(seed: int) -> list[Case]:
    """From inside a sphere, whose wall hides the sun, on whichever side of what is seen the sun is."""
    rng = np.random.default_rng(seed)
    few, more = ((-0.2, 0.1, 0.6, 0.5),), ((0.4, 0.4, 0.7, 0.5), (-0.4, 0.0, 0.9, 0.4))
    made = []
    for shows, scene in (
        ("a sphere", draw_scene(rng, few, 1, "shadow")),
        ("spheres", draw_scene(rng, more, 2, "shadow")),
    ):
        above = around_eye(scene)
        below = above | {"sun": above["sun"] | {"to_light": -above["sun"]["to_light"]}}
        for where, one in (("above", above), ("below", below)):
            made.append(Case(f"{shows} seen from inside another, the sun {where}", (one,), (render(one),)))
    return made


def errors(case: Case, got: Arrays) -> np.ndarray:
    """|L - L₀| of each pixel's worst channel, by the largest L₀; infinity for NaN."""
    off = np.abs(got[0] - case.expected[0]).max(axis=-1) / case.expected[0].max()
    return np.where(np.isnan(off), np.inf, off)


OWN_WALL = "own-wall"
OWN_WALL_SENTENCE = (
    "from inside a sphere its own wall is lit: it hides the sun, so start shadow rays a little off the surface, "
    "towards the eye, and test the sphere that the eye is in, too"
)
OWN_WALL_LEFT_OUT = 'own = own & (np.linalg.norm(eye - thing["center"]) > thing["radius"])', "pass"
NORMALS_OUTWARD = "n = np.where(towards, n, -n)", 'n = n if "radius" in thing else np.where(towards, n, -n)'
VARIANTS = (
    Variant(OWN_WALL, OWN_WALL_SENTENCE, lambda _: wrong("render", (OWN_WALL_LEFT_OUT,))),
    Variant(OWN_WALL, OWN_WALL_SENTENCE, lambda _: wrong("render", (OWN_WALL_LEFT_OUT, NORMALS_OUTWARD))),
)
"""Shown by no picture from outside."""

STAGE = Stage(render, ("picture",), cases, errors, 1e-3, "of the brightest", VARIANTS, outliers=0.01, last=last)
