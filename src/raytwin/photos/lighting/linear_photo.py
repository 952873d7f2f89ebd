"""A photo as linear light relative to the board's white paper.

sRGB's curve makes codes linear. Then the lens's falloff, a power of the cosine of the angle off the axis, is divided
out, and the photo is scaled so that white paper in full light has luminance 1. Both come from the white around tags.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates

from raytwin.errors import InputError
from raytwin.images.photo_files import from_bytes, read_photo
from raytwin.photos.boards.board import Board, tag_cells
from raytwin.photos.camera import lens_model
from raytwin.scene import Camera
from raytwin.tracer.lights.envmap_tables import REC_709

CLIPPED_CODE = 252
"""Least code that counts as clipped: JPEG changes 255 by a few."""

LAMP_CODE = 249
"""Least code of all channels in a lamp: JPEG mixes the colours of a small one with its surroundings'. In four photos
lamps of a few pixels have 247 to 252 on average, and sunlit walls whose red alone is clipped up to 245."""

LEAST_CELL_PX, LEAST_CELLS = 3.0, 25
"""Least side in pixels of a tag's cell, whose middle is then free of its neighbours; least number of such cells."""

FALLOFF, FALLOFF_WEIGHT = 1.0, 5e-5
"""Expected exponent of the cosine; how it is weighted, as a variance of the cosine's logarithm over the cells."""

MAX_CLIPPED_SHARE = 0.1
"""Largest share of paper in full light that may be clipped without a warning."""


@dataclass(frozen=True, eq=False)
class LinearPhoto:
    """`light` (H, W, 3): linear, paper in full light is 1 in luminance; `clipped` (H, W); `paper` (3): linear value of
    paper in full light as the photo has it on the lens's axis; `shade` (H, W): the falloff from there. `warnings`: what
    makes it a doubtful measure of light."""

    name: str
    camera: Camera
    light: np.ndarray
    clipped: np.ndarray
    pixels: np.ndarray
    paper: np.ndarray
    shade: np.ndarray
    warnings: tuple[str, ...] = ()

    @property
    def paper_colour(self) -> np.ndarray:
        """(3): white paper in full light, of luminance 1."""
        return self.paper / (self.paper @ REC_709)

    def value_of_one(self, paper: np.ndarray) -> np.ndarray:
        """Return the photo's linear value of radiance 1 (H, W, 3), where `paper` (3) is that of paper in full light."""
        return self.shade[..., None] * (self.paper / paper).astype(np.float32)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels (n, 2) of board points (n, 3)."""
        c = self.camera
        return lens_model.project(points, c.R_cam_board, c.t_cam_board, c.K, c.dist)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Return unit directions (n, 3), in the board's axes, of the pixels (n, 2)."""
        d = np.c_[lens_model.undistort(pixels, self.camera.K, self.camera.dist), np.ones(len(pixels))]
        return d / np.linalg.norm(d, axis=1, keepdims=True) @ np.array(self.camera.R_cam_board)


def sample(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return bilinear values of an image (H, W, ...) at pixels (n, 2); NaN outside the frame."""
    layers = np.moveaxis(image.reshape(*image.shape[:2], -1), -1, 0)
    at = pixels.T[::-1]
    found = [map_coordinates(layer, at, output=float, order=1, cval=np.nan) for layer in layers]
    return np.stack(found, axis=-1).reshape(-1, *image.shape[2:])


def read_linear(path: Path, camera: Camera, board: Board) -> LinearPhoto:
    """Return the photo taken by `camera`. Raises InputError where its tags are too small."""
    pixels = read_photo(path)
    linear = from_bytes(pixels)
    at = _white_cells(camera, board)
    if len(at) < LEAST_CELLS:
        raise InputError(path, f"tags with cells {LEAST_CELL_PX:.0f} pixels wide, to measure light by", "smaller ones")
    x = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
    y = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
    cosine = 1 / np.sqrt(1 + y[:, None] ** 2 + x**2)  # the lens's bend is too small to matter here
    of_cells, cosines = sample(linear, at), sample(cosine, at)
    exponent, lit = _falloff(of_cells @ REC_709, cosines)
    flat = of_cells / cosines[:, None] ** exponent
    paper, shade = np.median(flat[lit], axis=0), cosine ** np.float32(exponent)
    light = linear / np.float32(paper @ REC_709) / shade[..., None]
    clipped = pixels.max(axis=-1) >= CLIPPED_CODE
    share, warnings = sample(clipped.astype(np.float32), at[lit]).mean(), list[str]()
    if share > MAX_CLIPPED_SHARE:
        what = f"{path.name}: {100 * share:.0f} % of the paper in full light is clipped"
        warnings.append(f"{what}, so that all light comes out too strong beside it: expose less")
    return LinearPhoto(path.name, camera, light, clipped, pixels, paper, shade, tuple(warnings))


def _white_cells(camera: Camera, board: Board) -> np.ndarray:
    """Return the pixels (n, 2) of places half a cell outside the tags' edges that are seen large enough."""
    cells = len(tag_cells(board.family, 0))
    side = ((np.arange(cells) + 0.5) / cells - 0.5) * board.tag_edge
    across = np.full(cells, board.tag_edge * (0.5 + 0.5 / cells))
    x, y = np.concatenate([across, -across]), np.tile(side, 2)
    ring = np.stack([np.concatenate([x, y]), np.concatenate([y, x])], axis=-1)
    xy = (np.array(list(board.centers().values()))[:, None] + ring).reshape(-1, 2)
    there = np.c_[xy, board.rise(xy)]
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    at = lens_model.project(there, R, t, camera.K, camera.dist)
    wide = board.tag_edge / cells * min(camera.fx, camera.fy) / (there @ R.T + t)[:, 2]
    good = (at > 2).all(axis=1) & (at < np.array(camera.image_size) - 3).all(axis=1) & (wide > LEAST_CELL_PX)
    return at[good]


def _falloff(white: np.ndarray, cosine: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the exponent of the cosine, and which of the white cells (n,) are in full light: those within a tenth of
    the brightest, once the falloff is undone."""
    level, x, exponent = np.log(np.maximum(white, 1e-6)), np.log(cosine), FALLOFF
    for _ in range(5):
        flat = level - exponent * x
        top = np.quantile(flat, 0.9)
        lit = np.abs(flat - np.median(flat[flat > top - 0.2])) < 0.1
        covariance = np.cov(x[lit], level[lit])
        slope = (covariance[0, 1] + FALLOFF_WEIGHT * FALLOFF) / (covariance[0, 0] + FALLOFF_WEIGHT)
        exponent = float(np.clip(slope, 0, 5))
    return exponent, lit
