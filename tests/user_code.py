"""A user's code over the public names: not run, but what the type checker must find sound (`mypy --strict`)."""

from pathlib import Path

import numpy as np

import raytwin


def compare_my_renderer(folder: Path) -> str:
    scene: raytwin.Scene = raytwin.read_scene(folder)
    mine = raytwin.Image(np.zeros((scene.camera.height, scene.camera.width, 3), np.float32))
    truth: raytwin.Image = raytwin.render(scene, "path", samples=64)
    comparison = raytwin.compare_images(mine, truth, tolerance=scene.tolerance)
    for reason in comparison.reasons:
        print(reason.upper())
    return comparison.verdict


def move_a_sphere(scene: raytwin.Scene) -> raytwin.Scene:
    moved = tuple(raytwin.Sphere(ball.center, 2 * ball.radius, ball.albedo) for ball in scene.spheres)
    sun, sky = raytwin.Sun((0.0, 0.0, 1.0), (3.0, 3.0, 3.0)), raytwin.Sky((0.1, 0.1, 0.1))
    return raytwin.Scene(scene.name, scene.camera, moved, scene.planes, sun, sky)


def radiance_of(scene: raytwin.Scene) -> float:
    try:
        image = raytwin.trace(scene, "shadow")
    except raytwin.InputError as error:
        raise SystemExit(f"{error.where}: {error.expected}") from error
    seen = image.surface.mask if image.surface is not None else np.ones(image.mean.shape[:2], bool)
    return float(image.mean[seen].mean())


def fit(photos: list[Path], board: Path) -> tuple[float, float]:
    camera = raytwin.calibrate(photos, raytwin.read_board(board))
    return camera.K[0][0], camera.rms_px
