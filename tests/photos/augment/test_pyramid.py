"""The transparent pyramid: where it stands, how much its faces cover, and what it leaves alone."""

import cv2
import msgspec
import numpy as np

from raytwin.images.photo_files import from_bytes
from raytwin.photos.augment import draw_pyramid
from raytwin.scene import Camera, Pyramid

CAMERA = Camera(
    (400, 300),
    ((400.0, 0.0, 199.5), (0.0, 400.0, 149.5), (0.0, 0.0, 1.0)),
    ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    (0.0, 0.0, 0.5),
    (0.05, -0.1),
)
# Seen from above, its apex over the middle: three faces look up, the base looks away.
PYRAMID = Pyramid(((-0.1, -0.06, 0.0), (0.1, -0.06, 0.0), (0.0, 0.1, 0.0), (0.0, -0.01, 0.1)), (0.0, 0.5, 1.0), 0.3)


def project(points) -> np.ndarray:
    rvec = cv2.Rodrigues(np.array(CAMERA.R_cam_board))[0]
    lens = np.array(CAMERA.K), np.array(CAMERA.coefficients)
    return cv2.projectPoints(np.array(points), rvec, np.array(CAMERA.t_cam_board), *lens)[0][:, 0]


def test_every_pixel_inside_is_covered_twice():
    """Each ray meets one face from inside and one from outside: 1 - (1 - 0.3)² of the photo is covered."""
    grey = np.full((300, 400, 3), 128, np.uint8)
    drawn = from_bytes(draw_pyramid(grey, CAMERA, PYRAMID))
    u, v = project([(-0.03, -0.035, 0.0)])[0].round().astype(int)
    under = from_bytes(np.uint8(128))
    expected = under * 0.7**2 + np.array(PYRAMID.color) * (1 - 0.7**2)
    np.testing.assert_allclose(drawn[v, u], expected, atol=0.006)  # 8 bits: half a step is up to 0.004


def test_a_pyramid_behind_the_camera_is_left_out():
    grey = np.full((300, 400, 3), 128, np.uint8)
    behind = msgspec.structs.replace(PYRAMID, vertices=tuple((x, y, z + 1.0) for x, y, z in PYRAMID.vertices))
    assert np.array_equal(draw_pyramid(grey, CAMERA, behind), grey)
