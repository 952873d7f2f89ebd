"""Which pixels can see an object: a box that never cuts a visible pixel, lens distortion included.

A sphere's outline under a pinhole is a conic, with the dual r² I - c cᵀ in normalised coordinates (c: its centre in the
camera frame; Hartley and Zisserman, ch. 8). Its vertical tangent lines are the planes through the eye and the camera's
y axis that touch the sphere; seen along y the sphere is a circle, and the two lines stand at the angles
atan2(c_x, c_z) ± asin(r / √(c_x² + c_z²)). Angles, unlike the roots of the conic, stay right for a sphere that reaches
the camera's plane (a hyperbola) or lies behind it (nothing). The horizontal tangents follow from y and z.
"""

from collections.abc import Callable
from functools import lru_cache
from itertools import product
from math import asin, atan2, ceil, floor, hypot, inf, pi, tan

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Camera, Plane, Sphere
from raytwin.tracer.camera import distort, invert_lens, undistort

Box = tuple[int, int, int, int]
"""x0, y0, x1, y1 in pixels: x0 <= u < x1 and y0 <= v < y1."""

EMPTY: Box = (0, 0, 0, 0)
SIDE = np.linspace(0.0, 1.0, 65)


def trim_box(thing: Sphere | Plane, camera: Camera) -> Box:
    """The pixels whose centre's ray can meet the object: exact for a pinhole to one pixel, a little larger with a lens.

    The object's rectangle of normalised coordinates is cut to what the frame can see, and its sides are bent by the
    distortion. Where the distortion is not monotone over that field of view, the whole frame is returned.
    """
    frame = (0, 0, camera.width, camera.height)
    extent = _sphere_extent(thing, camera) if isinstance(thing, Sphere) else _plane_extent(thing, camera)
    field = field_of_view(camera)
    if extent is None:
        return EMPTY
    if field is None:
        return frame
    (ax, bx), (ay, by) = extent
    ax, bx, ay, by = max(ax, field[0]), min(bx, field[1]), max(ay, field[2]), min(by, field[3])
    if ax > bx or ay > by:
        return EMPTY
    xs, ys = ax + (bx - ax) * SIDE, ay + (by - ay) * SIDE
    sides = [(xs, ay + 0 * xs), (xs, by + 0 * xs), (ax + 0 * ys, ys), (bx + 0 * ys, ys)]
    u, v = zip(*(_to_pixels(x, y, camera) for x, y in sides), strict=True)
    u, v = np.array(u), np.array(v)
    # Between two samples a curve leaves its chord by at most an eighth of its second difference; take all of it.
    # Rounding outwards then leaves room for float32, whose outline may reach a centre that the exact one just misses.
    mu, mv = np.abs(np.diff(u, 2)).max(), np.abs(np.diff(v, 2)).max()
    x0, x1 = max(floor(u.min() - mu), 0), min(ceil(u.max() + mu) + 1, camera.width)
    y0, y1 = max(floor(v.min() - mv), 0), min(ceil(v.max() + mv) + 1, camera.height)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else EMPTY


@lru_cache(maxsize=64)
def field_of_view(camera: Camera) -> tuple[float, float, float, float] | None:
    """(x_min, x_max, y_min, y_max) of normalised coordinates that the frame sees; None where the lens folds over."""
    w, h = camera.width - 0.5, camera.height - 0.5
    us, vs = -0.5 + (w + 0.5) * SIDE, -0.5 + (h + 0.5) * SIDE
    u = np.concatenate([us, us, -0.5 + 0 * vs, w + 0 * vs])
    v = np.concatenate([-0.5 + 0 * us, h + 0 * us, vs, vs])
    xd, yd = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    try:
        x, y = undistort(xd, yd, camera.coefficients, invert_lens(camera))
    except InputError:
        return None
    pad_x, pad_y = 0.01 * np.ptp(x), 0.01 * np.ptp(y)
    field = float(x.min() - pad_x), float(x.max() + pad_x), float(y.min() - pad_y), float(y.max() + pad_y)
    # Monotone along every radius out to the field's farthest corner: then sides bend, but never fold.
    k1, k2, _, _, k3 = camera.coefficients
    reach = hypot(max(-field[0], field[1]), max(-field[2], field[3]))
    rr = np.linspace(0.0, reach * reach, 257)
    slope = 1 + rr * (3 * k1 + rr * (5 * k2 + rr * 7 * k3))
    return field if slope.min() > 0 else None


