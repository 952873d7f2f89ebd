"""A board of AprilTags: which tag has its centre where, in metres, and what it looks like when printed.

The board frame: X to the right, Y up, Z out of the printed face towards the viewer who sees the tags upright.
"""

import os
from typing import Annotated, Any, Literal

import cv2
import msgspec
import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import pdist

from raytwin.errors import InputError, check_one_of
from raytwin.images.limits import MAX_PIXELS
from raytwin.removed import BOARD_KEYS
from raytwin.scene import Positive, Record, Vector
from raytwin.scene.toml_json import plain, read_toml, to_record, write_toml

FAMILIES = {
    "tag36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "tag25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "tag16h5": cv2.aruco.DICT_APRILTAG_16h5,
}
"""The families that OpenCV can draw and pupil_apriltags can read; their ids are the same in both."""

PAPER, INK = 0.85, 0.04
"""Albedo of white paper and of printed black."""

Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
TagId = Annotated[int, msgspec.Meta(ge=0)]

Offsets = tuple[Vector, ...]
"""How far each tag of a board lies from its place on the flat sheet, metres, in the order of `Board.centers`."""


class Grid(Record, frozen=True):
    """Tag `first_id + row * columns + column` has its centre at (column, row) * pitch, metres: row 0 is the lowest.

    With `order = "down"` row 0 is the highest, and the other rows have y < 0.
    """

    columns: Count
    rows: Count
    pitch: Positive
    first_id: TagId = 0
    order: Literal["up", "down"] = "up"


class BoardTag(Record, frozen=True):
    id: TagId
    center: tuple[float, float]


class Board(Record, frozen=True, omit_defaults=True):
    """Tags of one family with black squares of `tag_edge` metres: either a `grid`, or a list of `tags`.

    `offsets`: the shape of the sheet, as a calibration finds it. Without any it is flat.
    """

    family: str
    tag_edge: Positive
    grid: Grid | None = None
    tags: tuple[BoardTag, ...] | None = None
    offsets: Offsets | None = None

    def centers(self) -> dict[int, tuple[float, float]]:
        """id -> (x, y) of the tag's centre on the flat sheet, metres, board frame."""
        if self.grid is None:
            return {tag.id: tag.center for tag in self.tags or ()}
        g = self.grid
        rise = g.pitch if g.order == "up" else -g.pitch
        return {
            g.first_id + row * g.columns + column: (column * g.pitch, row * rise)
            for row in range(g.rows)
            for column in range(g.columns)
        }

    def points(self, ids) -> np.ndarray:
        """(n, 3) float64: the centres of the tags `ids` on the bent sheet, metres, board frame."""
        centers = self.centers()
        places = np.c_[np.array([*centers.values()]), np.zeros(len(centers))] + (self.offsets or 0.0)
        row = {tag: i for i, tag in enumerate(centers)}
        return places[[row[i] for i in ids]].reshape(-1, 3)

    def rise(self, xy: np.ndarray) -> np.ndarray:
        """(...): the sheet's height over the board's plane at xy (..., 2), metres: smooth between the tags' heights."""
        if self.offsets is None:
            return np.zeros(xy.shape[:-1])
        # Beyond the outermost centres a quintic kernel keeps the curvature that the sheet has there.
        sheet = RBFInterpolator([*self.centers().values()], np.array(self.offsets)[:, 2], kernel="quintic")
        return np.asarray(sheet(xy.reshape(-1, 2))).reshape(xy.shape[:-1])

    def flat(self) -> "Board":
        """The same board on a flat sheet."""
        return msgspec.structs.replace(self, offsets=None)


def read_board(path: str | os.PathLike) -> Board:
    """Read a board's TOML file `path`: `family`, `tag_edge`, and either `[grid]` or `[[tags]]`, in metres.

    See Board and Grid. Raises InputError that names the wrong field.
    """
    table = read_toml(path)
    for name in BOARD_KEYS.keys() & table.keys():
        raise InputError(path, BOARD_KEYS[name], f"{name}, removed in 0.2.0")
    return parse_board(table, path)


def parse_board(table: Any, path: str | os.PathLike, key: str = "") -> Board:
    """Return the board of a table that the file has under `key`; InputError that names the wrong field."""
    board = to_record(path, table, Board, key)
    check_board(board, f"{path}: {key}" if key else path)
    return board


def write_board(path: str | os.PathLike, board: Board, comment: str = "") -> None:
    write_toml(path, plain(board), comment)


