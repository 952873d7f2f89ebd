"""A photo as linear light relative to the board's white paper.

Codes become linear by sRGB's curve, colours Rec. 709's by the photo's profile. Then the lens's falloff, a power of the
cosine of the angle off the axis, is divided out, and each photo is scaled so that white paper in full light has the
same colour in all, of luminance 1: exposure and white balance drop out. The black and white cells of the tags are what
all this is measured by, and checked against.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from raytwin.errors import InputError
from raytwin.images.photo_files import from_bytes, photo_extras, photo_orientation, read_photo
from raytwin.photos.augment.colour import to_rec709
from raytwin.photos.boards.board import Board, tag_cells
from raytwin.photos.camera import lens_model
from raytwin.scene import Camera
from raytwin.tracer.lights.envmap_tables import REC_709

CLIPPED = 252
"""Codes from here on are taken for clipped: a JPEG's rounding moves 255 by a few."""

BURNT = 249
"""Least code of all channels in a lamp: JPEG mixes a small one's colours with its surroundings'. In four photos lamps
of a few pixels have 247 to 252 on average, and sunlit walls of which red alone is clipped up to 245."""

LINE = 1 << 12
"""Places that OpenCV is given in a row: it takes no more than 32767."""

CELL_PX = 3.0
"""The least side of a tag's cell in pixels from which its middle is free of its neighbours."""

FALLOFF = 1.0, 1.0
"""Exponent of the cosine, and its standard deviation, before the photos are asked: phones correct most of cos⁴."""

INK = 0.012, 0.12
"""Black over white in linear light: what ink on paper gives under any light, some glare included."""


@dataclass(frozen=True, eq=False)
class LinearPhoto:
    """`light` (H, W, 3): linear, paper in full light is 1 in luminance; `clipped` (H, W); `paper` (3): linear value of
    paper in full light as the photo has it on the lens's axis; `shade` (H, W): the falloff from there; `turn`: its EXIF
    orientation, which is not applied."""

    name: str
    camera: Camera
    light: np.ndarray
    clipped: np.ndarray
    pixels: np.ndarray
    paper: np.ndarray
    shade: np.ndarray
    turn: int = 1

    @property
    def burnt(self) -> np.ndarray:
        """(H, W) bool: clipped in every channel. What is clipped in one alone is hardly brighter than white."""
        return self.pixels.min(axis=-1) >= BURNT

    def project(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) pixels of board points (n, 3)."""
        c = self.camera
        return lens_model.project(points, c.R_cam_board, c.t_cam_board, c.K, c.dist)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 3): unit directions of the pixels (n, 2), board's axes."""
        d = np.c_[lens_model.undistort(pixels, self.camera.K, self.camera.dist), np.ones(len(pixels))]
        return d / np.linalg.norm(d, axis=1, keepdims=True) @ np.array(self.camera.R_cam_board)

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 3): the light at pixels (n, 2), bilinear; NaN outside the frame and where clipped."""
        found = sample(self.light, pixels)
        found[sample(self.clipped.astype(np.float32), pixels) > 0] = np.nan
        return found


def value_of_one(photo: LinearPhoto, paper: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32: the photo's linear value of radiance 1, where white paper in full light has `paper` (3)."""
    return photo.shade[..., None] * (photo.paper / paper).astype(np.float32)


