"""Cameras, boards and detections that the tests of photos share."""

import json
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from raytwin.photos.boards.board import Board, BoardTag, Grid
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.detection import Tag
from raytwin.scene import Camera


@lru_cache(maxsize=2)
def rays_of(size: tuple[int, int], K: tuple, dist: tuple[float, ...], n: int) -> np.ndarray:
    """(n H n W, 3): the rays through n x n places of each pixel. The same for all photos of a camera."""
    grid = np.stack(np.meshgrid(*map(np.arange, size)), axis=-1).reshape(-1, 2)
    ideal = lens_model.undistort(grid, K, dist).reshape(*size[::-1], 2)
    # Between pixels' centres a lens bends by less than 1e-4 px.
    ideal = cv2.resize(ideal, None, fx=n, fy=n, interpolation=cv2.INTER_LINEAR).reshape(-1, 2)
    return np.c_[ideal, np.ones(len(ideal))].astype(np.float32)


class PlainRenderer:
    """A `render` without a renderer: each pixel's mean over `n` x `n` rays of the sheet's albedo times `light`."""

    def __init__(self, n: int = 2, light: float = 0.8, table: float = 0.25):
        self.n, self.light, self.table = n, light, table

    def __call__(self, camera, texture, sheet):
        n = self.n
        rays = rays_of(camera.image_size, camera.K, camera.dist, n)
        R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
        # Board point (x, y, 1) -> ray: [r1 r2 t]; its inverse leads each ray to the board's plane.
        x, y, w = np.linalg.inv(np.stack([R[:, 0], R[:, 1], t], axis=1)).astype(np.float32) @ rays.T
        (cx, cy, _), half_u, half_v = sheet.center, sheet.half_u[0], sheet.half_v[1]
        h, w_px = texture.shape
        column = ((x / w - cx) / half_u + 1) / 2 * w_px - 0.5
        row = (1 - (y / w - cy) / half_v) / 2 * h - 0.5
        shape = (camera.height * n, camera.width * n)
        seen = cv2.remap(
            texture,
            column.reshape(shape).astype(np.float32),
            row.reshape(shape).astype(np.float32),
            cv2.INTER_LINEAR,
            borderValue=self.table,
        )
        mean = cv2.resize(seen, camera.image_size, interpolation=cv2.INTER_AREA)
        return np.repeat(self.light * mean[..., None], 3, axis=-1)


def a_camera(width: int = 1008, height: int = 756, dist=(0.08, -0.16)) -> Camera:
    """A phone's: some 65 degrees wide, centred a little off."""
    f = 0.774 * width
    K = ((f, 0.0, 0.504 * width), (0.0, 1.001 * f, 0.497 * height), (0.0, 0.0, 1.0))
    return Camera((width, height), K, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)), (0.0, 0.0, 1.0), dist)


BOARD = Board("tag36h11", 0.030, Grid(5, 7, 0.038))


SMALL = Board("tag36h11", 0.001, Grid(5, 7, 0.038))
"""The same centres on tags so small that the lens does not bend their edges: detections without bias."""


def seen(camera: Camera, stands, board: Board = SMALL, noise: float = 0.0, rng=None) -> dict[str, list[Tag]]:
    """What a detector with `noise` pixels (sd) sees from each (R, t): OpenCV's projectPoints, in the frame only."""
    ids = list(board.centers())
    points, half = board.points(ids), board.tag_edge / 2
    around = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    found = {}
    for i, (R, t) in enumerate(stands):
        centers = lens_model.project(points, R, t, camera.K, camera.dist)
        corners = lens_model.project((points[:, None] + around).reshape(-1, 3), R, t, camera.K, camera.dist)
        if noise:
            centers = centers + rng.normal(0, noise, centers.shape)
        inside = ((centers > 0) & (centers < np.array(camera.image_size) - 1)).all(axis=1)
        found[f"view_{i:02d}"] = [
            Tag(tag, tuple(c), tuple(tuple(p) for p in q), 100.0)
            for tag, c, q, ok in zip(ids, centers.tolist(), corners.reshape(-1, 4, 2).tolist(), inside, strict=True)
            if ok
        ]
    return found


def stored_board(folder: Path, name: str) -> Board:
    """The `coarse` or `fine` board of the folder of real photos, which has inches."""
    data = json.loads((folder / "boards.json").read_text())[name]
    tags = tuple(BoardTag(int(i), (x * 0.0254, y * 0.0254)) for i, (x, y) in data["centers_xy"].items())
    return Board(data["family"], data["tag_black_edge"] * 0.0254, tags=tags)


def stored_tags(folder: Path, name: str) -> tuple[dict[str, list[Tag]], tuple[int, int]]:
    """A set's stored detections, moved from AprilTag's pixels to OpenCV's, and its image size."""
    images = json.loads((folder / name / "detections.json").read_text())["images"]

    def moved(point) -> tuple[float, float]:
        return point[0] - 0.5, point[1] - 0.5

    tags = {
        photo: [Tag(t["id"], moved(t["center"]), tuple(map(moved, t["corners"])), t["margin"]) for t in image["tags"]]
        for photo, image in images.items()
    }
    return tags, tuple(next(iter(images.values()))["size_wh"])