def check_board(board: Board, where: object = "board") -> None:
    """Raise InputError unless the tags exist in their family, do not overlap, and span a plane."""
    check_one_of(f"{where}: family", board.family, FAMILIES)
    if (board.grid is None) == (board.tags is None):
        found = "both" if board.grid else "neither"
        raise InputError(f"{where}: grid, tags", "either a grid or a list of tags", found)
    ids = [tag.id for tag in board.tags] if board.tags is not None else list(board.centers())
    field = "tags" if board.grid is None else "grid"
    last = len(cv2.aruco.getPredefinedDictionary(FAMILIES[board.family]).bytesList) - 1
    if max(ids, default=0) > last:
        raise InputError(f"{where}: {field}", f"ids up to {last}, the last of {board.family}", f"ids up to {max(ids)}")
    if len(set(ids)) < len(ids):
        raise InputError(f"{where}: tags", "ids that differ", f"{next(i for i in ids if ids.count(i) > 1)} twice")
    xy = np.array([*board.centers().values()]).reshape(-1, 2)
    if in_one_line(xy):
        raise InputError(f"{where}: tags", "at least 4 tags, not in one line", f"{len(xy)} tags")
    if (gap := pdist(xy, "chebyshev").min()) <= board.tag_edge:
        raise InputError(f"{where}: {field}", f"centres more than tag_edge ({board.tag_edge:g} m) apart", f"{gap:g} m")
    if board.offsets is not None and len(board.offsets) != len(xy):
        raise InputError(f"{where}: offsets", f"one for each of {len(xy)} tags", len(board.offsets))


def in_one_line(xy: np.ndarray) -> bool:
    """Whether (n, 2) points are fewer than four or in one line: no homography follows from them."""
    if len(xy) < 4:
        return True
    width = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(width[1] <= 1e-3 * width[0])


def tag_cells(family: str, tag_id: int) -> np.ndarray:
    """(n, n) float: 1 where the tag's cell is white; n counts the black border's cells on both sides."""
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
    cells = cv2.aruco.generateImageMarker(dictionary, tag_id, dictionary.markerSize + 2)
    # OpenCV stores the AprilTag families turned by half a turn against the AprilTag library's upright.
    return np.rot90(cells, 2) / 255.0


def draw_board(board: Board, pixels_per_metre: float) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """The printed sheet as albedo (h, w) float32, row 0 on top, and its extent (x_min, x_max, y_min, y_max), metres.

    Every pixel is the mean albedo over its area. White paper reaches half a tag's edge past the outermost tags, and at
    most a pixel more: the extent is w and h pixels exactly.
    """
    xy, side = np.array([*board.centers().values()]), board.tag_edge * pixels_per_metre
    low, high = xy.min(axis=0) - board.tag_edge, xy.max(axis=0) + board.tag_edge
    width, height = (int(n) for n in np.ceil((high - low) * pixels_per_metre - 1e-9))
    if width * height > MAX_PIXELS:
        raise InputError("pixels_per_metre", f"at most {MAX_PIXELS / 1e6:.0f} megapixels", f"{width} x {height}")
    # The surplus of the rounding goes to both sides alike.
    half = np.array([width, height]) / pixels_per_metre / 2
    (x_min, y_min), (x_max, y_max) = (low + high) / 2 - half, (low + high) / 2 + half
    sheet = np.full((height, width), PAPER, np.float32)
    for tag_id, (x, y) in board.centers().items():
        cells = INK + (PAPER - INK) * tag_cells(board.family, tag_id)
        columns, across = _coverage((x - x_min) * pixels_per_metre - side / 2, side, len(cells))
        rows, down = _coverage((y_max - y) * pixels_per_metre - side / 2, side, len(cells))
        sheet[rows, columns] += (down @ (cells - PAPER) @ across.T).astype(np.float32)
    return sheet, (float(x_min), float(x_max), float(y_min), float(y_max))


def _coverage(start: float, length: float, cells: int) -> tuple[slice, np.ndarray]:
    """How much of each pixel each of `cells` equal intervals of [start, start + length] covers: (pixels, cells)."""
    edges = start + length * np.arange(cells + 1) / cells
    first, last = int(np.floor(edges[0])), int(np.ceil(edges[-1]))
    pixel = np.arange(first, last)[:, None]
    overlap = np.minimum(pixel + 1, edges[1:]) - np.maximum(pixel, edges[:-1])
    return slice(first, last), np.clip(overlap, 0, None)
