"""The board's plane: the albedo that is printed on the sheet, and the light that the photos show of it."""

import math
from collections.abc import Callable

import cv2
import numpy as np

from raytwin.calib.boards.board import PAPER, Board, draw_board
from raytwin.calib.lighting.ball_outline import Ball
from raytwin.calib.lighting.linear_photo import LinearPhoto, sample
from raytwin.lights.envmap_tables import REC_709

PER_METRE = 1333.0
"""Places per metre of the sheet at which its light is looked up."""

MARGIN = 0.004
"""Metres from the sheet's edge within which its light is not used."""


class Sheet:
    """The printed sheet in relative albedo, white 1, and its light as the photos show it; NaN beyond the sheet."""

    def __init__(self, board: Board, per_metre: float = 2000.0) -> None:
        albedo, self.extent = draw_board(board, per_metre)
        self.albedo, self.per_metre = albedo / np.float32(PAPER), per_metre

    def at(self, xy: np.ndarray, blur: float = 0.0) -> np.ndarray:
        """(n,): relative albedo at (n, 2), blurred by `blur` metres."""
        return self._look(blurred(self.albedo, blur * self.per_metre), xy)

    def plain_at(self, xy: np.ndarray, reach: float) -> np.ndarray:
        """(n,) bool: no edge between ink and paper within `reach` metres."""
        square = np.ones((1 + 2 * math.ceil(reach * self.per_metre),) * 2, np.uint8)
        span = cv2.dilate(self.albedo, square) - cv2.erode(self.albedo, square)
        return np.nan_to_num(self._look(span, xy), nan=1.0) < 0.05

    def _look(self, image: np.ndarray, xy: np.ndarray) -> np.ndarray:
        x0, _, _, y1 = self.extent
        return sample(image, np.stack([(xy[:, 0] - x0), (y1 - xy[:, 1])], axis=1) * self.per_metre - 0.5)


class SheetLight:
    """How bright the photos show the sheet: their mean over those in which `ball` does not hide it."""

    def __init__(self, photos: list[LinearPhoto], sheet: Sheet, ball: Ball) -> None:
        self.extent = x0, x1, y0, y1 = sheet.extent
        x, y = np.arange(x0, x1, 1 / PER_METRE), np.arange(y1, y0, -1 / PER_METRE)
        shape, places = (len(y), len(x)), np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1)
        places = places.reshape(-1, 3)
        light, seen = seen_light(photos, places, lambda photo: hidden_by(photo, ball, places))
        self.seen = seen.reshape(shape).astype(np.float32)
        self.light = (light @ REC_709).reshape(shape).astype(np.float32)

    def blurred(self, sigma: float) -> np.ndarray:
        """(h, w): the light, blurred by `sigma` metres; places that no photo shows have that of those around them."""
        light, seen = (blurred(a, sigma * PER_METRE) for a in (self.light, self.seen))
        far, near = (cv2.GaussianBlur(a, (0, 0), 60) for a in (self.light, self.seen))
        return (light + 1e-3 * far / np.maximum(near, 1e-6)) / (seen + 1e-3)

    def look(self, image: np.ndarray, xy: np.ndarray) -> np.ndarray:
        """(n,) values of `image` at (n, 2), those beyond the sheet as at its edge."""
        x0, _, _, y1 = self.extent
        at = np.nan_to_num(np.stack([xy[:, 0] - x0, y1 - xy[:, 1]], axis=1) * PER_METRE)
        return sample(image, np.clip(at, 0, np.array(image.shape[::-1]) - 1))

    def known(self, xy: np.ndarray) -> np.ndarray:
        """(n,) bool: well within the sheet, and seen in a photo."""
        x0, x1, y0, y1 = self.extent
        x, y = np.nan_to_num(xy, nan=1e9).T
        inside = (x > x0 + MARGIN) & (x < x1 - MARGIN) & (y > y0 + MARGIN) & (y < y1 - MARGIN)
        return inside & (self.look(cv2.erode(self.seen, np.ones((7, 7))), xy) > 0.99)


def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), sigma) if sigma > 0 else image


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


def hidden_by(photo: LinearPhoto, ball: Ball, places: np.ndarray) -> np.ndarray:
    """(n,) bool: the ball, a little widened, stands between the eye and places (n, 3)."""
    eye = np.array(photo.camera.eye)
    to = places - eye
    t = np.clip((to @ (ball.center - eye)) / (to * to).sum(axis=1), 0, 1)
    return np.linalg.norm(eye + t[:, None] * to - ball.center, axis=1) < 1.05 * ball.radius


def on_board(points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 2): where rays meet the board's plane; NaN where they do not go down."""
    down = directions[:, 2] < -0.02
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(down, -points[:, 2] / directions[:, 2], np.nan)
    return points[:, :2] + t[:, None] * directions[:, :2]
