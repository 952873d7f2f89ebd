"""The photos that `photo light` is measured by: their mirror ball shows the sky along reflected rays, and the sun's
image in it holds a distant ball's flux."""

import numpy as np
import pytest
from measure.light_photos import photograph, rendered, sun_glint
from photo_helpers import BOARD, a_camera
from scene_of import scene_of

from raytwin import twin
from raytwin.images.photo_files import from_bytes, read_photo
from raytwin.photos.camera import detect_photo, lens_model
from raytwin.photos.synthetic_photos import read_truth
from raytwin.scene import Camera, Environment, Lambert, Sky, Sphere, Sun
from raytwin.tracer.lights.environment_map import environment_map

SIDE = 24
CAMERA = Camera(
    (SIDE, SIDE),
    ((40.0, 0.0, 11.5), (0.0, 40.0, 11.5), (0.0, 0.0, 1.0)),
    ((0.8, 0.6, 0.0), (0.36, -0.48, -0.8), (-0.48, 0.64, -0.6)),
    (0.002, -0.003, 0.5),
)
BALL = Sphere((0.01, 0.02, 0.03), 0.1, Lambert((0.9, 0.8, 0.7)))


def test_a_mirror_ball_shows_the_sky_along_the_reflected_ray():
    """A smooth map that differs in every direction: a mirrored or turned ball would show another part of it."""
    texels = np.random.default_rng(3).uniform(0.2, 1, (4, 8, 3)).astype("<f4")
    around = Environment((8, 4), texels.tobytes())
    twin.activate()
    image = rendered(scene_of("mirror", CAMERA, (BALL,), (around,)), {}, 64, seed=0)
    R, eye, c = np.array(CAMERA.R_cam_board), np.array(CAMERA.eye), np.array(BALL.center)
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    d = np.stack([(u - 11.5) / 40, (v - 11.5) / 40, np.ones_like(u)], axis=-1) @ R
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    b = d @ (c - eye)
    square = b**2 - (c - eye) @ (c - eye) + BALL.radius**2
    inside = square > 0.3 * BALL.radius**2  # towards the outline a pixel's mean is not its middle
    n = (eye + d * (b - np.sqrt(np.maximum(square, 0)))[..., None] - c) / BALL.radius
    out = (d - 2 * (d * n).sum(axis=-1, keepdims=True) * n)[inside]
    expected = np.stack(environment_map(around).radiance(tuple(out.T)), axis=1) * BALL.material.albedo
    assert inside.sum() > 80
    assert np.abs(image[inside] - expected).max() < 0.08
    assert np.abs(image[inside] - expected).mean() < 0.01


def test_the_suns_image_in_a_distant_ball_holds_a_quarter_of_its_squared_radius():
    """From afar rays are parallel: a steradian about any direction fills r²/4 of the ball's disc."""
    f, far, r = 40_000.0, 20.0, 0.02
    camera = Camera(
        (200, 200),
        ((f, 0.0, 99.5), (0.0, f, 99.5), (0.0, 0.0, 1.0)),
        ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        (0.0, 0.0, far),
    )
    sun = Sun((0.5, 0.2, 0.7), (3.0, 2.0, 1.0))
    spot = sun_glint(camera, Sphere((0.0, 0.0, 0.0), r, Lambert((0.9, 0.9, 0.9))), sun)
    assert spot.sum(axis=(0, 1)) == pytest.approx(0.9 * np.array(sun.irradiance) * (f * r / far) ** 2 / 4, rel=5e-3)
    # The normal halves the angle between the eye, straight above, and the sun: right of the middle, and above it.
    half = np.add(sun.to_light, (0, 0, 1))
    x, y, _ = half / np.linalg.norm(half) * r * f / far
    v, u = np.unravel_index(spot[..., 0].argmax(), spot.shape[:2])
    assert (u - 99.5, v - 99.5) == pytest.approx((x, -y), abs=0.8)


def test_each_photo_shows_the_whole_board_and_both_balls(tmp_path):
    """The mirror ball, the orange one, and white paper that the sun lights to about 0.75."""
    sun, sky = Sun((0.3, 0.4, 0.8), (2.2, 2.2, 2.2)), Sky((0.2, 0.2, 0.2))
    balls = Sphere((-0.075, 0.05, 0.028), 0.03, Lambert((0.9,) * 3)), Sphere((-0.065, 0.15, 0.018), 0.02, BALL.material)
    photograph(BOARD, a_camera(504, 378), 2, tmp_path, (sun, sky), *balls, (0.095, 0.095, 0.03), samples=8, seed=1)
    truth = read_truth(tmp_path / "truth.toml")
    assert sorted(truth.photos) == ["photo_00.jpg", "photo_01.jpg"]
    for name, (R, t) in truth.photos.items():
        seen = detect_photo(tmp_path / name)
        assert len(seen) > 0.8 * len(BOARD.centers())
        for ball in balls:
            at = lens_model.project(np.array([ball.center]), R, t, truth.K, truth.dist)[0]
            assert (at > 10).all()
            assert (at < np.array(truth.image_size) - 11).all()
        assert 0.6 < np.quantile(from_bytes(read_photo(tmp_path / name)), 0.95) < 0.95
