"""The whole tracer: a ray for every pixel, the nearest object for every ray, its light for every hit."""

from functools import partial

import numpy as np
from msgspec.structs import replace

from raytwin.explain import textbook
from raytwin.explain.draw_scene import LARGER, draw_scene
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Scene, Sphere
from raytwin.teach.contract.stage import Arrays, Case, Stage, Variant, quiet, wrong

STAGE_SIZE = 40, 30
"""Pixels of a picture."""


render, hit_points = quiet(textbook.render), quiet(textbook.hit_points)


def drawn_scenes(seed: int) -> dict[str, Scene]:
    """What a scene shows -> the scene; the last alone has a lens that distorts."""
    scene, other = (draw_scene(seed + DRAWN_FROM + k, STAGE_SIZE, scale=scale) for k, scale in enumerate((1, LARGER)))
    pinhole, larger = (replace(one, camera=replace(one.camera, dist=())) for one in (scene, other))
    return {
        "spheres alone": replace(pinhole, planes=()),
        "spheres and rectangles": pinhole,
        f"{LARGER:.0f} times as large": larger,
        "seen through a lens": scene,
    }


DRAWN_FROM = 70_000
"""Added to seeds, so that no other test draws the same scenes."""


def around_eye(scene: Scene) -> Scene:
    """The scene within one more sphere, which holds the eye and what is near."""
    camera = scene.camera
    eye = -np.transpose(camera.R_cam_board) @ camera.t_cam_board
    x, y, z = (0.5 * eye).tolist()
    wall = Sphere((x, y, z), 0.9 * float(np.linalg.norm(eye)), (0.7, 0.55, 0.8))
    return replace(scene, spheres=(*scene.spheres, wall))


def render_cases(seed: int) -> list[Case]:
    """Pictures without shadows, then with them: not of the larger scene, where float32 shadow rays hit their start."""
    alone, flat, larger, lens = drawn_scenes(seed).items()
    made = [(f"{shows}, no shadows", as_arrays(scene, "lambert")) for shows, scene in (alone, flat, larger)]
    made += [(f"{shows}, with shadows", as_arrays(scene, "shadow")) for shows, scene in (flat, lens)]
    return [Case(shows, (scene,), (render(scene),)) for shows, scene in made]


def last_cases(seed: int) -> list[Case]:
    """From inside a sphere, whose wall hides the sun, on whichever side of what is seen the sun is."""
    above = as_arrays(around_eye(drawn_scenes(seed)["spheres and rectangles"]))
    below = above | {"sun": above["sun"] | {"to_light": -above["sun"]["to_light"]}}
    made = ("above", above), ("below", below)
    return [Case(f"seen from inside a sphere, the sun {where}", (one,), (render(one),)) for where, one in made]


def hit_cases(seed: int) -> list[Case]:
    """The same scenes; planes are given and stand in nobody's way."""
    made = [(shows, as_arrays(scene, "lambert")) for shows, scene in drawn_scenes(seed).items()]
    return [Case(shows, (scene,), (hit_points(scene),)) for shows, scene in made]


def picture_errors(case: Case, got: Arrays) -> np.ndarray:
    """|L - L₀| of each pixel's worst channel, by the largest L₀; infinity for NaN."""
    off = np.abs(got[0] - case.expected[0]).max(axis=-1) / case.expected[0].max()
    return np.where(np.isnan(off), np.inf, off)


def point_errors(case: Case, got: Arrays) -> np.ndarray:
    """The distance of each point from where it should be, metres; infinity where a hit is missed or made up."""
    right, p = case.expected[0], got[0]
    missed = np.isnan(right).all(axis=-1)
    off = np.where(missed, 0.0, np.linalg.norm(p - right, axis=-1))
    # NaN in one coordinate is as much a miss as in all three.
    return np.where(np.isnan(p).any(axis=-1) != missed, np.inf, off)


OWN_WALL = "own-wall"
OWN_WALL_SENTENCE = (
    "from inside a sphere its own wall is lit: it hides the sun, so start shadow rays a little off the surface, "
    "towards the eye, and test the sphere that the eye is in, too"
)
OWN_WALL_LEFT_OUT = 'own = own & (np.linalg.norm(eye - thing["center"]) > thing["radius"])', "pass"
NORMALS_OUTWARD = "n = np.where(towards, n, -n)", 'n = n if "radius" in thing else np.where(towards, n, -n)'
VARIANTS = (
    Variant(OWN_WALL, OWN_WALL_SENTENCE, partial(wrong, "render", (OWN_WALL_LEFT_OUT,))),
    Variant(OWN_WALL, OWN_WALL_SENTENCE, partial(wrong, "render", (OWN_WALL_LEFT_OUT, NORMALS_OUTWARD))),
)
"""Shown by no picture from outside."""

RENDER = Stage(
    render, ("picture",), render_cases, picture_errors, 1e-3, "of the brightest", VARIANTS, outliers=0.01,
    last=last_cases,
)  # fmt: skip
HIT_POINTS = Stage(hit_points, ("points",), hit_cases, point_errors, 1e-4, "m", outliers=0.002)
