"""The board's plane: the albedo that is printed on the sheet, and the light that the photos show of it."""

import math
from collections.abc import Callable

import cv2
import numpy as np

from raytwin.photos.boards.board import PAPER, Board, draw_board
from raytwin.photos.lighting.linear_photo import LinearPhoto, sample


class Sheet:
    """The printed sheet in relative albedo, white 1; NaN beyond the sheet."""

    def __init__(self, board: Board, per_metre: float = 2000.0) -> None:
        albedo, self.extent = draw_board(board, per_metre)
        self.albedo, self.per_metre = albedo / np.float32(PAPER), per_metre

    def at(self, xy: np.ndarray, blur: float = 0.0) -> np.ndarray:
        """(n,): relative albedo at (n, 2), blurred by `blur` metres."""
        return self._look(cv2.GaussianBlur(self.albedo, (0, 0), blur * self.per_metre) if blur else self.albedo, xy)

    def plain_at(self, xy: np.ndarray, reach: float) -> np.ndarray:
        """(n,) bool: no edge between ink and paper within `reach` metres."""
        square = np.ones((1 + 2 * math.ceil(reach * self.per_metre),) * 2, np.uint8)
        span = cv2.dilate(self.albedo, square) - cv2.erode(self.albedo, square)
        return np.nan_to_num(self._look(span, xy), nan=1.0) < 0.05

    def _look(self, image: np.ndarray, xy: np.ndarray) -> np.ndarray:
        x0, _, _, y1 = self.extent
        return sample(image, np.stack([(xy[:, 0] - x0), (y1 - xy[:, 1])], axis=1) * self.per_metre - 0.5)


def seen_light(
    photos: list[LinearPhoto], places: np.ndarray, hidden: Callable[[LinearPhoto], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3), (n,) bool: the mean light of places (n, 3) over the photos where they are not `hidden`, 0 where no photo
    shows them, and whether one does."""
    layers = []
    for photo in photos:
        light = photo.at(photo.project(places))
        light[hidden(photo)] = np.nan
        layers.append(light)
    count = np.isfinite(layers).sum(axis=0)
    return np.nansum(layers, axis=0) / np.maximum(count, 1), (count > 0).all(axis=-1)


def on_board(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 2): where rays meet the board's plane; NaN where they do not go down."""
    down = directions[:, 2] < -0.02
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(down, -points[:, 2] / directions[:, 2], np.nan)
    return points[:, :2] + t[:, None] * directions[:, :2]
