"""The bias of a detector that fits straight lines to a tag's edges, which lens and bent sheet bend.

It takes for the centre where the diagonals of the lines' four crossings meet. Through a known camera the same is done
to the true edges; what comes out differs from the image of the true centre by the detector's bias: a fifth of a pixel
(rms) on large tags under moderate distortion, four times the detector's noise.
"""

import functools
from collections.abc import Sequence

import msgspec
import numpy as np

from raytwin.photos.boards.board import Board
from raytwin.photos.camera import lens_model
from raytwin.photos.camera.detection import Tag

POINTS_PER_EDGE, EDGE_SHARE = 5, 0.767
"""Points per tag edge that its line is fitted to, and the share of the edge that they span: with the same mean square
offset as the 16 places that the AprilTag library samples."""


def center_bias(ids: Sequence[int], board: Board, R, t, K, dist: Sequence[float]) -> np.ndarray:
    """(n, 2) pixels: crossing of the diagonals of straight lines through the edges, minus the true centre."""
    centers, edges = board.points(ids), _edges(board)
    around = centers[:, None, None] + np.stack([edges[i] for i in ids])
    true = lens_model.project(centers, R, t, K, dist)
    pixels = lens_model.project(around.reshape(-1, 3), R, t, K, dist).reshape(len(ids), 4, POINTS_PER_EDGE, 2)
    pixels = pixels - true[:, None, None]
    middle = pixels.mean(axis=2)
    spread = pixels - middle[:, :, None]
    # The least squares line through points: its normal is the direction in which they spread least.
    normal = np.linalg.eigh(np.swapaxes(spread, -1, -2) @ spread)[1][..., 0]
    # A line a x + b y + c = 0 is (a, b, c): two lines cross, and two points are joined, at their cross product.
    line = np.concatenate([normal, -(normal * middle).sum(axis=-1, keepdims=True)], axis=-1)
    a, b, c, d = np.cross(np.roll(line, 1, axis=1), line).swapaxes(0, 1)
    crossing = np.cross(np.cross(a, c), np.cross(b, d))
    with np.errstate(all="ignore"):  # a tag seen edge-on has no crossing: not finite, and `unbiased` leaves it alone
        return crossing[:, :2] / crossing[:, 2:]


@functools.lru_cache(maxsize=16)
def _edges(board: Board) -> dict[int, np.ndarray]:
    """By id, (4, POINTS_PER_EDGE, 3): from the tag's centre to points on its lower, right, upper and left edge, metres.

    On a bent sheet the edges lie higher or lower than the centre.
    """
    s, one = np.linspace(-EDGE_SHARE, EDGE_SHARE, POINTS_PER_EDGE), np.ones(POINTS_PER_EDGE)
    flat = np.stack([np.c_[s, -one], np.c_[one, s], np.c_[-s, one], np.c_[-one, -s]]) * board.tag_edge / 2
    centers = np.array([*board.centers().values()])
    rise = board.rise(centers[:, None, None] + flat) - board.rise(centers)[:, None, None]
    return {tag: np.dstack([flat, z]) for tag, z in zip(board.centers(), rise, strict=True)}


def unbiased(tags: Sequence[Tag], board: Board, R, t, K, dist: Sequence[float]) -> list[Tag]:
    """The tags with their centres moved by -center_bias: to where the camera sees the true centres."""
    shift = center_bias([tag.id for tag in tags], board, R, t, K, dist)
    # A shift of a tenth of the tag means that the camera is wrong: such a centre is left where it is.
    size = np.ptp([tag.corners for tag in tags], axis=1).max(axis=1)
    shift = np.where(np.linalg.norm(shift, axis=1) < 0.1 * size, shift.T, 0.0).T
    moved = (np.array([tag.center for tag in tags]) - shift).tolist()
    return [msgspec.structs.replace(tag, center=tuple(at)) for tag, at in zip(tags, moved, strict=True)]
