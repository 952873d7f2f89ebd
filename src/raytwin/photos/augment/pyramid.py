"""A transparent triangular pyramid on a photo: four translucent faces and six edges."""

from itertools import combinations

import cv2
import numpy as np

from raytwin.images.photo_files import from_bytes, to_bytes
from raytwin.photos.camera import lens_model
from raytwin.scene import Camera, Pyramid

SHIFT = 4
"""Fractional bits of OpenCV's polygon coordinates: corners are placed to 1/16 px."""

PIECES = 16
"""Pieces in which a straight edge is drawn, since it bends under a lens."""


def draw_pyramid(photo: np.ndarray, camera: Camera, pyramid: Pyramid) -> np.ndarray:
    """Return a copy of `photo`, uint8 sRGB (H, W, 3), with the pyramid drawn in.

    Each face covers what lies behind it by its `opacity`, in linear light. All have one colour, so that their order
    changes nothing. A pyramid that reaches the camera's plane, or past where the lens folds back, is left out whole.
    """
    vertices, color = np.array(pyramid.vertices), np.array(pyramid.color, np.float32)
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    if not lens_model.grows(vertices @ R.T + t, camera.dist).all():
        return photo.copy()
    share = np.linspace(0, 1, PIECES + 1)[:, None]

    def edge(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        points = lens_model.project(a + share * (b - a), R, t, np.array(camera.K), camera.dist)
        return np.round(points * (1 << SHIFT)).astype(np.int32)

    out = from_bytes(photo)
    for a, b, c in combinations(vertices, 3):
        coverage = np.zeros(photo.shape[:2], np.uint8)
        outline = np.concatenate([edge(a, b), edge(b, c), edge(c, a)])
        cv2.fillPoly(coverage, [outline], 255, cv2.LINE_AA, SHIFT)
        _blend(out, coverage, color, pyramid.opacity)
    for a, b in combinations(vertices, 2):
        coverage = np.zeros(photo.shape[:2], np.uint8)
        width = max(1, round(min(photo.shape[:2]) / 500))
        cv2.polylines(coverage, [edge(a, b)], False, 255, width, cv2.LINE_AA, SHIFT)
        _blend(out, coverage, 0.25 * color, 1.0)
    return to_bytes(out)  # what nothing covers comes back as it was


def _blend(out: np.ndarray, coverage: np.ndarray, color: np.ndarray, opacity: float) -> None:
    rows, columns = np.nonzero(coverage)
    a = (coverage[rows, columns] / np.float32(255) * np.float32(opacity))[:, None]
    out[rows, columns] = out[rows, columns] * (1 - a) + color * a