def _sphere_extent(sphere: Sphere, camera: Camera) -> tuple[tuple[float, float], tuple[float, float]] | None:
    x, y, z = (
        float(c) for c in np.asarray(camera.R_cam_board) @ np.asarray(sphere.center) + np.asarray(camera.t_cam_board)
    )
    horizontal, vertical = _tangents(x, z, sphere.radius), _tangents(y, z, sphere.radius)
    return (horizontal, vertical) if horizontal and vertical else None


def _tangents(a: float, z: float, r: float) -> tuple[float, float] | None:
    """Slopes of the tangents from the origin to the circle round (a, z), cut to z > 0; None where all lies behind."""
    distance = hypot(a, z)
    if distance <= r:
        return -inf, inf
    middle, half = atan2(a, z), asin(r / distance)
    low, high = middle - half, middle + half
    if low >= pi / 2 or high <= -pi / 2:
        return None
    return tan(low) if low > -pi / 2 else -inf, tan(high) if high < pi / 2 else inf


def _plane_extent(plane: Plane, camera: Camera) -> tuple[tuple[float, float], tuple[float, float]] | None:
    c, u, v = (np.asarray(a) for a in (plane.center, plane.half_u, plane.half_v))
    corners = np.array([c + i * u + j * v for i in (-1, 1) for j in (-1, 1)])
    x, y, z = np.asarray(camera.R_cam_board) @ corners.T + np.asarray(camera.t_cam_board)[:, None]
    if z.max() <= 0:
        return None
    if z.min() <= 1e-9 * abs(z).max():
        return (-inf, inf), (-inf, inf)
    return (float((x / z).min()), float((x / z).max())), (float((y / z).min()), float((y / z).max()))


def corner_box(thing: Sphere | Plane, camera: Camera) -> Box:
    """The paper's box: round the pixels of the eight corners of the cube that holds the sphere.

    Kept beside `trim_box` for comparison. It wastes pixels, and cuts visible ones where a corner lies behind the eye
    (it is projected through the eye, to the wrong side) or where distortion bends the outline past the corners.
    """
    if isinstance(thing, Sphere):
        offsets = np.array(list(product((-thing.radius, thing.radius), repeat=3)))
    else:
        offsets = np.array([i * np.array(thing.half_u) + j * np.array(thing.half_v) for i in (-1, 1) for j in (-1, 1)])
    corners = np.array(thing.center) + offsets
    with np.errstate(all="ignore"):
        x, y, z = np.asarray(camera.R_cam_board) @ corners.T + np.asarray(camera.t_cam_board)[:, None]
        u, v = _to_pixels(x / z, y / z, camera)
    if not (np.isfinite(u).all() and np.isfinite(v).all()):
        return (0, 0, camera.width, camera.height)
    x0, x1 = max(floor(u.min()), 0), min(ceil(u.max()) + 1, camera.width)
    y0, y1 = max(floor(v.min()), 0), min(ceil(v.max()) + 1, camera.height)
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else EMPTY


def whole_frame(thing: Sphere | Plane, camera: Camera) -> Box:
    return (0, 0, camera.width, camera.height)


def _to_pixels(x: np.ndarray, y: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    xd, yd = distort(x, y, camera.coefficients)
    return camera.fx * xd + camera.cx, camera.fy * yd + camera.cy


TRIMS: dict[str, Callable[[Sphere | Plane, Camera], Box]] = {
    "none": whole_frame,
    "corners": corner_box,
    "conic": trim_box,
}
"""name -> (object, camera) -> box."""
