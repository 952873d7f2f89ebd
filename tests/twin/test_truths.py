"""The twin's light against closed forms, exact or with a stated false-alarm rate, on both variants.

F is the share of the sky's light that another surface takes from a surface element (its configuration factor); with
albedo a under a sky of radiance Ls alone the element shows a (1 - F) Ls at one bounce. A sampled mean may err by 3.5 of
its standard errors: a correct twin fails in 5 of 10 000 tests of new seeds. The seeds here are fixed.
"""

import numpy as np
import pytest

from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky
from raytwin.twin import render

MANY = {"llvm_ad_rgb": 1 << 20, "scalar_rgb": 1 << 14}
"""Samples of a test. `scalar_rgb` takes 20 s for a million; its arithmetic is the same."""


def view_of(point, eye, extent: float, pixels: int = 16) -> Camera:
    """From `eye` at `point`, the picture `extent` wide there: all its pixels see nearly the same place."""
    eye, point = np.array(eye, float), np.array(point, float)
    far = np.linalg.norm(point - eye)
    z = (point - eye) / far
    x = np.cross(z, (0.6, 0.8, 0.0) if abs(z[2]) > 0.5 else (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    f, c = pixels * far / extent, (pixels - 1) / 2
    K = ((f, 0.0, c), (0.0, f, c), (0.0, 0.0, 1.0))
    return Camera((pixels, pixels), K, tuple(map(tuple, R.tolist())), tuple((-R @ eye).tolist()))


def mean_of(scene: Scene, variant: str, rung: str = "sky", **options) -> tuple[float, float]:
    """Of the picture's green channel: the mean, and its standard error."""
    pixels = scene.camera.width * scene.camera.height
    image = render(scene, rung, samples=MANY[variant] // pixels, seed=1, cache=False, variant=variant, **options)
    assert (image.surface.ids == image.surface.ids[0, 0]).all()
    error = np.sqrt(image.variance[..., 1].sum(dtype=float)) / pixels
    return float(image.mean[..., 1].mean(dtype=float)), float(error)


@pytest.mark.parametrize(("at", "lost"), [(0.1, 0.450248140490), (0.5, 0.276393202250), (1.0, 0.146446609407)])
def test_a_wall_hides_its_share_of_the_sky_from_the_floor_beside_it(variant, at, lost):
    """(1 - d / √(d² + H²)) / 2 at the distance d from a wall of height H, infinitely long; both of one albedo.

    The wall is 200 H long, which takes 1e-5 off the share, and the picture 1e-3 H wide: 1e-6.
    """
    grey = Lambert((0.5, 0.5, 0.5))
    floor = Rectangle((0, 0, 0), (100, 0, 0), (0, 100, 0), grey)
    wall = Rectangle((0, 0, 0.5), (0, 100, 0), (0, 0, 0.5), grey)
    camera = view_of((at, 0, 0), (at + 0.4, 0.1, 0.8), 1e-3)
    for planes, expected in (((floor, wall), 0.5 * (1 - lost)), ((wall, floor), 0.5 * (1 - lost))):
        mean, error = mean_of(Scene("wall", camera, planes, (Sky((1, 1, 1)),)), variant)
        assert error < 4e-4 * np.sqrt(MANY["llvm_ad_rgb"] / MANY[variant])
        assert mean == pytest.approx(expected, abs=3.5 * error)
