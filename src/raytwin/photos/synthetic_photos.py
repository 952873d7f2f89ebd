"""The synthetic photographer: walks around a board with a known camera, and writes down where it stood.

Only the camera's side: where to stand, what lens and sensor make of the light, the files. The light itself comes from
a `render` that the caller passes in.
"""

import math
import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from raytwin.errors import InputError
from raytwin.images.photo_files import to_bytes, write_picture
from raytwin.photos.boards.board import Board, check_board, draw_board, write_board
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.pose import rotation
from raytwin.progress import Progress, silent
from raytwin.scene import Camera, Matrix, PixelCount, Record, Rectangle, Vector
from raytwin.scene.toml_json import plain, write_toml

Render = Callable[[Camera, np.ndarray, Rectangle], np.ndarray]
"""render(camera, texture, sheet) -> linear radiance (H, W, 3), 1 is white.

`texture` (h, w) float32 is the sheet's albedo, row 0 at the end of +half_v, column 0 at the end of -half_u.
"""

TILT_DEGREES = 50.0
"""Degrees: the largest tilt of the board."""
SMALLEST_TAG_PX = 24.0
"""A tag's shortest side in a photo: three pixels a cell, what the detector reads surely."""

VIGNETTING, FULL_WELL, READ_NOISE = 0.3, 8000.0, 4.0
"""How much of the natural cos^4 of the angle off the axis the lens leaves in (1: all, 0: none); electrons of a pixel at
radiance 1; standard deviation of what reading adds, electrons."""

QUALITY = 88
"""JPEG quality of the photos, as cameras write them."""
TRIES = 200
"""Attempts to place the board in a frame, each less tilted and nearer to the middle."""
MAX_TEXTURE = 16_000_000
"""Pixels of the board's texture: bounds the memory."""


class Truth(Record, frozen=True):
    """The true camera, and for each photo its true (R_cam_board, t_cam_board): what calibration should find."""

    image_size: tuple[PixelCount, PixelCount]
    K: Matrix
    dist: tuple[float, ...]
    photos: dict[str, tuple[Matrix, Vector]]


def write_truth(path: str | os.PathLike, truth: Truth) -> None:
    comment = (
        "The camera that took these photos, without error. image_size and K in pixels; dist is a prefix of\n"
        "k1, k2, p1, p2, k3; each photo is [R_cam_board, t_cam_board], p_cam = R_cam_board @ p_board + t_cam_board."
    )
    write_toml(path, plain(truth), comment)


def photograph(
    board: Board,
    camera: Camera,
    count: int,
    out: str | os.PathLike,
    render: Render,
    *,
    seed: int = 1,
    progress: Progress = silent,
) -> Truth:
    """`count` photos of the board by `camera` (its pose is not used), written to `out` with board.toml and truth.toml.

    The truth is written last: where it is, the photos are whole.
    """
    check_board(board)
    out = Path(out)
    rng = np.random.default_rng(seed)
    stands = poses(board, camera, count, rng)
    # Two texels a pixel where the camera is nearest: the sheet is sharper than the photo.
    points = board.points(board.centers())
    nearest = min(float((points @ np.array(R[2]) + t[2]).min()) for R, t in stands)
    density = 2 * max(camera.fx, camera.fy) / nearest
    affordable = 1000.0 * math.sqrt(MAX_TEXTURE / draw_board(board, 1000.0)[0].size)
    texture, extent = draw_board(board, min(density, affordable))
    sheet = sheet_of(extent)
    truth = {}
    progress("photograph", 0, count)
    for i, (R, t) in enumerate(stands):
        view = Camera(camera.image_size, camera.K, R, t, camera.dist)
        name = f"photo_{i:02d}.jpg"
        write_picture(out / name, expose(render(view, texture, sheet), rng, view), quality=QUALITY)
        truth[name] = (R, t)
        progress("photograph", i + 1, count)
    written = Truth(camera.image_size, camera.K, camera.dist, truth)
    write_board(out / "board.toml", board)
    write_truth(out / "truth.toml", written)
    return written


def sheet_of(extent: tuple[float, float, float, float]) -> Rectangle:
    """The paper of draw_board's extent (x_min, x_max, y_min, y_max) as a rectangle at z = 0."""
    x0, x1, y0, y1 = extent
    return Rectangle(
        ((x0 + x1) / 2, (y0 + y1) / 2, 0.0), ((x1 - x0) / 2, 0.0, 0.0), (0.0, (y1 - y0) / 2, 0.0), in_photo=True
    )


