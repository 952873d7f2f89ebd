"""Which pixels can see an object: a box that never cuts a visible pixel, lens distortion included.

A sphere's outline under a pinhole is a conic, with the dual r² I - c cᵀ in normalised coordinates (c: its centre in the
camera frame; Hartley and Zisserman, ch. 8). Its vertical tangent lines are the planes through the eye and the camera's
y axis that touch the sphere; seen along y the sphere is a circle, and the two lines stand at the angles
atan2(c_x, c_z) ± asin(r / √(c_x² + c_z²)). Angles, unlike the roots of the conic, stay right for a sphere that reaches
the camera's plane (a hyperbola) or lies behind it (nothing). The horizontal tangents follow from y and z.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import ceil, floor, inf, pi

import numpy as np

from raytwin.array_types import Float, Int
from raytwin.scene import Camera, Shape, Sphere
from raytwin.scene.lens import LEAST_DETERMINANT, determinant, distort, undone

Box = tuple[int, int, int, int]
"""x0, y0, x1, y1 in pixels: x0 <= u < x1 and y0 <= v < y1."""

EMPTY: Box = (0, 0, 0, 0)
SIDE = np.linspace(0.0, 1.0, 65)


def trim_boxes(things: Sequence[Shape], camera: Camera) -> Int[np.ndarray, "n 4"]:
    """(n, 4) ints: for each object the pixels whose centre's ray can meet it; EMPTY where there are none.

    Exact for a pinhole to one pixel, a little larger with a lens: the object's rectangle of normalised coordinates is
    cut to what the frame can see, and its sides are bent by the distortion. Where the distortion folds within that
    field of view, if only in a corner that the frame leaves out, the whole frame is returned.
    """
    low, high = _extents(things, camera)
    field = field_of_view(camera)
    frame = np.array((camera.width, camera.height))
    empty = np.asarray(~(low < high).all(axis=1))
    if field is None:
        return np.where(empty[:, None], 0, np.concatenate([0 * frame, frame]))
    near, far = field
    low, high = np.maximum(low, near), np.minimum(high, far)
    empty |= (low > high).any(axis=1)
    low, high = np.where(empty[:, None], near, low), np.where(empty[:, None], far, high)
    (ax, ay), (bx, by) = low.T[..., None], high.T[..., None]
    along = SIDE if any(camera.dist) else SIDE[[0, -1]]  # without a lens the sides stay straight
    xs, ys = ax + (bx - ax) * along, ay + (by - ay) * along
    x = np.stack([xs, xs, ax + 0 * ys, bx + 0 * ys], axis=1)  # (n, sides, places)
    y = np.stack([ay + 0 * xs, by + 0 * xs, ys, ys], axis=1)
    at = np.stack(_to_pixels(x, y, camera))
    # Between two samples a curve leaves its chord by at most an eighth of its second difference; take all of it.
    # Rounding outwards then leaves room for float32, whose outline may reach a centre that the exact one just misses.
    margin = np.abs(np.diff(at, 2, axis=-1)).max(axis=(-1, -2), initial=0)
    first = np.maximum(np.floor(at.min(axis=(-1, -2)) - margin), 0).T.astype(int)
    last = np.minimum(np.ceil(at.max(axis=(-1, -2)) + margin).T.astype(int) + 1, frame)
    empty |= (first >= last).any(axis=1)
    return np.where(empty[:, None], 0, np.concatenate([first, last], axis=1))


@lru_cache(maxsize=64)
def field_of_view(camera: Camera) -> Float[np.ndarray, "2 2"] | None:
    """The least and the greatest normalised (x, y) that the frame sees; None where the lens folds within them."""
    seen = undone(camera.K, camera.dist, camera.image_size)
    if seen.fault:
        return None
    low, high = seen.ideal.min(axis=0), seen.ideal.max(axis=0)
    low, high = low - 0.01 * (high - low), high + 0.01 * (high - low)
    # What lies between the sides of a rectangle comes out between its bent sides if nothing folds within.
    x, y = np.linspace(low, high, len(SIDE)).T
    folds = determinant(x, y[:, None], camera.coefficients).min() < LEAST_DETERMINANT
    return None if folds else np.array([low, high])


def _extents(things: Sequence[Shape], camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest normalised (x, y) (n, 2) of each object; nothing to be seen: (inf, -inf)."""
    low, high = np.full((2, len(things), 2), [[[np.inf]], [[-np.inf]]])
    balls = np.array([isinstance(thing, Sphere) for thing in things], bool)
    x, y, z = _in_camera(np.array([thing.center for thing in things]).reshape(-1, 3)[balls], camera)
    radius = np.array([thing.sizes[0] for thing in things])[balls]
    for k, along in enumerate((x, y)):
        low[balls, k], high[balls, k] = _tangents(along, z, radius)
    for i in np.flatnonzero(~balls).tolist():
        x, y, z = _corners(things[i], camera)
        if z.max() > 0:
            before = z.min() > 1e-9 * abs(z).max()
            slopes = np.array([x, y]) / z if before else np.array([[-inf, inf]] * 2)
            low[i], high[i] = slopes.min(axis=1), slopes.max(axis=1)
    return low, high


def _tangents(a: np.ndarray, z: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the tangents from the origin to the circle round (a, z), cut to z > 0; (inf, -inf): all lies behind."""
    distance = np.hypot(a, z)
    around = distance <= r
    middle, half = np.arctan2(a, z), np.arcsin(np.minimum(r / np.where(around, r, distance), 1))
    low, high = middle - half, middle + half
    start = np.where(around | (low <= -pi / 2), -np.inf, np.tan(low))
    end = np.where(around | (high >= pi / 2), np.inf, np.tan(high))
    behind = ~around & ((low >= pi / 2) | (high <= -pi / 2))
    return np.where(behind, np.inf, start), np.where(behind, -np.inf, end)


def _corners(thing: Shape, camera: Camera) -> np.ndarray:
    """(3, n): in the camera's frame."""
    return _in_camera(np.array(thing.center) + thing.corners(), camera)


def _in_camera(points: np.ndarray, camera: Camera) -> np.ndarray:
    return np.asarray(np.asarray(camera.R_cam_board) @ points.T + np.asarray(camera.t_cam_board)[:, None])


def corner_box(thing: Shape, camera: Camera) -> Box:
    """The paper's box: around the pixels of the eight corners of the cube around the sphere.

    For comparison with `trim_box`. It wastes pixels, and cuts visible ones where a corner lies behind the eye
    (it is projected through the eye, to the wrong side) or where distortion bends the outline past the corners.
    """
    with np.errstate(all="ignore"):
        x, y, z = _corners(thing, camera)
        u, v = _to_pixels(x / z, y / z, camera)
    if not np.isfinite(u + v).all():
        return (0, 0, camera.width, camera.height)
    x0, x1 = max(floor(u.min()), 0), min(ceil(u.max()) + 1, camera.width)
    y0, y1 = max(floor(v.min()), 0), min(ceil(v.max()) + 1, camera.height)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else EMPTY


def _to_pixels(x: np.ndarray, y: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    xd, yd = distort(x, y, camera.coefficients)
    return camera.fx * xd + camera.cx, camera.fy * yd + camera.cy


TRIMS: dict[str, Callable[[Sequence[Shape], Camera], np.ndarray]] = {
    "none": lambda things, camera: np.tile((0, 0, *camera.image_size), (len(things), 1)),
    "corners": lambda things, camera: np.array([corner_box(t, camera) for t in things], int).reshape(-1, 4),
    "conic": trim_boxes,
}
"""name -> (objects, camera) -> boxes (n, 4)."""
