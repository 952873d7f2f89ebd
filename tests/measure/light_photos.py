"""A photo for `raytwin photo light` under a known light: a mirror ball, a matt ball and a pin stand beside a board.

Mitsuba's own path tracer renders them. It sees no sun in a mirror, since that is a direction: `sun_glint` adds its
image. The sunlight that the mirror throws on what surrounds it is left out.
"""

import itertools
import math
from pathlib import Path

import numpy as np
from scene_of import scene_of

from raytwin import twin
from raytwin.images.photo_files import write_picture
from raytwin.photos.boards.board import Board, BoardTag, draw_board, write_board
from raytwin.photos.camera import lens_model
from raytwin.photos.synthetic_photos import QUALITY, Truth, expose, poses, sheet_of, write_truth
from raytwin.scene import Camera, Environment, Matrix, Rectangle, Scene, Sky, Sphere, Sun, Vector
from raytwin.study.photograph import TABLE
from raytwin.twin.opencv_sensor import lens_at, mitsuba_sensor
from raytwin.twin.twin_scene import load, place_of, translate

TEXELS_PER_METRE = 4500.0
"""Of the board's texture: two per pixel at the nearest."""

SAMPLES_PER_PASS = 8
"""Samples per pixel that Mitsuba holds in memory at once."""

GLINT_BLUR = 0.7
"""Pixels, one standard deviation: how far a lens spreads the sun's image."""

POST_SHARE = 0.05
"""The pin's thickness, as a share of its height."""

BORDER = 5
"""Pixels between a ball's outline and the frame, at least."""


def photograph(
    board: Board, camera: Camera, out: Path, lights: tuple[Sun, Sky | Environment], mirror: Sphere, ball: Sphere,
    pin: tuple[float, float, float], samples: int, seed: int,
) -> None:  # fmt: skip
    """Write a photo that shows all of board, balls and pin, photo_00.jpg, and board.toml and truth.toml to `out`.

    The camera's pose is not used. The mirror's albedo is its reflectance. `pin`: x and y of its foot, and its height.
    """
    twin.activate()
    rng = np.random.default_rng(seed)
    texture, extent = draw_board(board, TEXELS_PER_METRE)
    x, y, height = pin
    objects = (mirror, ball, sheet_of(extent), TABLE, *post(x, y, height))
    R, t = pose_of(board, camera, (mirror, ball, Sphere((x, y, height / 2), height / 2)), rng)
    view = Camera(camera.image_size, camera.K, R, t, camera.dist)
    light = rendered(scene_of("light", view, objects, lights), {2: texture}, samples, seed)
    pixels = expose(light + sun_glint(view, mirror, lights[0]), rng, view)
    write_picture(out / "photo_00.jpg", pixels, quality=QUALITY)
    write_board(out / "board.toml", board)
    write_truth(out / "truth.toml", Truth(camera.image_size, camera.K, camera.dist, {"photo_00.jpg": (R, t)}))


def pose_of(
    board: Board, camera: Camera, around: tuple[Sphere, ...], rng: np.random.Generator
) -> tuple[Matrix, Vector]:
    """Return a pose that shows all of the board and of the spheres: one of a wider board, which reaches as far."""
    corners = np.array(list(itertools.product((-1, 1), repeat=3)))
    points = np.concatenate([np.array(s.center) + s.radius * corners for s in around])
    flat = np.concatenate([points[:, :2], list(board.centers().values())])
    ends = zip(flat.min(axis=0).tolist(), flat.max(axis=0).tolist(), strict=True)
    wide = Board(
        board.family, board.tag_edge, tags=tuple(BoardTag(i, at) for i, at in enumerate(itertools.product(*ends)))
    )
    while True:
        ((R, t),) = poses(wide, camera, 1, rng)
        at = lens_model.project(points, R, t, camera.K, camera.dist)
        if (at > BORDER).all() and (at < np.array(camera.image_size) - 1 - BORDER).all():
            return R, t


def post(x: float, y: float, height: float) -> tuple[Rectangle, ...]:
    """A square post: four sides and a top."""
    a, grey = POST_SHARE * height / 2, (0.3, 0.3, 0.3)
    up = (0.0, 0.0, height / 2)
    sides = [((x + a * i, y + a * j, height / 2), (a * j, -a * i, 0.0)) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    top = Rectangle((x, y, height), (a, 0.0, 0.0), (0.0, a, 0.0), grey)
    return (*(Rectangle(middle, along, up, grey) for middle, along in sides), top)


def rendered(scene: Scene, textures: dict[int, np.ndarray], samples: int, seed: int) -> np.ndarray:
    """Linear radiance (H, W, 3) by Mitsuba's path tracer; object 0 is a mirror, whose albedo is its reflectance."""
    import mitsuba as mi

    world = translate(scene, place := place_of(scene), textures)
    reflectance = {"type": "rgb", "value": list(scene.objects[0].albedo)}
    world["object-0"]["bsdf"] = {"type": "conductor", "material": "none", "specular_reflectance": reflectance}
    world["sensor"] = mitsuba_sensor(scene.camera) | lens_at(scene.camera, place.eye)
    world["integrator"] = {"type": "path", "max_depth": 8}
    loaded, passes = load(world), math.ceil(samples / SAMPLES_PER_PASS)
    total = np.zeros((scene.camera.height, scene.camera.width, 3))
    for number in np.random.SeedSequence(seed).generate_state(passes).tolist():
        total += np.asarray(mi.render(loaded, spp=SAMPLES_PER_PASS, seed=number))
    return total / passes


def sun_glint(camera: Camera, ball: Sphere, sun: Sun) -> np.ndarray:
    """(H, W, 3): the radiance that the sun's image in a mirror ball adds, blurred by GLINT_BLUR pixels.

    A point at infinity is seen where the normal halves the angle between eye and light. Its image holds, over all
    pixels, E times the reflectance times the area in pixels that a steradian about it fills in the mirror.
    """
    to_sun = np.array(sun.to_light)
    sideways = np.linalg.svd(to_sun[None])[2][1:]
    step = 1e-4
    lights = np.stack([to_sun, *(to_sun + step * s for s in sideways)])
    n = np.broadcast_to(to_sun, lights.shape)
    for _ in range(100):
        to_eye = np.array(camera.eye) - (np.array(ball.center) + ball.radius * n)
        half = to_eye / np.linalg.norm(to_eye, axis=1, keepdims=True) + lights
        n = half / np.linalg.norm(half, axis=1, keepdims=True)
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    at = lens_model.project(np.array(ball.center) + ball.radius * n, R, t, np.array(camera.K), camera.dist)
    area = abs(np.linalg.det((at[1:] - at[0]) / step))
    x, y = np.arange(camera.width) - at[0, 0], np.arange(camera.height) - at[0, 1]
    spot = np.exp(-(y[:, None] ** 2 + x**2) / (2 * GLINT_BLUR**2)) / (2 * np.pi * GLINT_BLUR**2)
    return spot[..., None] * (area * np.array(sun.irradiance) * np.array(ball.albedo))
