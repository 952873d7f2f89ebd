"""Tags of a board, seen from many sides -> K, distortion, poses: min sum |project(board) - tag|², for a given model.

Zhang's closed form, then Levenberg-Marquardt over everything, both by cv2.calibrateCamera.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from raytwin.boards.board import Board
from raytwin.errors import InputError
from raytwin.photos import lens, pose
from raytwin.photos.detection import Tag
from raytwin.scene import Record

NAMES = ("k1", "k2", "p1", "p2", "k3")

MODELS: dict[str, tuple[str, ...]] = {
    "none": (),
    "k1": ("k1",),
    "k1k2": ("k1", "k2"),
    "k1k2p1p2": ("k1", "k2", "p1", "p2"),
    "k1k2k3": ("k1", "k2", "k3"),
    "full5": NAMES,
}
"""The coefficients that each model fits; the others are 0. To add one: a row here (OpenCV's five are all there are)."""

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-10)
"""No step once the parameters move by less than this share. Sound views take ten or twenty; views that hardly tell one
parameter from another take hundreds, and a fit that stops before is a thousand pixels off and claims to know."""


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV on one thread meanwhile: on several it adds up in any order, and no two fits end in the same bits."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


class Seen(Record, frozen=True):
    """The board's tags in one photo, none of them unknown to the board; internal to the fit."""

    photo: str
    tags: tuple[Tag, ...]


@dataclass(frozen=True, eq=False)
class Fit:
    """What one run of the optimizer gives."""

    K: np.ndarray
    dist: tuple[float, ...]
    sigma: dict[str, float]
    rms_px: float
    poses: tuple[tuple[np.ndarray, np.ndarray], ...]


def fit(views: Sequence[Seen], image_size: tuple[int, int], board: Board, model: str, start: Fit | None = None) -> Fit:
    """K, distortion and poses of least squared pixel distance; from `start`'s K and distortion where given."""
    free = MODELS[model]
    flags = sum(getattr(cv2, f"CALIB_FIX_K{n}") for n in (1, 2, 3) if f"k{n}" not in free)
    flags |= 0 if "p1" in free else cv2.CALIB_ZERO_TANGENT_DIST
    K, dist = None, None
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
        K, dist = start.K.copy(), lens.five(start.dist)
    both = [pose.matched(v.tags, board) for v in views]
    try:
        with one_thread():
            rms, K, dist, rvecs, tvecs, deviations, _, _ = cv2.calibrateCameraExtended(
                [p.astype(np.float32) for p, _ in both],
                [p.astype(np.float32) for _, p in both],
                image_size,
                K,
                dist,
                flags=flags,
                criteria=CRITERIA,
            )
    except cv2.error as error:
        raise InputError("views", "photos from which a camera follows", error.err or "none") from None
    if not (np.isfinite(K).all() and np.isfinite(dist).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise InputError("views", "photos from which a camera follows", f"fx, fy = {K[0, 0]:.4g}, {K[1, 1]:.4g}")
    sd = dict(zip(("fx", "fy", "cx", "cy", *NAMES), deviations.ravel()[:9].tolist(), strict=True))
    count = max((NAMES.index(n) + 1 for n in free), default=0)
    return Fit(
        K,
        tuple(dist.ravel()[:count].tolist()),
        {n: sd[n] for n in ("fx", "fy", "cx", "cy", *free)},
        float(rms),
        tuple((cv2.Rodrigues(r)[0], t.ravel()) for r, t in zip(rvecs, tvecs, strict=True)),
    )
