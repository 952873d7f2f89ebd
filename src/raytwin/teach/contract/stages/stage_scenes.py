"""Small scenes drawn from a seed, in which every mistake shows: nothing is symmetric, no pixel lies on an outline."""

from typing import Any

import numpy as np

from raytwin.explain import textbook
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.scene.lens import undone

SceneDict = dict[str, Any]
STAGE_SIZE = 26, 18
EDGE_CLEARANCE_PX = 1e-3
"""Pixels: no outline and no shadow's edge is this close to a pixel's centre."""
NO_LENS, LENS = (0.0, 0.0, 0.0, 0.0, 0.0), (-0.2, 0.07, -0.008, 0.012, 0.06)

BallPlace = tuple[float, float, float, float]
"""x, y, z and radius of a sphere, in units of 0.1 m."""


AROUND: tuple[BallPlace, ...] = tuple(
    (24.0 * x + 3, 24.0 * y - 4, 24.0 * z + 5, 11.0 + 1.3 * x - y + 0.7 * z)
    for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if abs(x) + abs(y) + abs(z) > 1
)  # fmt: skip
"""Large spheres on all sides of the camera: wherever a wrong ray goes, it meets one, and the picture tells where."""


def draw_scene(
    rng: np.random.Generator, spheres: tuple[BallPlace, ...], planes: int, rung: str, lens: tuple[float, ...] = NO_LENS
) -> SceneDict:
    """Spheres near these places above a floor (`planes` > 0), with a wall (2), before a tilted camera.

    Where none is asked for, one right before the eye fills the picture: it is met even where a mistake makes its
    discriminant far too small.
    """
    while True:
        scene = as_arrays(_scene(rng, spheres, planes, lens), rung)
        if undone(scene["K"], scene["dist"].tolist(), STAGE_SIZE).fault == "" and _is_clear(scene):
            return scene


def around_eye(scene: SceneDict) -> SceneDict:
    """The scene within one more sphere, which holds the eye and what is near."""
    eye = -np.transpose(scene["R_cam_board"]) @ scene["t_cam_board"]
    sphere = {"center": 0.5 * eye, "radius": 0.9 * float(np.linalg.norm(eye)), "albedo": np.array([0.7, 0.55, 0.8])}
    return scene | {"spheres": [*scene["spheres"], sphere]}


def _scene(rng: np.random.Generator, spheres: tuple[BallPlace, ...], planes: int, lens: tuple[float, ...]) -> Scene:
    camera = _camera(rng, lens)

    def colour() -> tuple[float, float, float]:
        return _three(rng.uniform(0.2, 0.9, 3))

    balls = [
        Sphere(_three(0.1 * (np.array(s[:3]) + min(1.0, s[3]) * rng.uniform(-0.06, 0.06, 3))), 0.1 * s[3], colour())
        for s in spheres
    ]
    if not balls:
        before = np.array([0.02, -0.015, 0.1]) - camera.t_cam_board
        balls.append(Sphere(_three(np.transpose(camera.R_cam_board) @ before), 0.095, colour()))
    flats: tuple[Rectangle, ...] = ()
    if planes > 0:
        flats += (Rectangle((0.01, 0.02, 0.0), (0.23, 0.04, 0.0), (-0.03, 0.1725, 0.0), colour()),)
    if planes > 1:
        flats += (Rectangle((0.07, -0.06, 0.06), (0.05, 0.03, 0.0), (0.0, 0.0, 0.05), colour()),)
    to_light = _three(rng.uniform([0.3, -0.6, 0.6], [0.45, -0.45, 0.8]))
    sun = Sun(to_light, _three(rng.uniform([4.5, 5, 5.5], [5.0, 5.5, 6.0])))
    sky = Sky(_three(rng.uniform([0.1, 0.2, 0.3], [0.16, 0.26, 0.4])))
    return Scene("drawn", camera, tuple(balls), flats, sun, sky)


def _camera(rng: np.random.Generator, lens: tuple[float, ...]) -> Camera:
    """From above and aside at the middle, rolled a little, so that R is like none of its flips or its transpose."""
    eye = rng.uniform([-0.19, -0.29, 0.25], [-0.14, -0.24, 0.3])
    forward = _unit(rng.uniform([-0.01, -0.01, 0.02], [0.01, 0.01, 0.04]) - eye)
    right = _unit(np.cross(forward, _unit(np.array([rng.uniform(0.15, 0.3), 0.1, 1.0]))))
    R = np.stack([right, np.cross(forward, right), forward])
    width, height = STAGE_SIZE
    f = width * (rng.uniform(0.65, 0.7) if any(lens) else rng.uniform(1.3, 1.4))
    K = ((f, 0.0, 0.46 * width), (0.0, 1.05 * f, 0.54 * height), (0.0, 0.0, 1.0))
    dist = tuple((np.array(lens) * rng.uniform(0.8, 1.2, 5)).tolist())
    return Camera((width, height), K, tuple(_three(row) for row in R), _three(-R @ eye), dist)


def _is_clear(scene: SceneDict) -> bool:
    """Moved a little each way, every pixel sees the same object, as light or as dark."""
    ways = EDGE_CLEARANCE_PX * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    seen = _seen(scene)
    return all(np.array_equal(seen, _seen(_moved(scene, x, y))) for x, y in ways)


def _seen(scene: SceneDict) -> np.ndarray:
    """(3, N): what each pixel sees, of all things and of the spheres alone; and whether the sun is hidden there."""
    things, to_light = [*scene["spheres"], *scene["planes"]], scene["sun"]["to_light"]
    with np.errstate(all="ignore"):
        rays = textbook.back_project(scene["K"], scene["dist"], scene["width"], scene["height"]).reshape(-1, 3)
        eye, which, points = textbook.met(rays, scene, things)
        _, balls, _ = textbook.met(rays, scene, scene["spheres"])
        normals = textbook.normals_at(points, which, eye, things)
        lit = textbook.sun_visible(points, normals, which, to_light, eye, things)
    return np.stack([which, balls, lit | (which < 0)])


def _moved(scene: SceneDict, x: float, y: float) -> SceneDict:
    return scene | {"K": scene["K"] + [[0, 0, x], [0, 0, y], [0, 0, 0]]}


def _unit(v: np.ndarray) -> np.ndarray:
    return np.asarray(v / np.linalg.norm(v))


def _three(v: Any) -> Any:
    return tuple(float(x) for x in v)
