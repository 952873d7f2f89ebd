import json

import cv2
import numpy as np
import pytest

from raytwin.photos import lens
from raytwin.photos.board import Board, BoardTag, Grid
from raytwin.photos.detect import Tag
from raytwin.photos.photographer import photograph
from raytwin.scene import Camera

INCH = 0.0254


@pytest.fixture(scope="session")
def real_board(shared_photos):
    """boards.json's `coarse` or `fine`, in metres."""

    def load(name: str) -> Board:
        data = json.loads((shared_photos / "boards.json").read_text())[name]
        tags = tuple(BoardTag(int(i), (x * INCH, y * INCH)) for i, (x, y) in data["centers_xy"].items())
        return Board(data["family"], data["tag_black_edge"] * INCH, tags=tags)

    return load


@pytest.fixture(scope="session")
def real_tags(shared_photos):
    """A set's stored detections, in OpenCV's pixels, and its image size."""

    def load(name: str) -> tuple[dict[str, list[Tag]], tuple[int, int]]:
        images = json.loads((shared_photos / name / "detections.json").read_text())["images"]
        tags = {
            photo: [
                Tag(
                    t["id"],
                    tuple(c - 0.5 for c in t["center"]),
                    tuple(tuple(c - 0.5 for c in corner) for corner in t["corners"]),
                    t["margin"],
                )
                for t in image["tags"]
            ]
            for photo, image in images.items()
        }
        return tags, tuple(next(iter(images.values()))["size_wh"])

    return load


class PlainRenderer:
    """A `render` without a renderer: each pixel's mean over `n` x `n` rays of the sheet's albedo times `light`."""

    def __init__(self, n: int = 3, light: float = 0.8, table: float = 0.25):
        self.n, self.light, self.table, self.rays = n, light, table, None

    def __call__(self, camera, texture, sheet):
        n = self.n
        if self.rays is None:  # one camera, many poses
            u, v = ((np.arange(m * n) + 0.5) / n - 0.5 for m in camera.image_size)
            grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
            self.rays = np.c_[lens.undistort(grid, camera.K, camera.dist), np.ones(len(grid))].astype(np.float32)
        R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
        # Board point (x, y, 1) -> ray: [r1 r2 t]; its inverse leads each ray to the board's plane.
        x, y, w = np.linalg.inv(np.stack([R[:, 0], R[:, 1], t], axis=1)).astype(np.float32) @ self.rays.T
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


@pytest.fixture(scope="session")
def shoot(tmp_path_factory):
    """A folder of photos of the plain renderer's, and their truth; made once for the same arguments."""
    made = {}

    def take(count: int = 12, dist=(0.08, -0.16), width: int = 1008, height: int = 756, seed: int = 1):
        key = (count, dist, width, height, seed)
        if key not in made:
            out = tmp_path_factory.mktemp("photos")
            made[key] = out, photograph(BOARD, a_camera(width, height, dist), count, out, PlainRenderer(), seed=seed)
        return made[key]

    return take
