"""Guessing pixels between traced ones: never more wrong than promised where it is careful, and cheap."""

from itertools import product

import msgspec
import numpy as np
import pytest
from scene_of import changed, scene_of

from raytwin.fast import trace
from raytwin.fast.speculation import WAYS, doubtful, speculate
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.scene.scene_files import read_scene

TOLERANCE = 5e-4


def sphere_scene(x=0.0, y=0.0, radius=0.05, to_light=(0.3, 0.4, 1.0), size=(640, 480), dist=()) -> Scene:
    w, h = size
    camera = Camera(
        size,
        ((1.25 * w, 0.0, w / 2), (0.0, 1.25 * w, h / 2), (0.0, 0.0, 1.0)),
        ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        (0.0, 0.0, 0.5),
        dist,
    )
    return scene_of("s", camera, (Sphere((x, y, 0.05), radius),), (Sun(to_light), Sky((0.1, 0.1, 0.1))))


@pytest.mark.parametrize("rung", ["lambert", "shadow"])
@pytest.mark.parametrize(("name", "n"), [("single", 16), ("overlap", 8), ("distorted", 4), ("grazing", 2)])
def test_a_careful_guess_keeps_its_promise_on_every_scene(scenes, name, n, rung):
    scene = read_scene(scenes / name)
    truth = trace(scene, rung).mean
    guess, share = speculate(scene, n, rung, tolerance=TOLERANCE)
    assert np.quantile(np.abs(guess - truth), 0.999) <= TOLERANCE
    assert share < 1


def test_the_closed_form_bounds_the_error_of_interpolation():
    """Head on, far away and out to 0.8 radii, bilinear guesses err by at most the bound, and by a fair share of it.

    On a sphere whose image has the radius R pixels L = a + b n·l with n = (x, y, √(1 - x² - y²)), x and y in radii.
    Only n_z curves, n_z'' = -(1 - y²) / n_z³ along x: the error is at most b h²/(8 R²) (1 + n_z²) / n_z³.
    """
    far = sphere_scene(size=(641, 481))
    K = ((80000.0, 0.0, 320.0), (0.0, 80000.0, 240.0), (0.0, 0.0, 1.0))
    camera = msgspec.structs.replace(far.camera, K=K, t_cam_board=(0.0, 0.0, 20.05))
    scene = changed(far, camera=camera, lights=(Sun((0.0, 0.0, 1.0)), far.sky))
    truth, n = trace(scene, "lambert").mean[..., 0], 8
    guess = speculate(scene, n, "lambert", engine="numpy64", way="paper")[0][..., 0]
    radius_px = 80000 * 0.05 / 20
    v, u = np.mgrid[0:481, 0:641]
    rim = 0.8 - n * np.sqrt(2) / radius_px
    inside = np.hypot(u - 320, v - 240) < rim * radius_px
    nz = np.sqrt(1 - 0.8**2)
    bound = 0.8 / np.pi * 3 * n**2 / (8 * radius_px**2) * (1 + nz**2) / nz**3
    worst = np.abs(guess - truth)[inside].max()
    assert 0.2 * bound < worst < bound


@pytest.mark.parametrize("width", range(32, 41))
def test_frames_of_every_size_are_filled_to_their_last_row_and_column(scenes, width):
    # A frame full of a table: a pixel left out would show the sky.
    scene = read_scene(scenes / "overlap")
    table = Rectangle((0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (0.0, 50.0, 0.0))
    scene = changed(scene, camera=scene.camera.resized(width, 69 - width), objects=(table,))
    truth = trace(scene, "lambert")
    assert truth.surface.mask.all()
    for n, way in product((2, 4, 8), WAYS):
        guess, _ = speculate(scene, n, "lambert", engine="numpy64", way=way)
        np.testing.assert_allclose(guess, truth.mean, atol=1e-6)


@pytest.mark.parametrize(("share", "doubted"), [(0.9, False), (1.1, True)])
def test_a_block_is_guessed_where_a_quarter_of_its_corners_second_differences_is_within_the_tolerance(share, doubted):
    """c x²/2 has the second difference c along x, and none along y; the lattice's rim has no neighbours to tell."""
    tolerance, x = 1e-3, np.arange(8.0)
    colour = np.repeat(np.repeat((share * 4 * tolerance * x * x / 2)[None, :, None], 7, axis=0), 3, axis=2)
    ids, light = np.zeros((7, 8), int), np.zeros((7, 8), int)
    for along in (colour, colour.transpose(1, 0, 2)):
        shape = along.shape[:2]
        found = doubtful(along.astype("f"), ids.reshape(shape), light.reshape(shape), tolerance)
        assert (found[1:-1, 1:-1] == doubted).all()
