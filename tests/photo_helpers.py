"""Cameras, boards and detections that the tests of photos share."""

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from raytwin.photos.boards.board import Board, BoardTag, Grid
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.detection import Tag
from raytwin.photos.synthetic_photos import Truth
from raytwin.scene import Camera
from raytwin.scene.toml_json import read_toml, to_record


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


BOW_DEGREES = 30.0
"""The direction in which a bow's height changes, from the board's X."""

NODES = 16
"""How a bent sheet is seen is computed for one texel of this many."""


@dataclass(frozen=True, eq=False)
class Bow:
    """A sheet bent about one direction and not stretched: z = bend/2 (1 + cos(pi s / reach)), s along `across`, metres.

    `bend` is the height from the middle to the outermost tags. No polynomial, so that it is no shape that a fit of
    polynomials could find exactly. `s`, `arc`: a table of how long the sheet is from the middle to s.
    """

    bend: float
    reach: float
    middle: np.ndarray
    across: np.ndarray
    s: np.ndarray
    arc: np.ndarray

    def height(self, s: np.ndarray) -> np.ndarray:
        return self.bend / 2 * (1 + np.cos(np.pi / self.reach * s))

    def bent(self, flat: np.ndarray) -> np.ndarray:
        """(n, 3): where the flat sheet's points (n, 2) are in space."""
        along = (flat - self.middle) @ self.across
        s = np.interp(along, self.arc, self.s)
        return np.c_[flat + (s - along)[:, None] * self.across, self.height(s)]

    def seen_from(self, texture: np.ndarray, extent: tuple[float, float, float, float], eye: np.ndarray) -> np.ndarray:
        """What a flat sheet must show, for an eye at `eye`, to look like the bent one: its texture moved accordingly.

        A ray from the eye meets the bent sheet at another place than the flat one: exact for where things are seen; the
        light is the flat sheet's.
        """
        h, w = texture.shape
        x0, x1, y0, y1 = extent
        columns, rows = np.meshgrid(*((np.arange(n) + 0.5) / n for n in (-(-w // NODES), -(-h // NODES))))
        flat = np.stack([x0 + columns * (x1 - x0), y1 - rows * (y1 - y0)], axis=-1)
        met = flat
        for _ in range(20):  # each time the error shrinks by the slope times the tangent of the view's tilt
            z = self.height((met - self.middle) @ self.across)
            met = flat + (eye[:2] - flat) * (z / eye[2])[..., None]
        s = (met - self.middle) @ self.across
        printed = met + (np.interp(s, self.s, self.arc) - s)[..., None] * self.across
        moved = ((printed - flat) * [w / (x1 - x0), -h / (y1 - y0)]).astype(np.float32)
        dx, dy = cv2.split(cv2.resize(moved, (w, h), interpolation=cv2.INTER_LINEAR))
        dx += np.arange(w, dtype=np.float32)
        dy += np.arange(h, dtype=np.float32)[:, None]
        return cv2.remap(texture, dx, dy, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def bow_of(board: Board, bend: float) -> Bow:
    """The bow that lifts the board's middle by `bend` metres over its outermost tags."""
    xy = np.array(list(board.centers().values()))
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    across = np.array([math.cos(math.radians(BOW_DEGREES)), math.sin(math.radians(BOW_DEGREES))])
    reach = float(np.abs((xy - middle) @ across).max())
    s = np.linspace(-3, 3, 6001) * reach
    slope = -bend / 2 * np.pi / reach * np.sin(np.pi / reach * s)
    length = np.sqrt(1 + slope**2)
    arc = np.concatenate([[0], np.cumsum((length[1:] + length[:-1]) / 2 * np.diff(s))])
    return Bow(bend, reach, middle, across, s, arc - np.interp(0, s, arc))


class BentRenderer(PlainRenderer):
    """The same of a sheet that is bent into a bow."""

    def __init__(self, board: Board, bend: float):
        super().__init__()
        self.bow = bow_of(board, bend)

    def __call__(self, camera, texture, sheet):
        (x, y, _), u, v = sheet.center, sheet.half_u[0], sheet.half_v[1]
        shown = self.bow.seen_from(texture, (x - u, x + u, y - v, y + v), np.array(camera.eye))
        return super().__call__(camera, shown, sheet)


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
            Tag(tag, tuple(c), tuple(tuple(p) for p in q))
            for tag, c, q, ok in zip(ids, centers.tolist(), corners.reshape(-1, 4, 2).tolist(), inside, strict=True)
            if ok
        ]
    return found


def read_truth(path: Path) -> Truth:
    """A truth.toml, as `photograph` writes it."""
    return to_record(path, read_toml(path), Truth)


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
        photo: [Tag(t["id"], moved(t["center"]), tuple(map(moved, t["corners"]))) for t in image["tags"]]
        for photo, image in images.items()
    }
    return tags, tuple(next(iter(images.values()))["size_wh"])
