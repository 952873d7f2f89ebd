"""How true a calibration's sigmas are, and what it predicts beside a plain cv2.calibrateCamera.

    python -m measure.calibration_trust [--record] [SET...]

Each set of photos is split at random into halves. *halves*: by how many of their joint sigmas fx, fy, cx and cy of the
two calibrations differ (rms; 1 is honest). *truth*: by how many of its sigmas the whole set's K is off (rms). *unseen*:
the median distance of a half's tags from where the camera calibrated from the other half sees them, over the same by
OpenCV with five coefficients on a flat board; only the poses are fitted. Frame, lens, board and poses of the synthetic
sets are drawn at random: nothing was tuned on them.
"""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np
from measure import record
from photo_helpers import BentRenderer, PlainRenderer, a_camera, stored_board, stored_tags

from raytwin.photos.boards import Board, Grid
from raytwin.photos.camera import Calibration, Tag, calibrate_detections, detect_photos
from raytwin.photos.camera.bias import unbiased
from raytwin.photos.camera.lens_model import five
from raytwin.photos.synthetic_photos import photograph
from raytwin.scene.lens import undone

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "photos"
SPLITS = 4
"""Splits into halves per set; all are of the same photos, so twenty say little more."""
SIZES = (1008, 756), (1200, 800), (756, 1008), (960, 720), (1280, 720)

Set = tuple[Board, dict[str, list[Tag]], tuple[int, int], tuple[float, ...]]
"""The board, tags by photo, the photos' size, and the true fx, fy, cx, cy, if they are known."""

REAL = {"april_fine": "fine", "desk_tilted": "coarse", "desk_degenerate": "coarse"}
"""Sets of real photos, and their boards."""

DRAWN = {
    "flat": (0, 0.0), "flat, too": (1, 0.0), "bent by 1 mm": (2, 1e-3), "bent by 1 mm, too": (3, 1e-3),
    "bent by 2 mm": (11, 2e-3), "bent by 2 mm, too": (12, 2e-3), "bent by 3 mm": (4, 3e-3),
    "bent by 3 mm, too": (5, 3e-3),
}  # fmt: skip
"""Seed and bend, metres, of the synthetic sets."""


def real(name: str) -> Set:
    return stored_board(SHARED, REAL[name]), *stored_tags(SHARED, name), ()


def drawn(seed: int, bend: float) -> Set:
    """Draw a frame, a lens, a board and 14 poses; photos by the plain renderer, searched by the detector."""
    rng = np.random.default_rng([20261124, seed])
    while True:
        size, k1 = SIZES[rng.integers(len(SIZES))], rng.uniform(-0.25, 0.15)
        f, (cx, cy) = max(size) * rng.uniform(0.65, 1.1), (np.array(size) - 1) / 2 + rng.normal(0, 0.01, 2) * size
        dist = (k1, -k1 * rng.uniform(0.2, 1.2), *rng.normal(0, 1e-3, 2), rng.uniform(-0.05, 0.05))
        dist = dist[: rng.choice([1, 2, 4, 5])]
        K = ((float(f), 0.0, float(cx)), (0.0, float(f * rng.uniform(0.998, 1.002)), float(cy)), (0.0, 0.0, 1.0))
        if not undone(K, dist, size).fault:
            break
    edge, columns, rows = rng.uniform(0.018, 0.04), *rng.integers(4, 9, 2).tolist()
    family = "tag25h9" if columns * rows <= 35 else "tag36h11"
    board = Board(family, float(edge), Grid(columns, rows, float(edge * rng.uniform(1.2, 1.35))))
    camera = msgspec.structs.replace(a_camera(*size), K=K, dist=tuple(map(float, dist)))
    with tempfile.TemporaryDirectory() as folder:
        render = BentRenderer(board, bend) if bend else PlainRenderer()
        photograph(board, camera, 14, folder, render, seed=5000 + seed)
        tags, _ = detect_photos(sorted(Path(folder).glob("*.jpg")), board.family)
    return board, tags, size, (camera.fx, camera.fy, camera.cx, camera.cy)


