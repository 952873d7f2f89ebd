"""A transparent triangular pyramid on a photo: four vertices, four translucent faces, six edges."""

from itertools import combinations

import cv2
import numpy as np

from raytwin.images.photo_files import from_bytes, to_bytes
from raytwin.photos.camera import lens_model
from raytwin.scene import Camera, Pyramid

SHIFT = 4
"""Fractional bits of OpenCV's polygon coordinates: corners are placed to 1/16 px."""
PIECES = 16
"""A straight edge bends under a lens: it is drawn in this many pieces."""


def draw_pyramid(photo: np.ndarray, camera: Camera, pyramid: Pyramid, space: np.ndarray | None = None) -> np.ndarray:
    """The pyramid drawn into a copy of `photo`, uint8 sRGB (H, W, 3), back faces first.

    Each face covers what lies behind it by its `opacity`, in linear light: a face seen from inside (its outer side
    turned away) is drawn before those seen from outside. `space`: the photo's linear RGB to Rec. 709. A pyramid that
    reaches the camera's plane, or past where the lens folds back, is left out whole.
    """
    vertices = np.array(pyramid.vertices)
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    if not lens_model.grows(vertices @ R.T + t, camera.dist).all():
        return photo.copy()
    eye, middle = np.array(camera.eye), vertices.mean(axis=0)
    # Blending does not care for primaries: the colour goes into the photo's.
    color = np.linalg.solve(np.eye(3) if space is None else space, pyramid.color)
    out = from_bytes(photo)
    faces = [(i, vertices[[j for j in range(4) if j != i]]) for i in range(4)]
    for _, corners in sorted(faces, key=lambda face: _faces_eye(face[1], middle, eye)):
        outline = np.concatenate([_segment(corners[i], corners[(i + 1) % 3], camera)[:-1] for i in range(3)])
        coverage = np.zeros(photo.shape[:2], np.uint8)
        cv2.fillPoly(coverage, [np.round(outline * (1 << SHIFT)).astype(np.int32)], 255, cv2.LINE_AA, SHIFT)
        _blend(out, coverage, color, pyramid.opacity)
    for a, b in combinations(vertices, 2):
        line = np.zeros(photo.shape[:2], np.uint8)
        points = np.round(_segment(a, b, camera) * (1 << SHIFT)).astype(np.int32)
        width = max(1, round(min(photo.shape[:2]) / 500))
        cv2.polylines(line, [points], False, 255, width, cv2.LINE_AA, SHIFT)
        _blend(out, line, 0.25 * color, 1.0)
    return to_bytes(out)  # what nothing covers comes back as it was


def _faces_eye(corners: np.ndarray, middle: np.ndarray, eye: np.ndarray) -> bool:
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    outwards = normal if normal @ (corners[0] - middle) > 0 else -normal
    return bool(outwards @ (eye - corners[0]) > 0)


def _segment(a: np.ndarray, b: np.ndarray, camera: Camera) -> np.ndarray:
    share = np.linspace(0, 1, PIECES + 1)[:, None]
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    return lens_model.project(a + share * (b - a), R, t, np.array(camera.K), camera.dist)


def _blend(out: np.ndarray, coverage: np.ndarray, color: np.ndarray, opacity: float) -> None:
    rows, columns = np.nonzero(coverage)
    a = (coverage[rows, columns] / np.float32(255) * np.float32(opacity))[:, None]
    out[rows, columns] = out[rows, columns] * (1 - a) + color.astype(np.float32) * a