def poses(board: Board, camera: Camera, count: int, rng: np.random.Generator) -> list[tuple[Matrix, Vector]]:
    """`count` (R_cam_board, t_cam_board) as a careful person would choose them.

    Tilts are spread evenly over 0 to 50 degrees, towards every side; the board is put into the middle of the frame and
    towards each corner and edge in turn, and comes as near as it can while all of its tags (off the middle, most of
    them) are in the frame; the camera is rolled a little, and now and then by a quarter turn.
    """
    tilts = TILT_DEGREES * rng.permutation((np.arange(count) + rng.uniform(size=count)) / count)
    places = [(0, 0), *[(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0)]]
    turn = rng.uniform(0, 360)
    found = []
    for i in range(count):
        place = np.array(places[i % len(places)])
        for attempt in range(TRIES):
            # The golden angle spreads the sides that the board leans to, however many photos there are.
            azimuth = math.radians(turn + 137.508 * i + rng.normal(0, 15))
            roll = math.radians(rng.normal(0, 10) + 90 * rng.choice([0, 0, 0, 0, 1, -1]))
            tilt = math.radians(tilts[i]) * (1 - attempt / TRIES)
            aim = place * rng.uniform(0.15, 0.26, 2) * (1 - attempt / TRIES)
            lean, _ = cv2.Rodrigues(np.array([tilt * math.cos(azimuth), tilt * math.sin(azimuth), 0]))
            R = cv2.Rodrigues(np.array([0, 0, roll]))[0] @ lean @ np.diag([1, -1, -1])
            share, slack = 0.65 if place.any() else 1.0, rng.uniform(1.0, 1.2)
            t = _stand(board, camera, R, aim, share, slack)
            if t is not None:
                found.append((rotation(R), tuple(t.tolist())))
                break
        else:
            raise InputError(
                "image_size", f"pixels enough for tags of {SMALLEST_TAG_PX:.0f} px", f"{camera.width} x {camera.height}"
            )
    return found


def _stand(board: Board, camera: Camera, R: np.ndarray, aim: np.ndarray, share: float, slack: float):
    """The nearest t (times slack) that shows `share` of the tags with the board's middle at `aim`; None if none does.

    `aim` is in image sides, from the image's middle.
    """
    centers = board.points(board.centers())
    half = board.tag_edge / 2
    around = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    corners = centers[:, None] + around
    size = np.array(camera.image_size)
    x, y = lens_model.undistort(((0.5 + aim) * size - 0.5)[None], np.array(camera.K), camera.dist)[0]
    middle = (centers.min(axis=0) + centers.max(axis=0)) / 2
    reach = np.linalg.norm(np.ptp(centers, axis=0)) + board.tag_edge
    for distance in reach * camera.fx / max(camera.image_size) * np.geomspace(0.4, 6, 80):
        t = slack * distance * np.array([x, y, 1.0]) - R @ middle
        cam = corners.reshape(-1, 3) @ R.T + t
        if cam[:, 2].min() < 0.1 * distance:
            continue
        pixels = lens_model.project(corners.reshape(-1, 3), R, t, np.array(camera.K), camera.dist)
        border = 0.01 * size.min()
        inside = (pixels > border).all(axis=1) & (pixels < size - 1 - border).all(axis=1)
        if inside.reshape(-1, 4).all(axis=1).mean() >= share:
            inside &= lens_model.grows(cam / (1, 1, 1.02), camera.dist)  # past it the lens model folds back
        inside = inside.reshape(-1, 4).all(axis=1)
        if inside.mean() >= share and inside.sum() >= 4:
            quads = pixels.reshape(-1, 4, 2)[inside]
            edges = np.linalg.norm(quads - np.roll(quads, 1, axis=1), axis=-1)
            return t if edges.min() >= SMALLEST_TAG_PX else None
    return None


def expose(radiance: np.ndarray, rng: np.random.Generator, camera: Camera) -> np.ndarray:
    """sRGB uint8 (H, W, 3) of linear radiance (H, W, 3) seen by a sensor: electrons = N cos^(4v) radiance.

    N = FULL_WELL, v = VIGNETTING. Photon noise has variance electrons (a normal distribution stands for Poisson's: they
    differ below a dozen electrons).
    """
    height, width = radiance.shape[:2]
    x = (np.arange(width, dtype=np.float32) - camera.cx) / camera.fx
    y = (np.arange(height, dtype=np.float32) - camera.cy) / camera.fy
    squared = y[:, None] ** 2 + x[None, :] ** 2
    falloff = (1 + squared) ** (-2 * VIGNETTING)  # cos² = 1 / (1 + tan²)
    electrons = np.asarray(radiance, np.float32) * (falloff * np.float32(FULL_WELL))[..., None]
    noise = rng.standard_normal(electrons.shape, dtype=np.float32)
    electrons = electrons + noise * np.sqrt(np.maximum(electrons, 0) + np.float32(READ_NOISE**2))
    return to_bytes(electrons / np.float32(FULL_WELL))