def sample(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Bilinear values of an image (H, W, ...) at pixels (n, 2); NaN outside the frame."""
    h, w = image.shape[:2]
    u, v = (np.ascontiguousarray(pixels[:, i], np.float32) for i in (0, 1))
    lines = (np.resize(a, (-(-len(a) // LINE), LINE)) if len(a) else a.reshape(0, 1) for a in (u, v))
    found = cv2.remap(image, *lines, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) if len(u) else image[:0, :0]
    found = found.reshape(-1, *image.shape[2:])[: len(u)].astype(float)
    outside = ~((u >= 0) & (u <= w - 1) & (v >= 0) & (v <= h - 1))
    found[outside] = np.nan
    return found


@dataclass(frozen=True, eq=False)
class _Cells:
    """The middles of a board's cells in one photo: `linear` (n, 3), `white` (n,), `cosine` (n,) off the axis."""

    linear: np.ndarray
    codes: np.ndarray
    white: np.ndarray
    cosine: np.ndarray


def read_linear(
    paths: list[Path], cameras: list[Camera], board: Board
) -> tuple[list[LinearPhoto], np.ndarray, list[str]]:
    """The photos taken by `cameras`, what paper in full light has in each of them (3), and warnings in words.

    The paper's colour is that of the first photo, of luminance 1.
    """
    raw = [(read_photo(p), photo_extras(p)) for p in paths]
    linear = [from_bytes(px) @ to_rec709(x.get("icc_profile")).T.astype(np.float32) for px, x in raw]
    cells = [
        _cells(image, pixels, camera, board, path)
        for image, (pixels, _), camera, path in zip(linear, raw, cameras, paths, strict=True)
    ]
    exponent, papers = _falloff(cells)
    colour = papers[0] / (papers[0] @ REC_709)
    found = []
    for path, camera, image, (pixels, _), paper in zip(paths, cameras, linear, raw, papers, strict=True):
        shade = _cosines(camera) ** np.float32(exponent)
        light = image * (colour / paper).astype(np.float32) / shade[..., None]
        clipped = pixels.max(axis=-1) >= CLIPPED
        found.append(LinearPhoto(path.name, camera, light, clipped, pixels, paper, shade, photo_orientation(path)))
    return found, colour, _warnings(found, cells, exponent)


def _cells(image: np.ndarray, pixels: np.ndarray, camera: Camera, board: Board, path: Path) -> _Cells:
    points, white = [], []
    for tag, centre in board.centers().items():
        cells = tag_cells(board.family, tag)
        n = len(cells)
        middles = ((np.arange(n) + 0.5) / n - 0.5) * board.tag_edge
        x, y = np.meshgrid(centre[0] + middles, centre[1] - middles)
        points.append(np.stack([x, y], axis=-1).reshape(-1, 2))
        white.append(cells.reshape(-1) > 0.5)
        gap = board.tag_edge / n  # paper beside the tag, half a cell out
        ring = (board.tag_edge + gap) / 2 * np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1)])
        points.append(np.add(centre, ring))
        white.append(np.ones(len(ring), bool))
    xy, is_white = np.concatenate(points), np.concatenate(white)
    place = np.c_[xy, board.rise(xy)]
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
    at = lens_model.project(place, R, t, camera.K, camera.dist)
    side = board.tag_edge / n * min(camera.fx, camera.fy) / (place @ R.T + t)[:, 2]
    size = np.array(camera.image_size)
    good = (at > 2).all(axis=1) & (at < size - 3).all(axis=1) & (side > CELL_PX)
    if good.sum() < 50:
        raise InputError(path, f"tags whose cells are {CELL_PX:.0f} pixels wide, to measure light by", "smaller ones")
    d = np.c_[lens_model.undistort(at[good], camera.K, camera.dist), np.ones(good.sum())]
    codes = sample(pixels.max(axis=-1).astype(np.float32), at[good])
    return _Cells(sample(image, at[good]), codes, is_white[good], 1 / np.linalg.norm(d, axis=1))


def _falloff(cells: list[_Cells]) -> tuple[float, list[np.ndarray]]:
    """The exponent of the cosine that all photos share, and each photo's paper in full light on the axis (3).

    By white cells in full light: those within a tenth of the brightest, once the falloff is undone.
    """
    exponent, sd = FALLOFF
    for _ in range(5):
        rows, values, logs = [], [], []
        for i, c in enumerate(cells):
            level = np.log(np.maximum(c.linear[c.white] @ REC_709, 1e-6))
            x = np.log(c.cosine[c.white])
            flat = level - exponent * x
            top = np.quantile(flat, 0.9)
            lit = np.abs(flat - np.median(flat[flat > top - 0.2])) < 0.1
            logs.append(lit)
            one = np.zeros((lit.sum(), len(cells) + 1))
            one[:, i], one[:, -1] = 1, x[lit]
            rows.append(one)
            values.append(level[lit])
        scatter = 0.03  # of paper in full light: bounced light, hidden sky
        prior = np.zeros((1, len(cells) + 1))
        # Cells of one photo err together: as many as there are say no more than some twenty.
        prior[0, -1] = scatter / sd * np.sqrt(sum(map(len, values)) / (20 * len(cells)))
        A, b = np.concatenate([*rows, prior]), np.concatenate([*values, prior[0, -1:] * FALLOFF[0]])
        exponent = float(np.clip(np.linalg.lstsq(A, b, rcond=None)[0][-1], 0, 5))
    papers = [
        np.median((c.linear[c.white] / c.cosine[c.white, None] ** exponent)[lit], axis=0)
        for c, lit in zip(cells, logs, strict=True)
    ]
    return exponent, papers


def _cosines(camera: Camera) -> np.ndarray:
    """(H, W) float32: the cosine of each pixel's angle off the axis; the lens's bend is too small to matter here."""
    x = ((np.arange(camera.width) - camera.cx) / camera.fx).astype(np.float32)
    y = ((np.arange(camera.height) - camera.cy) / camera.fy).astype(np.float32)
    return 1 / np.sqrt(1 + y[:, None] ** 2 + x**2)


def _warnings(found: list[LinearPhoto], cells: list[_Cells], exponent: float) -> list[str]:
    warnings = []
    for photo, c in zip(found, cells, strict=True):
        lit = c.white & (c.linear @ REC_709 > 0.7 * (photo.paper @ REC_709))
        if (share := (c.codes[lit] >= CLIPPED).mean()) > 0.1:
            warnings.append(
                f"{photo.name}: {100 * share:.0f} % of the paper in full light is clipped, so that all light comes out"
                " too strong beside it: expose less"
            )
        flat = c.linear @ REC_709 / c.cosine**exponent
        ratio = np.median(flat[~c.white]) / np.median(flat[c.white])
        if not INK[0] < ratio < INK[1]:
            warnings.append(
                f"{photo.name}: the tags' black is {100 * ratio:.2g} % of their white, where ink gives"
                f" {100 * INK[0]:.0f} to {100 * INK[1]:.0f} %: the photo was tone-mapped, or veiled by glare"
            )
    return warnings