def plain(tags: Mapping[str, Sequence[Tag]], size: tuple[int, int], board: Board) -> tuple[np.ndarray, np.ndarray]:
    """K and five coefficients by cv2.calibrateCamera, of every photo with four tags."""
    points = [board.points(t.id for t in found).astype(np.float32) for found in tags.values()]
    pixels = [np.array([t.center for t in found], np.float32) for found in tags.values()]
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 1000, 1e-10)
    _, K, dist, _, _ = cv2.calibrateCamera(points, pixels, size, None, None, criteria=criteria)
    return K, dist.ravel()


def error(tags: Mapping[str, Sequence[Tag]], board: Board, K, dist: Sequence[float], bias: bool) -> float:
    """The median distance of every tag from where the camera sees it, in pixels, the photos' poses being fitted."""
    K, dist, found = np.array(K), five(dist), []
    for seen in tags.values():
        points, pixels = board.points(t.id for t in seen), np.array([t.center for t in seen])
        _, turn, shift = cv2.solvePnP(board.flat().points(t.id for t in seen), pixels, K, dist)
        turn, shift = cv2.solvePnPRefineLM(points, pixels, K, dist, turn, shift)
        if bias:
            straight = unbiased(seen, board, cv2.Rodrigues(turn)[0], shift.ravel(), K, dist)
            pixels = np.array([t.center for t in straight])
            turn, shift = cv2.solvePnPRefineLM(points, pixels, K, dist, turn, shift)
        found.append(np.linalg.norm(cv2.projectPoints(points, turn, shift, K, dist)[0][:, 0] - pixels, axis=1))
    return float(np.median(np.concatenate(found)))


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def numbers(c: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """fx, fy, cx, cy and their sigmas."""
    return np.array(c.K)[[0, 1, 0, 1], [0, 1, 2, 2]], np.array([c.sigma[n] for n in ("fx", "fy", "cx", "cy")])


def measure(name: str) -> tuple[list[str], float, float | None]:
    """Return a set's row of the table, its rms z of halves, and that of the truth, where it is known."""
    board, tags, size, truth = real(name) if name in REAL else drawn(*DRAWN[name])
    known = board.centers()
    tags = {p: [t for t in seen if t.id in known] for p, seen in tags.items()}
    tags = {p: seen for p, seen in tags.items() if len(seen) >= 6}
    whole, names, rng = calibrate_detections(tags, size, board), sorted(tags), np.random.default_rng(0)
    z, ratios = [], []
    for _ in range(SPLITS):
        halves = [{names[i]: tags[names[i]] for i in part} for part in np.array_split(rng.permutation(len(names)), 2)]
        found = [calibrate_detections(seen, size, board) for seen in halves]
        for c, seen, unseen in zip(found, halves, halves[::-1], strict=True):
            theirs = error(unseen, board, *plain(seen, size, board), bias=False)
            ratios.append(error(unseen, c.shaped(board), c.K, c.dist, bias=True) / theirs)
        (a, by_a), (b, by_b) = map(numbers, found)
        z.append((a - b) / np.hypot(by_a, by_b))
    K, sigma = numbers(whole)
    off = rms((K - truth) / sigma) if truth else None
    shown = "-" if off is None else f"{off:.2f}"
    row = [name, str(len(tags)), whole.evidence.taken, f"{rms(z):.2f}", shown, f"{np.median(ratios):.2f}"]
    return row, rms(z), off


if __name__ == "__main__":
    found = [measure(name) for name in record.arguments() or (*REAL, *DRAWN)]
    halves, truths = [z for _, z, _ in found], [off for _, _, off in found if off is not None]
    total = ["all, rms", "", "", f"{rms(halves):.2f}", f"{rms(truths):.2f}" if truths else "-", ""]
    columns = ["photos of", "photos", "model", "z of halves", "z of the truth", "unseen, of OpenCV's"]
    command = "python -m measure.calibration_trust --record"
    record.table("sigmas", "sets", columns, [*(row for row, _, _ in found), total], command)
