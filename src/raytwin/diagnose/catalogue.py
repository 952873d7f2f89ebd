"""The catalogue of mistakes: what is made wrong in tracers, as data, a row each, with the sentence that helps.

A fault has one or more `ways` to be made, each a change of the tracer's `Steps` (see `predict`), and all called by the
same sentence. To add a fault, add a row; to add a way, add it to its row. Factors that are not known beforehand are
rows of `fitted`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import islice, product
from math import pi
from operator import itemgetter
from typing import Any

import msgspec
import numpy as np

from raytwin.diagnose.predict import (
    RIGHT,
    Array,
    Bench,
    Change,
    Hits,
    Rays,
    Steps,
    Terms,
    Walks,
    _table,
    gathered,
    hidden,
    lambert,
    meet,
    meet_all,
    nearest,
    on_rectangle,
    on_sphere,
    others_hide,
    outward,
)
from raytwin.diagnose.slips import slips
from raytwin.files import srgb_decode, srgb_encode
from raytwin.scene import Camera, Rectangle, Scene, Shape, Sphere
from raytwin.scene.lens import distort
from raytwin.tracer import undistort

CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, OUTPUT, SAMPLING = (
    "camera", "solver", "order", "normals", "light", "shadow", "output", "sampling",
)  # fmt: skip
Casters = tuple[Shape, ...]
STAGES = (CAMERA, SOLVER, ORDER, NORMALS, LIGHT, SHADOW, SAMPLING, OUTPUT)
"""From the pixel to the picture: what stands earlier is told first."""


@dataclass(frozen=True, eq=False)
class Fault:
    """`name` is unique; `sentence` says to a student what is wrong and what is right.

    `alone`: slips that show the fault where a function is tested alone; pictures have `ways` for it.
    """

    name: str
    stage: str
    sentence: str
    ways: tuple[Change, ...]
    alone: tuple[Change, ...] = ()


def row(name: str, stage: str, sentence: str, *ways: Change, alone: tuple[Change, ...] = ()) -> Fault:
    return Fault(name, stage, sentence, ways, alone)


def put(**steps: Any) -> Change:
    """The steps in the place of the right ones."""
    return lambda s: s._replace(**steps)


def behind(f: Callable[[Scene], Any]) -> Change:
    """Another background."""
    return put(background=lambda scene, d: np.broadcast_to(np.asarray(f(scene), float), 3)[:, None])


def both(*changes: Change) -> Change:
    """One after the other."""
    if len(changes) == 1:
        return changes[0]

    def change(s: Steps) -> Steps:
        for one in changes:
            s = one(s)
        return s

    return change


def terms(f: Callable[[Terms], Terms]) -> Change:
    """Other things to shade with."""
    return lambda s: s._replace(shade=lambda x: s.shade(f(x)))


def _colour(f: Callable[[Terms], Array]) -> Change:
    return terms(lambda x: x._replace(albedo=f(x)))


# ------------------------------------------------------------------------------------------ camera


def at(f: Callable[[Array, Array, Camera], tuple[Any, Any]]) -> Change:
    """Rays through other places in the image than the pixels' centres."""
    return lambda s: s._replace(place=lambda u, v, camera: f(*s.place(u, v, camera), camera))


def seen(f: Callable[[Camera], Camera]) -> Change:
    """Another K or other coefficients."""
    return lambda s: s._replace(lens=lambda camera: f(s.lens(camera)))


def lens(fx: Any = None, fy: Any = None, cx: Any = None, cy: Any = None) -> Change:
    def changed(camera: Camera) -> Camera:
        a, b, c, d = (f(camera) if f else old for f, old in
                      ((fx, camera.fx), (fy, camera.fy), (cx, camera.cx), (cy, camera.cy)))  # fmt: skip
        return msgspec.structs.replace(camera, K=((a, 0.0, c), (0.0, b, d), (0.0, 0.0, 1.0)))

    return seen(changed)


def posed(f: Callable[[Array, Array], tuple[Any, Any]]) -> Change:
    """(R, t) -> the eye in the board's frame, and the matrix that turns directions from the camera's axes to its."""

    def changed(camera: Camera) -> Camera:
        R, t = np.asarray(camera.R_cam_board), np.asarray(camera.t_cam_board)
        eye, turn = f(R, t)
        matrix, moved = np.asarray(turn).T, -np.asarray(turn).T @ np.asarray(eye)
        return msgspec.structs.replace(
            camera, R_cam_board=tuple(map(tuple, matrix.tolist())), t_cam_board=tuple(moved.tolist())
        )

    return placed(changed)


def placed(f: Callable[[Camera], Camera]) -> Change:
    """Another R and t."""
    return lambda s: s._replace(camera=lambda camera: f(s.camera(camera)))


def other(f: Callable[[Shape, Camera], Shape]) -> Change:
    """Another object in the place of each."""
    return lambda s: s._replace(objects=lambda all_, camera: tuple(f(x, camera) for x in s.objects(all_, camera)))


def axes(x: float, y: float, z: float) -> Change:
    """Rays with some of their axes turned round."""
    return lambda s: s._replace(ray=partial(_mirrored, ray=s.ray, signs=(x, y, z)))


def _mirrored(x: Array, y: Array, camera: Camera, ray: Any, signs: tuple[float, float, float]) -> Rays:
    rays, R = ray(x, y, camera), np.asarray(camera.R_cam_board)
    turn = R.T @ np.diag(signs) @ R
    return rays._replace(d=turn @ rays.d, aim=turn @ rays.aim)


def _reshaped(u: Array, v: Array, camera: Camera) -> tuple[Array, Array]:
    """Column by column, written into the picture row by row."""
    place = v * camera.width + u
    return place // camera.height, place % camera.height


def _reshaped_and_turned(u: Array, v: Array, camera: Camera) -> tuple[Array, Array]:
    """Row by row, written column by column: reshape(width, height), transposed."""
    place = u * camera.height + v
    return place % camera.width, place // camera.width


def _left_as_is(x: Array, y: Array, dist: Any) -> tuple[Array, Array]:
    return x, y


def _in_other_units(x: Array, y: Array, camera: Camera, ray: Any, by: Any, middle: bool) -> Rays:
    """The distortion is undone in (u - a) / sx, (v - b) / sy; (sx, sy) = by(camera); (a, b): `middle` or (cx, cy)."""
    a, b = (camera.width / 2, camera.height / 2) if middle else (camera.cx, camera.cy)
    sx, sy = by(camera)
    u, v = camera.fx * x + camera.cx, camera.fy * y + camera.cy
    x, y = undistort((u - a) / sx, (v - b) / sy, camera.coefficients)
    return ray((x * sx + a - camera.cx) / camera.fx, (y * sy + b - camera.cy) / camera.fy, camera)


@lru_cache(maxsize=16)
def _new_matrix(camera: Camera, whole: bool) -> tuple[float, float, float, float]:
    """(fx, fy, cx, cy) that shows the `whole` undistorted image, or as much as has no empty edge, in the same size."""
    u, v = (k.ravel() for k in np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9)))
    x, y = (np.asarray(k).reshape(9, 9) for k in undistort(
        (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, camera.coefficients))  # fmt: skip
    if whole:
        left, right, top, bottom = x.min(), x.max(), y.min(), y.max()
    else:
        left, right, top, bottom = x[:, 0].max(), x[:, -1].min(), y[0].max(), y[-1].min()
    fx, fy = (camera.width - 1) / (right - left), (camera.height - 1) / (bottom - top)
    return float(fx), float(fy), float(-fx * left), float(-fy * top)


def _by_new_matrix(x: Array, y: Array, camera: Camera, ray: Any, whole: bool) -> Rays:
    """Undistorted into the pixels of a new camera matrix, then made rays with the old one."""
    if not any(camera.coefficients):
        return ray(x, y, camera)
    fx, fy, cx, cy = _new_matrix(camera, whole)
    return ray((fx * x + cx - camera.cx) / camera.fx, (fy * y + cy - camera.cy) / camera.fy, camera)


def angles(f: Callable[[float, float, Camera], tuple[float, float]]) -> Change:
    """Other focal lengths by the fields of view, radians, of both axes."""

    def focal(c: Camera, k: int) -> float:
        return f(2 * float(np.arctan(c.width / 2 / c.fx)), 2 * float(np.arctan(c.height / 2 / c.fy)), c)[k]

    return lens(fx=partial(focal, k=0), fy=partial(focal, k=1))


def _unstretched(x: Array, y: Array, camera: Camera, ray: Any) -> Rays:
    """t of unit rays goes along (x, y, 1)."""
    rays = ray(x, y, camera)
    return rays._replace(aim=rays.d * rays.stretch)


def _as_point(x: Array, y: Array, camera: Camera, ray: Any, unit: bool, forward: bool) -> Rays:
    """Directions with a homogeneous 1: moved as well as turned."""
    rays, R, t = ray(x, y, camera), np.asarray(camera.R_cam_board), np.array(camera.t_cam_board)[:, None]
    d = rays.d * (1.0 if unit else rays.stretch)
    d = _made_unit(R @ R @ d + t if forward else d + rays.origin)
    return rays._replace(d=d, aim=d)


def _left_behind(x: Shape, camera: Camera, kind: type, turned: bool) -> Shape:
    """Take coordinates of this kind in the board's frame, `turned` or not, as the camera's."""
    if not isinstance(x, kind):
        return x
    R, t = np.asarray(camera.R_cam_board), np.asarray(camera.t_cam_board)
    back = np.eye(3) if turned else R.T
    c = _three(back @ x.center - R.T @ t)
    if isinstance(x, Sphere):
        return msgspec.structs.replace(x, center=c)
    return msgspec.structs.replace(x, center=c, half_u=_three(back @ x.half_u), half_v=_three(back @ x.half_v))


def _not_unit(x: Array, y: Array, camera: Camera, ray: Any) -> Rays:
    rays = ray(x, y, camera)
    long = rays.d * rays.stretch
    return rays._replace(d=long, aim=long)


def _in_halves(x: Array, y: Array, camera: Camera, ray: Any, board: bool) -> Rays:
    """Directions in half precision, in the board's axes or in the camera's."""
    rays, R = ray(x, y, camera), np.asarray(camera.R_cam_board)
    d = (rays.d if board else R @ rays.d).astype(np.float16).astype(float)
    d = d if board else R.T @ d
    return rays._replace(d=d, aim=d)


@lru_cache(maxsize=8)
def _all_rays(camera: Camera) -> Array:
    """(H, W, 3), unit, in the camera's axes; of large pictures none."""
    if camera.width * camera.height > 50_000:
        return np.zeros((0, 0, 3))
    v, u = np.indices((camera.height, camera.width), float)
    x, y = undistort((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, camera.coefficients)
    d = np.stack([x, y, np.ones_like(x)], axis=-1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def _by_norm_of_many(x: Array, y: Array, camera: Camera, ray: Any, axis: tuple[int, ...], board: bool) -> Rays:
    """(H, W, 3) rays, before or after they are turned, divided by their norm over rows, columns or both."""
    rays, R, all_ = ray(x, y, camera), np.asarray(camera.R_cam_board), _all_rays(camera)
    if not all_.size:
        return rays
    norm = np.sqrt(np.square(all_ @ R if board else all_).sum(axis=axis, keepdims=True))
    norm = np.broadcast_to(norm, all_.shape)
    xd, yd = distort(x, y, camera.coefficients)
    u, v = camera.fx * xd + camera.cx, camera.fy * yd + camera.cy
    place = (np.clip(np.rint(k), 0, n - 1).astype(int) for k, n in ((v, camera.height), (u, camera.width)))
    by = norm[tuple(place)].T
    d = rays.d / by if board else R.T @ (R @ rays.d / by)
    return rays._replace(d=d, aim=d)


def _met(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
    """Nothing."""
    return np.full(t.shape[1], -1)


lens_of = partial(slips, "undistort")
GRID, RAY = "np.arange(width), np.arange(height)", "np.stack([x, y, np.ones_like(x)], axis=-1)"
UNDO, UNIT = "undistort((u - cx) / fx, (v - cy) / fy, dist)", "rays / np.linalg.norm(rays, axis=-1, keepdims=True)"
DIST, OF_K = "k1, k2, p1, p2, k3 = dist", "fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]"
STEP, FORWARD = "x, y = (xd - dx) / radial, (yd - dy) / radial", "return x * radial + dx, y * radial + dy"
AGAIN, TAKEN_OFF = (
    "x, y = (x - dx) / radial, (y - dy) / radial",
    "x, y = x - (x * radial + dx - xd), y - (y * radial + dy - yd)",
)
POWERS, XY1, XX = "k1 * r2 + k2 * r2**2 + k3 * r2**3", "2 * p1 * x * y", "p2 * (r2 + 2 * x * x)"
YY, XY2 = "p1 * (r2 + 2 * y * y)", "2 * p2 * x * y"
ONE_CROSS = f"{XY1} => p1 * x * y ;; {XY2} => p2 * x * y"
ONE_SQUARE = f"{XX} => p2 * (r2 + x * x) ;; {YY} => p1 * (r2 + y * y)"


def _dist(*lines: str) -> tuple[Change, ...]:
    """The coefficients, changed after they are read."""
    return lens_of(*(f"{DIST} => {DIST}\n    {line}" for line in lines))


def _K(*lines: str) -> tuple[Change, ...]:
    return slips("through", *(f"{OF_K} => {OF_K}\n    {line}" for line in lines))


def _other(term: str) -> str:
    """The term with the other coefficient."""
    return f"{term} => {term.replace('p1', 'p').replace('p2', 'p1').replace('p ', 'p2 ')}"


sphere, plane = partial(slips, "intersect_sphere"), partial(slips, "intersect_plane")
order, normals_at = partial(slips, "nearest"), partial(slips, "normals_at")
I3 = np.eye(3)
CAMERAS = (
    row("rays-long", CAMERA, "the rays are not unit: divide (x, y, 1) by its length",
        alone=slips("through", f"{UNIT} => rays")),
    row("nothing-met", CAMERA,
        "no ray meets anything, the picture is the sky alone: look where rays start, which way they go, over which "
        "axis they are made unit, and whether the test throws every hit away",
        put(order=_met)),
    row("half-pixel", CAMERA,
        "your rays go half a pixel beside the pixels' centres: here (0, 0) is the centre of the top-left pixel, so "
        "use u and v as they are, without 0.5",
        at(lambda u, v, c: (u + 0.5, v + 0.5)), at(lambda u, v, c: (u - 0.5, v - 0.5)),
        at(lambda u, v, c: (u + 0.5, v)), at(lambda u, v, c: (u, v + 0.5)),
        alone=slips("pixels", "return u, v => return u + 0.5, v + 0.5", "return u, v => return u - 0.5, v - 0.5")),
    row("count-from-one", CAMERA,
        "your pixels are a whole one off: the first is u = 0, v = 0",
        at(lambda u, v, c: (u + 1, v + 1)), at(lambda u, v, c: (u - 1, v - 1)),
        at(lambda u, v, c: (u + 1, v)), at(lambda u, v, c: (u, v + 1)),
        alone=slips("pixels", "return u, v => return u + 1, v + 1", "return u, v => return u - 1, v - 1")),
    row("linspace", CAMERA,
        "your pixels reach to the far edge (linspace(0, width, width)): the last is width - 1, a step of 1",
        at(lambda u, v, c: (u * c.width / (c.width - 1), v * c.height / (c.height - 1))),
        at(lambda u, v, c: (u * c.width / (c.width - 1) - 0.5, v * c.height / (c.height - 1) - 0.5)),
        at(lambda u, v, c: (u * (c.width - 1) / c.width, v * (c.height - 1) / c.height)),
        alone=slips("pixels", *(f"{GRID} => np.linspace(0{k}, width{k}, width), np.linspace(0{k}, height{k}, height)"
                                for k in ("", " - 0.5")))),
    row("distortion-kept", CAMERA,
        "the lens's distortion is not undone: pixels are distorted, rays are not, so solve for the (x, y) that the "
        "lens takes to each pixel",
        *slips("through", f"{UNDO} => ((u - cx) / fx, (v - cy) / fy)")),
    row("distortion-forward", CAMERA,
        "you distort the rays once more instead of undoing the distortion: the lens takes (x, y) to the pixel, and "
        "you need the way back",
        *lens_of(f"{STEP} => {FORWARD}", f"{DIST} => {DIST}\n    p1 = p2 = 0 ;; {STEP} => {FORWARD}")),
    row("distortion-sign", CAMERA,
        "the distortion bends rays to the other side: a sign is wrong, or you multiply by the radial factor where you "
        "have to divide",
        *_dist("k1, k2, p1, p2, k3 = -k1, -k2, -p1, -p2, -k3", "k1, k2, k3 = -k1, -k2, -k3", "k1 = -k1",
               "p1, p2 = -p1, -p2"),
        *lens_of(f"{STEP} => x, y = (xd - dx) * radial, (yd - dy) * radial",
                 f"{DIST} => {DIST}\n    k1, k2, p1, p2, k3 = -k1, -k2, -p1, -p2, -k3 ;; {STEP} => {FORWARD}")),
    row("distortion-few-steps", CAMERA,
        "undoing the distortion stops too early: the corners are still off; repeat until nothing moves any more",
        *(way for step, counts in ((STEP, (1, 2, 3, 4, 5, 6, 8)), (TAKEN_OFF, (2, 3, 4, 5, 6, 8))) for n in counts
          for way in lens_of(f"range(30) => range({n}) ;; {STEP} => {step}")),
        *(put(undo=partial(undistort, steps=n)) for n in (1, 2))),
    row("distortion-cumulative", CAMERA,
        "each step that undoes the distortion corrects the estimate of the step before once more: start every step "
        "from the distorted point, x = (x' - tangential) / radial; the estimate belongs in tangential and radial alone",
        *(way for step, counts, more in (
            (AGAIN, (2, 3, 4, 5, 6, 8, 10, 20, 30, 50), ""), (AGAIN, (5, 10), "\n    p1 = p2 = 0"),
            (TAKEN_OFF.replace("xd", "x").replace("yd", "y"), (2, 3, 4, 5, 10), "")) for n in counts
          for way in lens_of(f"{DIST} => {DIST}{more} ;; range(30) => range({n}) ;; {STEP} => {step}"))),
    row("k3-left-out", CAMERA, "k3, the fifth coefficient of the distortion, is left out", *_dist("k3 = 0")),
    row("k2-left-out", CAMERA, "k2, the second coefficient of the distortion, is left out",
        *_dist("k2 = 0", "k2 = k3 = 0", "k2 = p1 = p2 = k3 = 0")),
    row("tangential-left-out", CAMERA,
        "p1 and p2, the tangential part of the distortion, are left out",
        *_dist("p1 = p2 = 0", "p1 = p2 = k3 = 0"),
        *lens_of(*(f"{one} => 0 * x" for one in (XY1, XX, YY, XY2)),
                 *(f"{one} => 0 * x ;; {other} => 0 * y" for one, other in ((XY1, XX), (YY, XY2))))),
    row("tangential-swapped", CAMERA,
        "p1 and p2 are mixed up: x' has 2 p1 x y + p2 (r² + 2 x²), y' has p1 (r² + 2 y²) + 2 p2 x y",
        *_dist("p1, p2 = p2, p1"),
        *lens_of(*map(_other, (XY1, XX, YY, XY2)),
                 *(f"{_other(one)} ;; {_other(two)}" for one, two in ((XY1, XX), (YY, XY2))))),
    row("coefficients-order", CAMERA,
        "the coefficients are read in the wrong order: dist is k1, k2, p1, p2, k3, with k3 last",
        *_dist("p1, p2, k3 = p2, k3, p1", "p1, p2, k3 = 0, 0, p1")),
    row("tangential-factor", CAMERA,
        "the tangential part of the distortion lacks a factor 2: x' has 2 p1 x y + p2 (r² + 2 x²), y' has "
        "p1 (r² + 2 y²) + 2 p2 x y",
        *lens_of(ONE_CROSS, ONE_SQUARE, f"{ONE_CROSS} ;; {ONE_SQUARE}", f"{XX} => p2 * r2 ;; {YY} => p1 * r2",
                 *ONE_CROSS.split(" ;; "), *ONE_SQUARE.split(" ;; "))),
    row("tangential-after", CAMERA,
        "the tangential part is taken away after the division by the radial factor: it is (x' - tangential) / radial",
        *lens_of(f"{STEP} => x, y = xd / radial - dx, yd / radial - dy")),
    row("tangential-of-bent", CAMERA,
        "the tangential part is computed from an x and y that the radial factor has scaled already: both parts are "
        "made of the same undistorted (x, y)",
        *lens_of(f"{XY1} => 2 * p1 * x * y * radial**2 ;; {XX} => p2 * (r2 + 2 * (x * radial) ** 2) ;; "
                 f"{XY2} => 2 * p2 * x * y * radial**2 ;; {YY} => p1 * (r2 + 2 * (y * radial) ** 2)")),
    row("distortion-in-other-units", CAMERA,
        "the distortion is undone in other units: its coefficients hold for x = (u - cx) / fx, y = (v - cy) / fy, not "
        "for pixels divided by the image's size",
        *(lambda s, by=by, middle=middle: s._replace(
            undo=_left_as_is, ray=partial(_in_other_units, ray=s.ray, by=by, middle=middle))
          for by in (lambda c: (c.width / 2, c.height / 2), lambda c: (c.width, c.height),
                     lambda c: (max(c.image_size),) * 2) for middle in (True, False))),
    row("new-camera-matrix", CAMERA,
        "points are undistorted into the pixels of a new camera matrix (getOptimalNewCameraMatrix), but rays are made "
        "with the old K: use one of them for both",
        *(lambda s, whole=whole: s._replace(ray=partial(_by_new_matrix, ray=s.ray, whole=whole))
          for whole in (True, False))),
    row("powers-of-r", CAMERA,
        "the powers of r are wrong in the distortion: 1 + k1 r² + k2 r⁴ + k3 r⁶",
        *lens_of("r2**2 => r2 ;; r2**3 => r2", "r2**3 => r2**2", "r2**3 => r2**4",
                 f"{POWERS} => k1 * r2**2 + k2 * r2**4 + k3 * r2**6", "r2**2 => r2", "r2**3 => r2")),
    row("radius-for-its-square", CAMERA,
        "the distortion grows with r² (then r⁴, r⁶), where r² = x² + y²: you use r",
        *lens_of(f"{DIST} => {DIST}\n    p1 = p2 = 0 ;; x * x + y * y => np.sqrt(x * x + y * y)",
                 "x * x + y * y => np.sqrt(x * x + y * y)", f"{POWERS} => k1 * r2**0.5 + k2 * r2 + k3 * r2**1.5")),
    row("swapped-axes", CAMERA,
        "rows and columns are swapped: u counts columns (x), v counts rows (y), and the image is indexed [v, u]",
        at(lambda u, v, c: (v, u))),
    row("reshaped", CAMERA,
        "width and height are swapped where the image is put together (reshape, or meshgrid with indexing='ij'): it "
        "has height rows of width pixels, so reshape(height, width, 3) and transpose nothing",
        at(_reshaped), at(_reshaped_and_turned)),
    row("swapped-focal", CAMERA, "fx and fy are swapped: x = (u - cx) / fx, y = (v - cy) / fy", *_K("fx, fy = fy, fx")),
    row("one-focal", CAMERA, "one focal length is used for both axes: x goes with fx, y with fy",
        *_K("fy = fx", "fx = fy", "fx = fy = (fx + fy) / 2")),
    row("swapped-centre", CAMERA, "cx and cy are mixed up: x = (u - cx) / fx, y = (v - cy) / fy",
        *_K("cx, cy = cy, cx", "cx = cy", "cy = cx")),
    row("whole-numbers", CAMERA, "K is rounded to whole numbers: use fx, fy, cx and cy as they are",
        *(lens(cx=lambda c, f=f: f(c.cx), cy=lambda c, f=f: f(c.cy)) for f in (np.floor, np.rint)),
        *(lens(fx=lambda c, f=f: f(c.fx), fy=lambda c, f=f: f(c.fy)) for f in (np.floor, np.rint)),
        *(lens(*(lambda c, f=f, of=of: f(getattr(c, of)) for of in ("fx", "fy", "cx", "cy")))
          for f in (np.floor, np.rint))),
    row("centre-of-image", CAMERA,
        "the image's middle is taken for the principal point: use cx and cy from K",
        lens(cx=lambda c: c.width / 2, cy=lambda c: c.height / 2),
        lens(cx=lambda c: (c.width - 1) / 2, cy=lambda c: (c.height - 1) / 2),
        lens(cx=lambda c: c.height / 2, cy=lambda c: c.width / 2),
        lens(cx=lambda c: c.width / 2), lens(cy=lambda c: c.height / 2),
        alone=_K("cx, cy = np.max(u) / 2, np.max(v) / 2", "cx, cy = (np.max(u) + 1) / 2, (np.max(v) + 1) / 2")),
    row("centre-from-far-edge", CAMERA,
        "the principal point is counted from the wrong edge: cx from the left and cy from the top, like u and v",
        lens(cy=lambda c: c.height - 1 - c.cy), lens(cy=lambda c: c.height - c.cy),
        lens(cx=lambda c: c.width - 1 - c.cx), lens(cx=lambda c: c.width - c.cx)),
    row("field-of-view", CAMERA,
        "a focal length is made of a field of view by a wrong formula: half the width is f tan(half the horizontal "
        "angle), so heights and widths go with the tangents, not with the angles; or use fx and fy of K as they are",
        angles(lambda h, v, c: (c.width / 2 * pi / h / 2, c.height / 2 * pi / v / 2)),
        angles(lambda h, v, c: (c.fx, c.height / 2 / np.tan(h * c.height / c.width / 2))),
        angles(lambda h, v, c: (c.width / 2 / np.tan(v * c.width / c.height / 2), c.fy)),
        angles(lambda h, v, c: (c.width / 2 / np.tan(h), c.height / 2 / np.tan(v)))),
    row("centre-left-out", CAMERA, "the principal point (cx, cy) is not subtracted: x = (u - cx) / fx",
        *_K("cx = cy = 0", "cx = 0", "cy = 0", "cx, cy = -cx, -cy")),
    row("x-for-y", CAMERA, "x and y of the rays are swapped: x belongs to the column u, y to the row v",
        *slips("through", f"{RAY} => np.stack([y, x, np.ones_like(x)], axis=-1)")),
    row("y-up", CAMERA,
        "the camera's y axis points down here (OpenCV): yours points up, so that the image is seen upside down",
        axes(1, -1, 1),
        alone=slips("through", f"{RAY} => np.stack([x, -y, np.ones_like(x)], axis=-1)")),
    row("x-left", CAMERA, "the camera's x axis points right here (OpenCV): yours points left", axes(-1, 1, 1),
        alone=slips("through", f"{RAY} => np.stack([-x, y, np.ones_like(x)], axis=-1)")),
    row("z-backwards", CAMERA,
        "the camera looks along +z here (OpenCV), not along -z (OpenGL)",
        axes(1, 1, -1), axes(1, -1, -1), axes(-1, 1, -1), axes(-1, -1, -1), axes(-1, -1, 1),
        alone=slips("through", *(f"{RAY} => {x}" for x in (
            "np.stack([x, -y, -np.ones_like(x)], axis=-1)", f"-{RAY}",
            "np.stack([x, y, -np.ones_like(x)], axis=-1)")))),
    row("transposed-R", CAMERA,
        "R is transposed: p_cam = R p_board + t, so directions go to the board's frame by d_board = Rᵀ d_cam",
        posed(lambda R, t: (-R.T @ t, R)), posed(lambda R, t: (-R @ t, R))),
    row("inverse-pose", CAMERA,
        "the pose is used the wrong way round: (R, t) takes board to camera, not camera to board",
        posed(lambda R, t: (t, R))),
    row("wrong-eye", CAMERA,
        "the eye is in the wrong place: the camera's centre in the board's frame is -Rᵀ t",
        posed(lambda R, t: (t, R.T)), posed(lambda R, t: (-t, R.T)), posed(lambda R, t: (R.T @ t, R.T)),
        posed(lambda R, t: (-R @ t, R.T)), posed(lambda R, t: (R @ t, R.T)), posed(lambda R, t: (R.T @ t, R)),
        posed(lambda R, t: (-t, R))),
    row("kind-not-moved", CAMERA,
        "only spheres, or only planes, are moved to the camera's frame: p_cam = R p_board + t holds for every centre, "
        "and edges are turned by R",
        *(other(partial(_left_behind, kind=kind, turned=turned))
          for kind in (Sphere, Rectangle) for turned in (False, True))),
    row("direction-as-point", CAMERA,
        "the rays' directions are moved as if they were points (a homogeneous 1): only turn them, d_board = Rᵀ d_cam",
        *(lambda s, unit=unit, forward=forward: s._replace(
            ray=partial(_as_point, ray=s.ray, unit=unit, forward=forward))
          for forward in (False, True) for unit in (True, False))),
    row("eye-at-origin", CAMERA,
        "rays start at the board's origin: the camera's centre there is -Rᵀ t",
        posed(lambda R, t: (0 * t, R.T)), posed(lambda R, t: (0 * t, R))),
    row("rotation-left-out", CAMERA,
        "the camera's rotation is left out: turn the rays by Rᵀ",
        posed(lambda R, t: (-R.T @ t, I3)), posed(lambda R, t: (-t, I3)), posed(lambda R, t: (t, I3))),
    row("rays-by-norm-of-many", CAMERA,
        "the rays are divided by a norm over pixels, not over x, y and z: np.linalg.norm(d, axis=-1, keepdims=True)",
        *(lambda s, axis=axis, board=board: s._replace(
            ray=partial(_by_norm_of_many, ray=s.ray, axis=axis, board=board), sphere=sphere("")[0](s).sphere)
          for axis in ((0, 1), (0,), (1,)) for board in (False, True)),
        alone=slips("through", *(f"{UNIT} => rays / np.linalg.norm(rays{axis})" for axis in (
            "", *(f", axis={k}, keepdims=True" for k in (0, 1, (0, 1))))))),
    row("rays-in-halves", CAMERA,
        "the rays' directions are rounded to half floats (float16), which leaves three digits: use float64",
        *(lambda s, board=board: s._replace(
            ray=partial(_in_halves, ray=s.ray, board=board), sphere=sphere("")[0](s).sphere)
          for board in (True, False))),
)  # fmt: skip


# ------------------------------------------------------------------------------------------ solver

ROOT, CHOICE, HIT = "np.sqrt(disc)", "t = np.where(near > 0, near, far)", "(disc >= 0) & (t > 0)"
A, B, OVER = "a = np.sum(directions * directions, axis=-1)", "b = 2 * np.sum", "/ (2 * a)"
SQUARE, LENGTH = "np.sum(f * f, axis=-1)", "np.linalg.norm(f, axis=-1)"
HALF = f"{B} => b = np.sum ;; b * b - 4 * a * c => b * b - a * c"
BY_Q = """q = -(b + np.sign(b) * np.sqrt(disc)) / 2
    near, far = np.minimum(q / a, c / q), np.maximum(q / a, c / q)
    near, far = np.where(q == 0, np.nan, near), np.where(q == 0, np.nan, far)
    t = np.where(near > 0, near, far)"""
D2 = "np.sum(f * f, axis=-1) - b * b / (4 * a)"
NU, NV = "np.linalg.norm(half_u)", "np.linalg.norm(half_v)"
IN_U, IN_V = "np.abs(q @ half_u) <= half_u @ half_u", "np.abs(q @ half_v) <= half_v @ half_v"
INSIDE, T, MET = f"({IN_U}) & ({IN_V})", "((center - origins) @ n) / (directions @ n)", "inside & (t > 0)"
ALONG = "(q @ half_u) / (half_u @ half_u)", "(q @ half_v) / (half_v @ half_v)"
GRAZING = "np.abs(directions @ n) / np.linalg.norm(n) / np.linalg.norm(directions, axis=-1)"
CROSS, CROSS_AT = "n = np.cross(half_u, half_v)", 'n = np.cross(thing["half_u"], thing["half_v"])'
AHEAD = "where((disc >= 0) & (t > 0), t"


def resized(factor: float, length: float = 1) -> Change:
    """Spheres of another radius, whose normals have this length."""

    grown = other(lambda x, _: msgspec.structs.replace(x, radius=factor * x.radius) if isinstance(x, Sphere) else x)
    return both(grown, on_spheres(lambda n: n * length))


def reradiused(f: Callable[[Sphere, Sequence[Sphere]], float], own: bool = False) -> Change:
    """Spheres of other radii, (the sphere, all spheres) -> r; `own`: normals are divided by the right ones."""

    def spheres(things: Casters, camera: Camera, objects: Any) -> Casters:
        things = objects(things, camera)
        balls = [x for x in things if isinstance(x, Sphere)]
        return tuple(
            msgspec.structs.replace(x, radius=max(f(x, balls), 1e-9)) if isinstance(x, Sphere) else x for x in things
        )

    def by_own(x: Terms) -> Terms:
        balls = [thing for thing in x.scene.objects if isinstance(thing, Sphere)]
        longer = [f(thing, balls) / thing.radius if isinstance(thing, Sphere) else 1.0 for thing in x.scene.objects]
        return x._replace(cos=x.cos * np.array([*longer, 1.0])[x.hits.ids])

    change: Change = lambda s: s._replace(objects=partial(spheres, objects=s.objects))  # noqa: E731
    return both(change, terms(by_own)) if own else change


def on_spheres(f: Callable[[Array], Array]) -> Change:
    """Another normal of spheres."""
    return normals(lambda n, p, rays, thing: f(n) if isinstance(thing, Sphere) else n)


def only_seen(change: Change) -> Change:
    """For the eye's rays alone: shadow rays meet what they should."""
    return both(change, lambda s: s._replace(blocked=lambda hits, to, things, steps: s.blocked(
        hits, to, things, steps._replace(sphere=on_sphere, rectangle=on_rectangle))))  # fmt: skip


def _edges_turned(x: Shape, camera: Camera, turn: Any, which: str = "") -> Shape:
    """Centres stand in the camera's frame, edges, or one of them, in the board's."""
    if isinstance(x, Sphere):
        return x
    matrix, names = turn(np.asarray(camera.R_cam_board)), (which,) if which else ("half_u", "half_v")
    return msgspec.structs.replace(x, **{name: _three(matrix @ getattr(x, name)) for name in names})


def _edges_moved(x: Shape, camera: Camera) -> Shape:
    if isinstance(x, Sphere):
        return x
    moved = np.asarray(camera.R_cam_board).T @ camera.t_cam_board
    return msgspec.structs.replace(x, half_u=_three(x.half_u + moved), half_v=_three(x.half_v + moved))


def normals(f: Callable[[Array, Array, Rays, Shape], Array]) -> Change:
    """(right normal, point, rays, thing) -> normal."""
    return lambda s: s._replace(normal=lambda p, rays, thing: f(s.normal(p, rays, thing), p, rays, thing))


def _made_unit(n: Array, *_: Any) -> Array:
    length = np.linalg.norm(n, axis=0)
    return n / np.where(length > 0, length, 1)


def _three(v: Any) -> Any:
    return tuple(np.asarray(v, float).tolist())


def in_shadow_test(change: Change) -> Change:
    """For shadow rays alone: the eye sees what it should."""
    return lambda s: s._replace(blocked=lambda hits, to, things, steps: s.blocked(
        hits, to, things, steps._replace(sphere=change(s).sphere, rectangle=change(s).rectangle)))  # fmt: skip


def _inside(*tests: str) -> tuple[Change, ...]:
    """Rectangles that end elsewhere."""
    return plane(*(f"{INSIDE} => {test}" for test in tests))


def _also(*tests: str) -> tuple[Change, ...]:
    """Rectangles that end here, too."""
    return plane(*(f"{MET} => inside & ({test}) & (t > 0)" for test in tests))


def _between(*least_most: tuple[str, str]) -> str:
    """(-1, 1) for each axis is right."""
    return " & ".join(f"({a} >= {lo}) & ({a} <= {hi})" for a, (lo, hi) in zip(ALONG, least_most, strict=True))


def _reach(u: str, v: str) -> str:
    """|q·u| and |q·v| up to these."""
    return f"(np.abs(q @ half_u) <= {u}) & (np.abs(q @ half_v) <= {v})"


def _crossed(*lines: str) -> tuple[Change, ...]:
    """Planes whose normal is another: what rays meet, and what is lit."""
    return tuple(
        both(*plane(f"{CROSS} => {CROSS}\n    {line}"),
             *normals_at(f"{CROSS_AT} => {CROSS_AT}\n            {line.replace('half_', 'thing_')}"
                         .replace("thing_u", 'thing["half_u"]').replace("thing_v", 'thing["half_v"]')))
        for line in lines
    )  # fmt: skip


bent = lambda s: s._replace(ray=partial(_unstretched, ray=s.ray))  # noqa: E731
long = lambda s: s._replace(ray=partial(_not_unit, ray=s.ray))  # noqa: E731
SOLVERS = (
    row("far-root", SOLVER,
        "you take the far root, where the ray leaves the sphere: take the smallest t > 0",
        *sphere(f"{CHOICE} => t = far", f"{CHOICE} => t = far ;; {HIT} => disc >= 0")),
    row("closest-approach", SOLVER,
        "the ray's point that is nearest to the centre is taken for the hit: half the chord has to be subtracted, "
        "t = -f·d - √(...)",
        *sphere("(-b - np.sqrt(disc)) => -b")),
    row("behind-the-eye", SOLVER,
        "hits behind the ray's start count too: take the smallest positive t, not the smallest |t|, and none where "
        "both are negative",
        *(both(*one, *other) for other in ((), plane(f"{MET} => inside")) for one in (
            sphere(f"{CHOICE} => t = near ;; {HIT} => disc >= 0"),
            sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far) ;; {HIT} => disc >= 0"),
            (*sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far) ;; {HIT} => disc >= 0"),
             *order("np.argmin(t, axis=0) => np.argmin(np.abs(t), axis=0)")))),
        *sphere(f"{CHOICE} => t = np.where(np.abs(near) < np.abs(far), near, far)", f"{HIT} => disc >= 0",
                f"{CHOICE} => t = np.abs(near)", "far = (-b + np.sqrt(disc)) => far = (b + np.sqrt(disc))")),
    row("inside-missed", SOLVER,
        "rays that start inside the sphere miss it: where the near root is negative, the far one may be positive",
        alone=sphere(f"{CHOICE} => t = near")),
    row("misses-not-infinite", SOLVER,
        "a miss has to be np.inf: where the discriminant is negative, and where t is not positive",
        alone=sphere(*(f"t, np.inf) => t, {miss})" for miss in ("np.nan", "0.0", "-1.0")))),
    row("sign-of-zero", SOLVER,
        "sign(0) is 0: where b = 0 your q is 0 and the root is lost; let the sign be 1 there",
        *sphere(f"{CHOICE} => {BY_Q}")),
    row("t-along-z", SOLVER,
        "t was found for unit rays, but is applied to (x, y, 1): use one and the same vector for both",
        bent, both(long, *sphere(f"{AHEAD} => {AHEAD} * np.linalg.norm(directions, axis=-1)"))),
    row("t-of-unit-rays", SOLVER,
        "t is that of unit directions: the directions are made unit inside, and t is not divided by their length "
        "afterwards",
        alone=sphere(f"{AHEAD} => {AHEAD} * np.linalg.norm(directions, axis=-1)")),
    row("rays-not-unit", SOLVER,
        "your rays are not unit, but the quadratic leaves out a = d·d: make them unit, or keep a",
        *(both(long, way) for way in sphere(f"{A} => a = 1.0", f"{OVER} => / 2", "4 * a * c => 4 * c")),
        *sphere(f"{A} => a = 1.0", "4 * a * c => 4 * c")),
    row("hit-point", SOLVER,
        "the hit point is wrong: it is the ray's origin plus t times its direction, o + t d",
        *(way for new in ("t[:, None] * directions", "origins - t[:, None] * directions", "origins + directions",
                          "(origins + directions) * t[:, None]")
          for way in slips("met", f"origins + t[:, None] * directions => {new}"))),
    row("t-of-moved-ray", SOLVER,
        "t is measured in the sphere's own frame, where the ray is moved and scaled: t counts along the ray as it was "
        "given, so scale its direction as its origin, do not make it unit there, and apply t to the first one",
        *sphere(f"{AHEAD} => {AHEAD} / radius", f"{AHEAD} => {AHEAD} * radius",
                f"{AHEAD}, => {AHEAD[:-1]}np.linalg.norm(origins + t[:, None] * directions - f / radius, axis=-1),")),
    row("radius-not-squared", SOLVER, "the radius is not squared: c = f·f - r²", *sphere("radius**2 => radius")),
    row("miss-by-radius", SOLVER,
        "a distance is held against a square: a ray misses the sphere where its distance from the centre, squared, "
        "is above r² (both squared, or neither)",
        *(both(put(), way) for r in ("radius", "radius**4")
          for way in sphere(f"{HIT} => ({D2} <= {r}) & (t > 0) ;; {ROOT} => np.sqrt(np.maximum(disc, 0))"))),
    row("length-not-squared", SOLVER, "the length of f is not squared: c = f·f - r², where f·f = |f|²",
        *sphere(f"{SQUARE} => {LENGTH}", f"{SQUARE} - radius**2 => {LENGTH} - radius",
                f"{SQUARE} - radius**2 => ({LENGTH} - radius) ** 2")),
    row("radius-squared-twice", SOLVER, "the radius is squared twice: c = f·f - r²", *sphere("radius**2 => radius**4")),
    row("diameter", SOLVER, "your spheres are twice as large: the scene gives the radius, not the diameter",
        *sphere("radius**2 => (2 * radius) ** 2"), resized(2)),
    row("half-radius", SOLVER, "your spheres are half as large: the scene gives the radius, not the diameter",
        *sphere("radius**2 => (radius / 2) ** 2"), resized(0.5)),
    row("radius-of-another", SOLVER,
        "spheres have a radius that is not theirs, the one of another sphere or a coordinate of the centre: each has "
        "its own",
        *(reradiused(f, own) for f in (lambda x, balls: balls[0].radius, lambda x, balls: balls[-1].radius)
          for own in (False, True)),
        reradiused(lambda x, balls: abs(x.center[2]))),
    row("factor-in-quadratic", SOLVER,
        "a factor is wrong in the quadratic: with b = 2 f·d, t = (-b - √(b² - 4c)) / 2; with b = f·d, "
        "t = -b - √(b² - c)",
        *sphere(f"{B} => b = np.sum", f"{B} => b = np.sum ;; {OVER} => / a", "4 * a * c => a * c", f"{OVER} => / a",
                HALF, "4 * a * c => 2 * a * c", f"4 * a * c => a * c ;; {OVER} => / a", f"{OVER} => / (4 * a)",
                "- 4 * a * c => + 4 * a * c", f"{B} => b = 4 * np.sum", f"{B} => b = 0.5 * np.sum")),
    row("root-missing", SOLVER, "the discriminant's square root is missing: t = (-b ± √disc) / (2a)",
        *(both(*rays, way) for rays in ((), (long,))
          for way in sphere(f"{ROOT} => disc", f"{HALF} ;; {OVER} => / a ;; {ROOT} => disc"))),
    row("divided-by-half-a", SOLVER,
        "`/ 2 * a` multiplies by a: write / (2 * a), or make the rays unit",
        *(both(*rays, way) for rays in ((long,), ())
          for way in sphere(f"{OVER} => / 2 * a", f"{HALF} ;; {OVER} => * a"))),
    row("disc-above", SOLVER,
        "the discriminant is held against a number above 0, so that spheres are too small, small ones most: a ray "
        "meets the sphere wherever it is not negative",
        *sphere(*(f"disc >= 0 => disc >= {k}" for k in (4e-2, 1e-2, 4e-3, 1e-3, 4e-4, 1e-4)),
                f"{ROOT} => np.sqrt(-disc) ;; disc >= 0 => disc <= 0")),
    row("b-sign", SOLVER,
        "f points the wrong way in the quadratic: f goes from the sphere's centre to the ray's origin (o - c)",
        *sphere("origins - center => center - origins")),
    row("disc-not-tested", SOLVER,
        "the discriminant is not tested: where it is negative the ray misses the sphere",
        *sphere("b * b - 4 * a * c => np.maximum(b * b - 4 * a * c, 0)",
                "b * b - 4 * a * c => np.abs(b * b - 4 * a * c)")),
    row("sum-of-all", SOLVER, "one sum is over all rays and components: sum over the last axis alone (axis=-1)",
        alone=sphere(f"{A} => a = np.sum(directions * directions)", f"{SQUARE} => np.sum(f * f)")),
    row("origin-left-out", SOLVER, "the rays' origin is left out of the quadratic: f = o - c",
        *sphere("origins - center => 0 * origins - center")),
    row("center-left-out", SOLVER, "the spheres' centres are left out of the quadratic: f = o - c",
        *sphere("origins - center => origins", "origins - center => origins + center")),
    row("t-too-near", SOLVER,
        "hits are thrown away unless t is large: the smallest t > 0 counts, however small",
        *(both(*way) for k in (0.1, 0.5, 1.0) for way in (
            (*sphere(f"(t > 0) => (t > {k})"), *plane(f"(t > 0) => (t > {k})")), sphere(f"(t > 0) => (t > {k})")))),
    row("t-too-far", SOLVER,
        "hits that are far away are thrown away: the first t to beat is infinity (np.inf)",
        *(only_seen(both(*sphere(f"(t > 0) => (t > 0) & (t < {k})"), *plane(f"(t > 0) => (t > 0) & (t < {k})")))
          for k in (1.0, 2.0, 3.0, 5.0, 10.0))),
    row("no-spheres", SOLVER, "no sphere is hit at all: the discriminant or the test t > 0 throws every hit away",
        *(of(way) for way in sphere(f"{HIT} => disc < -np.inf") for of in (both, only_seen))),
    row("no-planes", SOLVER, "the planes are missing: scene['planes'] holds rectangles, which rays meet too",
        *(of(way) for way in plane(f"{MET} => t < -np.inf") for of in (both, only_seen))),
    row("endless-planes", SOLVER, "your planes have no end: a rectangle ends at center ± half_u ± half_v",
        *_inside("np.isfinite(t)", IN_U, IN_V)),
    row("abs-missing", SOLVER,
        "your rectangles end on one side only: a point may lie on either side of the centre, |q·u| <= u·u, "
        "|q·v| <= v·v",
        *_inside(*(_between(*way) for way in (
            (("-np.inf", "1"),) * 2, (("-1", "np.inf"),) * 2, (("-np.inf", "1"), ("-1", "1")),
            (("-1", "np.inf"), ("-1", "1")), (("-1", "1"), ("-np.inf", "1")), (("-1", "1"), ("-1", "np.inf")))))),
    row("half-a-rectangle", SOLVER,
        "only a triangle of each rectangle is there: a rectangle is two of them, or |q·u| <= u·u and |q·v| <= v·v",
        *_also(f"{ALONG[0]} + {ALONG[1]} <= 0", f"{ALONG[0]} + {ALONG[1]} >= 0"),
        *_inside(f"({ALONG[0]} >= 0) & ({ALONG[1]} >= 0) & ({ALONG[0]} + {ALONG[1]} <= 1)")),
    row("grazing-plane-lost", SOLVER,
        "planes that are seen at a grazing angle are lost: only n·d = 0 itself, or less than 1e-9, is a miss",
        *_also(*(f"{GRAZING} > {k}" for k in (0.5, 0.3, 0.1, 0.05)))),
    row("or-for-and", SOLVER,
        "a point counts as inside a rectangle where one of the two bounds holds: both have to, |q·u| <= u·u and "
        "|q·v| <= v·v",
        *_inside(f"({IN_U}) | ({IN_V})")),
    row("extent-not-unit", SOLVER,
        "the extent of your rectangles is measured along half_u and half_v without dividing by their lengths: "
        "|q·u| <= u·u, or |q·u| / |u| <= |u|",
        *_inside(_reach(NU, NV), _reach("1", "1"), _reach(f"{NU}**3", f"{NV}**3"))),
    row("extent-from-elsewhere", SOLVER,
        "a rectangle's extent is measured from the wrong point: q = p - center, where p = origin + t direction",
        *plane("directions - center => directions", "q = origins + t => q = t",
               "q = origins + t[:, None] * directions - center => q = t[:, None] * directions")),
    row("box-for-rectangle", SOLVER,
        "a rectangle's extent is tested along the axes of the board, so that turned ones have another shape: test "
        "along its own edges, |q·u| <= u·u, |q·v| <= v·v",
        *_inside(*(f"(np.abs(q[:, :{n}]) <= {size} + 1e-6).all(axis=-1)" for n, size in (
            (3, "np.abs(half_u) + np.abs(half_v)"), (2, "(np.abs(half_u) + np.abs(half_v))[:2]"),
            (2, f"np.array([{NU}, {NV}])"), (2, "np.abs([half_u[0], half_v[1]])"))))),
    row("corner", SOLVER,
        "your rectangles begin at their centre: a plane's center is its middle, and it reaches from -half_u to half_u",
        *_inside(*(_between(*way) for k in ("1", "2") for way in (
            (("0", k),) * 2, (("0", k), ("-1", "1")), (("-1", "1"), ("0", k)))))),
    row("edges-swapped", SOLVER, "half_u and half_v are mixed up in a rectangle's test: |q·u| <= u·u, |q·v| <= v·v",
        *_inside(_reach(f"{NU} * {NV}", f"{NU} * {NV}"), *(way for k in (1, 2) for way in (
            _reach("half_u @ half_u", f"{NV}**2 * ({NU} / {NV}) ** {k}"),
            _reach(f"{NU}**2 * ({NV} / {NU}) ** {k}", "half_v @ half_v"))))),
    row("disc-for-rectangle", SOLVER,
        "your planes have another shape: a rectangle ends at center ± half_u ± half_v, |a| <= 1 and |b| <= 1 each by "
        "itself",
        *_inside(*(f"np.linalg.norm(q, axis=-1) <= {r}" for r in (
            f"max({NU}, {NV})", f"min({NU}, {NV})", f"np.hypot({NU}, {NV})", NU, NV)),
            f"np.hypot({ALONG[0]}, {ALONG[1]}) <= 1", f"np.abs({ALONG[0]}) + np.abs({ALONG[1]}) <= 1")),
    row("plane-through-origin", SOLVER, "your planes go through the origin: (p - center)·n = 0",
        *plane("center - origins => -origins ;; directions - center => directions", "center - origins => -origins")),
    row("plane-t", SOLVER,
        "the planes' t is wrong: t = (center - origin)·n / d·n, with these signs, and the same n above and below",
        *plane("center - origins => origins - center", f"{T} => {T} * np.linalg.norm(n)",
               f"{T} => {T} / np.linalg.norm(n)", f"{T} => (directions @ n) / ((center - origins) @ n)")),
    row("one-sided", SOLVER,
        "planes are met from one side only: they are rectangles that are seen, lit and cast shadows from both sides",
        *(of(way) for of in (both, only_seen, in_shadow_test)
          for way in _also("directions @ n < 0", "directions @ n > 0"))),
    row("edges-not-turned", SOLVER,
        "the planes' centres are in one frame and their edges in another: half_u and half_v are turned by R, too",
        *(other(partial(_edges_turned, turn=f)) for f in (lambda R: R.T, lambda R: R, lambda R: R.T @ R.T)),
        *(other(partial(_edges_turned, turn=lambda R: R.T, which=which)) for which in ("half_u", "half_v"))),
    row("edges-moved", SOLVER,
        "t is added to the planes' edges: half_u and half_v are directions, which are turned only",
        other(_edges_moved)),
    row("half-edges", SOLVER,
        "your rectangles have the wrong size: half_u and half_v are half-edges, from the centre to the rim",
        *_inside(*(_reach(f"{k} * (half_u @ half_u)", f"{k} * (half_v @ half_v)") for k in (0.5, 2.0)))),
    row("cross-product", SOLVER,
        "your planes are tilted, half_u × half_v goes wrong: it is (u_y v_z - u_z v_y, u_z v_x - u_x v_z, "
        "u_x v_y - u_y v_x), divided by its length in all three components",
        *_crossed(*(f"n[{k}] = {wrong.format(i=(k + 1) % 3, j=(k + 2) % 3, k=k)}" for wrong in (
            "-n[{k}]", "half_u[{i}] * half_v[{j}] + half_u[{j}] * half_v[{i}]",
            "half_u[{i}] * half_v[{j}] - half_u[{j}] * half_v[{k}]",
            "half_u[{i}] * half_v[{j}] - half_u[{j}] * half_v[{j}]") for k in (1, 2, 0))),
        *(both(*plane(f"{CROSS} => {CROSS}\n    n[{k}] = n[{k}] * np.linalg.norm(n)"), *normals_at(
            f"np.tile(n / np.linalg.norm(n) => np.tile(np.where(np.arange(3) == {k}, n, n / np.linalg.norm(n))"))
          for k in range(3))),
    row("planes-behind", SOLVER, "planes behind the ray's start count too: keep t > 0 alone",
        *plane(f"{MET} => inside", f"{T} => np.abs({T})")),
)  # fmt: skip


# ------------------------------------------------------------------------------------------ order


def last_of(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
    """The last that is hit at all."""
    met = np.isfinite(t)
    return np.where(met.any(axis=0), len(t) - 1 - met[::-1].argmax(axis=0), -1)


def first_of(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
    met = np.isfinite(t)
    return np.where(met.any(axis=0), met.argmax(axis=0), -1)


def _planes_first(t: Array, things: tuple[Shape, ...], rays: Rays, which: Any) -> Array:
    """One of a list that has the planes before the spheres."""
    order = np.array(sorted(range(len(things)), key=lambda k: is_sphere(things[k])), int)
    found = which(t[order], tuple(things[k] for k in order), rays)
    return np.where(found >= 0, order[found], -1)


def _one_of_kind(t: Array, things: tuple[Shape, ...], rays: Rays, kind: type, which: Any) -> Array:
    """See the last or the first hit of one kind, or something of the other kind before it."""
    alike = np.array([isinstance(thing, kind) for thing in things])[:, None]
    one = which(np.where(alike, t, np.inf), things, rays)
    return nearest(np.where(alike & (np.arange(len(things))[:, None] != one), np.inf, t), things, rays)


def _painted(t: Array, things: tuple[Shape, ...], rays: Rays, on_top: type) -> Array:
    """The last of this kind that is hit, before all of the other."""
    top = np.array([isinstance(thing, on_top) for thing in things])[:, None]
    last = last_of(np.where(top, t, np.inf), things, rays)
    return np.where(last >= 0, last, nearest(t, things, rays))


def _all_written(x: Terms, kinds: tuple[type, ...], albedo: bool, normal: bool, there: bool = True) -> Terms:
    """Write the albedo or normal of the last object of these kinds that the eye's ray meets.

    `there`: the normal where it is met itself, not at the point that is seen.
    """
    eye, things = np.array(x.scene.camera.eye)[:, None], x.scene.objects
    if not things:
        return x
    d = _made_unit(x.hits.point - eye)
    rays = Rays(eye, d, d, np.ones(d.shape[1]))
    t = meet_all(eye, d, things, RIGHT)
    t[[not isinstance(thing, kinds) for thing in things]] = np.inf
    last = last_of(t, things, rays)
    ids = np.where(last >= 0, last, x.hits.ids)
    if albedo:
        x = x._replace(albedo=np.array([*(thing.material.albedo for thing in things), (0.0, 0.0, 0.0)])[ids].T)
    if not normal:
        return x
    n = x.hits.normal.copy()
    for k in np.unique(last[last >= 0]):
        here = last == k
        own = Rays(eye, d[:, here], d[:, here], rays.stretch[here])
        n[:, here] = outward(eye + t[k, here] * own.d if there else x.hits.point[:, here], own, things[k])
    return x._replace(cos=(n * np.array(x.scene.sun.to_light)[:, None]).sum(axis=0))


def by_key(key: Callable[[Array, Shape, Rays], Any]) -> Change:
    """See the hit of the least key (t (N,), thing, rays) -> (N,)."""

    def order(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
        keys = np.stack([np.broadcast_to(key(t[k], thing, rays), t[k].shape) for k, thing in enumerate(things)])
        return nearest(np.where(np.isfinite(t), keys, np.inf), things, rays)

    return put(order=order)


def _center_away(t: Array, thing: Shape, rays: Rays) -> Any:
    return np.linalg.norm(rays.origin[:, 0] - thing.center)


def is_sphere(thing: Shape) -> bool:
    return isinstance(thing, Sphere)


def less(kind: Any, lost: Callable[[list[int]], list[int]]) -> tuple[Change, Change]:
    """Lose some objects of this kind: out of reach, so that ids stay; or for the eye alone."""

    def which(things: Casters) -> list[int]:
        return lost([i for i, thing in enumerate(things) if isinstance(thing, kind)])

    def order(t: Array, things: Casters, rays: Rays) -> Array:
        t = t.copy()
        t[which(things)] = np.inf
        return nearest(t, things, rays)

    def gone(things: Casters) -> Casters:
        out = which(things)
        return tuple(_gone(x) if i in out else x for i, x in enumerate(things))

    return lambda s: s._replace(objects=lambda things, camera: gone(s.objects(things, camera))), put(order=order)


def offset_by(eps: float, along_light: bool = False) -> Callable[[Hits, Array, Casters, Steps], Array]:
    """The shadow ray starts eps metres along the normal (or towards the light), and may meet its own object."""

    def blocked(hits: Hits, to: Array, things: Casters, steps: Steps) -> Array:
        away = np.broadcast_to(to, hits.point.shape) if along_light else hits.normal
        return _any_blocks(hits.point + eps * away, to, things, steps)

    return blocked


def _any_blocks(start: Array, to: Array, things: Casters, steps: Steps, limit: float = np.inf) -> Array:
    to = np.broadcast_to(to, start.shape)
    t = meet_all(start, to, things, steps)
    return np.asarray((np.isfinite(t) & (t < limit)).any(axis=0))


def all_at_last(*kinds: type) -> Change:
    """Put the last object of each of these kinds in the place of all; the first one's colour is seen on it."""

    def merged(things: Casters) -> Casters:
        made = list(things)
        for kind in kinds:
            alike = [i for i, thing in enumerate(things) if isinstance(thing, kind)]
            for i in alike[1:]:
                made[i] = _gone(things[i])
            for i in alike[:1]:
                made[i] = msgspec.structs.replace(things[alike[-1]], material=things[i].material)
        return tuple(made)

    return lambda s: s._replace(objects=lambda things, camera: merged(s.objects(things, camera)))


def _by_rounded(t: Array, things: Casters, rays: Rays, to: Any, unit: bool) -> Array:
    """The least rounded t, of rays that are `unit` or have z = 1; of those that are equal the first."""
    return nearest(to(t / (1.0 if unit else rays.stretch)), things, rays)


def _at_rounded(rays: Rays, t: Array, to: Any, unit: bool) -> Array:
    stretch = 1.0 if unit else rays.stretch
    return rays.origin + to(t / stretch) * stretch * rays.aim


def _of_true_point(point: Array, rays: Rays, thing: Shape) -> Array:
    """Normals that are taken where the ray meets the object, whatever point is kept."""
    t = meet(rays.origin, rays.d, thing, RIGHT)
    return outward(rays.origin + np.where(np.isfinite(t), t, 0) * rays.d, rays, thing)


def rounded_t(to: Any) -> Iterator[Change]:
    """t is kept as to(t): to be compared alone, for where shadow rays start, too, or even for normals."""
    for unit in (True, False):
        order = put(order=partial(_by_rounded, to=to, unit=unit))
        yield order
        for test in (offset_by(1e-6), others_hide):
            point = both(order, put(point=partial(_at_rounded, to=to, unit=unit), blocked=test))
            yield from (both(point, put(normal=_of_true_point)), point)


ORDERS = (
    row("last-wins", ORDER,
        "no depth test: of all objects on a ray, the last one tested is shown; keep the one of the smallest t",
        put(order=last_of), put(order=partial(_planes_first, which=last_of))),
    row("first-wins", ORDER,
        "no depth test: of all objects on a ray, the first one tested is shown; keep the one of the smallest t",
        put(order=first_of), put(order=partial(_planes_first, which=first_of)),
        *(put(order=partial(_one_of_kind, kind=kind, which=first_of)) for kind in (Sphere, Rectangle))),
    row("painter", ORDER,
        "objects are drawn by the distance of their centres (painter's order): compare t on each ray",
        by_key(_center_away),
        by_key(lambda t, thing, rays: _center_away(t, thing, rays) if is_sphere(thing) else 1e6 + t),
        by_key(lambda t, thing, rays: _center_away(t, thing, rays) - getattr(thing, "radius", 0.0)),
        by_key(lambda t, thing, rays: -thing.center[2] if is_sphere(thing) else 1e6 + t)),
    row("spheres-on-top", ORDER,
        "spheres always hide planes: compare the t of all objects, planes and spheres alike",
        by_key(lambda t, thing, rays: t if is_sphere(thing) else t + 1e6),
        put(order=partial(_painted, on_top=Sphere))),
    row("planes-on-top", ORDER,
        "planes always hide spheres: compare the t of all objects, planes and spheres alike",
        by_key(lambda t, thing, rays: t + 1e6 if is_sphere(thing) else t),
        put(order=partial(_painted, on_top=Rectangle))),
    *(row(f"last-{name}-wins", ORDER,
          f"among {name}s the last one hit is shown, not the nearest: compare t between them too",
          put(order=partial(_one_of_kind, kind=kind, which=last_of)))
      for name, kind in (("sphere", Sphere), ("plane", Rectangle))),
    row("farthest-wins", ORDER, "the farthest object on a ray is shown: keep the one of the smallest t",
        by_key(lambda t, thing, rays: -t)),
    row("t-of-other-rays", ORDER,
        "t of spheres and of planes is compared across rays of different length: t is a distance only along unit rays",
        by_key(lambda t, thing, rays: t if is_sphere(thing) else t / rays.stretch),
        by_key(lambda t, thing, rays: t / rays.stretch if is_sphere(thing) else t)),
    row("depth-from-elsewhere", ORDER,
        "depth is measured from the board's origin, not from the eye: keep the smallest t on each ray",
        by_key(lambda t, thing, rays: np.linalg.norm(rays.origin + np.where(np.isfinite(t), t, 0) * rays.aim, axis=0))),
    row("hidden-one-written", ORDER,
        "albedo or normals are written for every object that a ray meets, not only for the nearest: use the mask of "
        "the closer t for them, too",
        *(terms(partial(_all_written, kinds=kinds, albedo=albedo, normal=normal))
          for albedo, normal in ((True, False), (False, True), (True, True))
          for kinds in ((Sphere, Rectangle), (Rectangle,), (Sphere,))),
        *(both(put(blocked=test), terms(partial(
            _all_written, kinds=(Sphere, Rectangle), albedo=True, normal=True, there=False)))
          for test in (hidden, others_hide))),
    row("t-rounded", ORDER,
        "t is kept in whole numbers or few digits (np.full(n, 10000) makes an array of integers): objects are compared "
        "by it, or points are made of it; keep it in float64, np.full(n, np.inf)",
        *rounded_t(np.floor), *(put(order=partial(_by_rounded, to=f, unit=unit))
                                for f in (np.rint, partial(np.round, decimals=1)) for unit in (True, False)),
        *(put(point=partial(_at_rounded, to=partial(np.round, decimals=k), unit=True), blocked=others_hide)
          for k in (0, 1, 2))),
    row("one-sphere", ORDER,
        "only one of the spheres is there, in its own colour or in another's: test every ray against each of them "
        "(functions that are made in a loop see its variable as it is in the end: the last sphere)",
        *less(Sphere, lambda alike: alike[1:]), *less(Sphere, lambda alike: alike[:-1]),
        all_at_last(Sphere), all_at_last(Sphere, Rectangle)),
    row("object-missing", ORDER, "one object is missing: the loop ends too early or begins too late, test them all",
        *(way for kind, one in product((Sphere, Rectangle, (Sphere, Rectangle)), (slice(1), slice(-1, None)))
          for way in less(kind, itemgetter(one)))),
    row("one-plane", ORDER,
        "only one of the planes is there, in its own colour or in another's: test every ray against each of them "
        "(functions that are made in a loop see its variable as it is in the end: the last plane)",
        *less(Rectangle, lambda alike: alike[1:]), *less(Rectangle, lambda alike: alike[:-1]), all_at_last(Rectangle)),
)  # fmt: skip


# ------------------------------------------------------------------------------------------ normals


def _backs_shaded(x: Terms) -> Terms:
    """Planes that are seen from behind meet themselves on the way to the sun."""
    own = np.array([getattr(thing, "normal", (0, 0, 0)) for thing in x.scene.objects] + [(0, 0, 0)])[x.hits.ids].T
    hides = x.shadows & ((own * (np.array(x.scene.camera.eye)[:, None] - x.hits.point)).sum(axis=0) < 0)
    return x._replace(visible=np.where(hides, 0.0, x.visible))


def _fixed(n: Array, axis: Any) -> Array:
    return np.broadcast_to(np.array(axis)[:, None], n.shape)


def _turned_to_eye(n: Array, rays: Rays) -> Array:
    return np.where((n * rays.d).sum(axis=0) > 0, -n, n)


def _on_plane(x: Terms) -> Array:
    return np.array([not is_sphere(thing) for thing in x.scene.objects] + [False])[x.hits.ids]


def _lit_behind(x: Terms) -> Terms:
    return x._replace(cos=np.where(_on_plane(x), np.abs(x.cos), x.cos))


def _turned_by_origin(n: Array, p: Array, rays: Rays, thing: Shape, sign: int, flat: int = 0) -> Array:
    """A plane's by n·p; `flat`: where that is 0, 1 for the eye's side, -1 for the other; 0: chance, not predicted."""
    if isinstance(thing, Sphere):
        return n
    axis = _fixed(n, thing.normal)
    side = sign * float(np.dot(thing.normal, thing.center))
    return flat * n if abs(side) < 1e-9 else axis * (1 if side < 0 else -1)


def _of_other_center(x: Terms, k: int, unit: bool, inside: bool) -> Terms:
    """Take the normal of the first or last sphere; `inside`: where it points inwards, shadow rays start inside."""
    if not x.scene.spheres:
        return x
    one, flat = x.scene.spheres[k], _on_plane(x)
    n = (x.hits.point - np.array(one.center)[:, None]) / one.radius
    n = np.where(flat, x.hits.normal, _made_unit(n) if unit else n)
    dark = (inside and x.shadows) & ((n * x.hits.normal).sum(axis=0) < 0)
    return x._replace(cos=np.array(x.scene.sun.to_light) @ n, visible=np.where(dark, 0.0, x.visible))


def _by_number(x: Terms, inside: bool) -> Terms:
    """Sphere k has the normal of plane k, and planes have none; `inside`: shadow rays start there, and meet it."""
    flats = [thing.normal for thing in x.scene.objects if isinstance(thing, Rectangle)]
    balls = [k for k, thing in enumerate(x.scene.objects) if is_sphere(thing)]
    table = np.zeros((len(x.scene.objects) + 1, 3))
    for k, normal in zip(balls, flats, strict=False):
        table[k] = normal
    given, d = table[x.hits.ids].T, x.hits.point - np.array(x.scene.camera.eye)[:, None]
    given = np.where((given * d).sum(axis=0) > 0, -given, given)
    n = np.where(_on_plane(x) | given.any(axis=0), given, x.hits.normal)
    dark = ((n * x.hits.normal).sum(axis=0) < 0) & (inside and x.shadows)
    return x._replace(cos=np.array(x.scene.sun.to_light) @ n, visible=x.visible * ~dark)


def _turned_by_camera_ray(x: Terms, spheres: bool, inside: bool) -> Terms:
    """n·d with d in the camera's axes; `spheres`: theirs, too; `inside`: shadow rays start within, and meet them."""
    d = x.hits.point - np.array(x.scene.camera.eye)[:, None]
    flat = _on_plane(x)
    n = np.where(flat, _table(x.scene.objects).facing[x.hits.ids].T, x.hits.normal)
    away = ((n * (np.asarray(x.scene.camera.R_cam_board) @ d)).sum(axis=0) > 0) & (flat | spheres)
    dark = away & ~flat & (inside and x.shadows)
    return x._replace(cos=np.array(x.scene.sun.to_light) @ np.where(away, -n, n), visible=x.visible * ~dark)


@lru_cache(maxsize=8)
def _norms(scene: Scene) -> dict[str, Array]:
    """By what (K + 1, 3) each object's normals are divided where a norm is taken of more than one of them.

    `drawn`: of all pixels where a sphere was nearest when it was its turn; `left`: where it is in the end; `columns`:
    of these, axis by axis; `all`, `all columns`: of the whole picture.
    """
    step = int(np.ceil(np.sqrt(scene.camera.width * scene.camera.height / 20_000)))
    camera = scene.camera.resized(-(-scene.camera.width // step), -(-scene.camera.height // step))
    v, u = np.indices((camera.height, camera.width), float).reshape(2, -1)
    bench = Bench(scene.with_camera(camera), u, v)
    rays, hits = bench.rays(RIGHT), bench.hits(RIGHT)
    made = {name: np.ones((len(scene.objects) + 1, 3)) for name in ("drawn", "left", "columns")}
    t = meet_all(rays.origin, rays.d, scene.objects, RIGHT)
    for k, thing in enumerate(scene.objects):
        here = hits.ids == k
        if is_sphere(thing) and here.any():
            first = np.isfinite(t[k]) & (t[k] <= t[: k + 1].min(axis=0))
            made["drawn"][k] = step * np.sqrt(first.sum())
            made["left"][k] = step * np.sqrt(here.sum())
            made["columns"][k] = step * np.linalg.norm(hits.normal[:, here], axis=1)
    there = max(int((hits.ids >= 0).sum()), 1)
    made["all"] = np.full((len(scene.objects) + 1, 3), step * np.sqrt(there))
    made["all columns"] = step * np.linalg.norm(hits.normal, axis=1) + np.zeros((len(scene.objects) + 1, 1))
    return made


def _by_norm(x: Terms, of: str) -> Terms:
    n = x.hits.normal / np.maximum(_norms(x.scene)[of][x.hits.ids].T, 1e-9)
    return x._replace(cos=(n * np.array(x.scene.sun.to_light)[:, None]).sum(axis=0))


PLANES_BY_ORIGIN = (
    "the planes' normals are turned round by n·p, p measured from the board's origin: which side the eye sees is told "
    "by n·d"
)
FACED = "n = np.where(towards, n, -n)"
FREE = f'{FACED} => n = n if "radius" in thing else np.where(towards, n, -n)'
BALL, UP = '(points - thing["center"]) / thing["radius"]', "np.tile([0.0, 0.0, 1.0], (len(points), 1))"
PAINT = 'np.tile(thing["albedo"], (len(points), 1))'


def _ball(*texts: str) -> tuple[Change, ...]:
    """Other normals of spheres."""
    return normals_at(*(f"{FREE} ;; {BALL} => {text}" for text in texts))


def _flat(*texts: str) -> tuple[Change, ...]:
    """Other normals of planes, once they are half_u × half_v made unit."""
    return normals_at(*(f'{FACED} => n = n if "radius" in thing else {text}' for text in texts))


NORMALS_ = (
    row("normal-inward", NORMALS,
        "the spheres' normals point inwards: n = (p - center) / radius, from the centre to the point",
        *_ball('(thing["center"] - points) / thing["radius"]')),
    row("all-normals-inward", NORMALS,
        "the normals point away from the eye, those of planes too: turn them round",
        *normals_at("np.where(towards, n, -n) => np.where(towards, -n, n)")),
    row("plane-normal-turned", NORMALS,
        "the planes' normals point to the side that the eye does not see: turn them round where n·d > 0",
        *_flat("np.where(towards, -n, n)")),
    row("plane-normal-fixed", NORMALS,
        "the planes' normals are half_u × half_v whatever side is seen, in shading or where shadow rays start: turn "
        "them round where n·d > 0",
        *_flat("n", "-n"), both(*_flat("n"), put(blocked=others_hide), terms(_backs_shaded)), terms(_backs_shaded)),
    row("plane-faces-light", NORMALS,
        "planes are lit on both sides at once, their normals turned to the sun, or up: a normal belongs to the side "
        "that the eye sees, and max(0, n·l) is 0 where that is turned away from the sun",
        both(put(blocked=others_hide), terms(_lit_behind)), terms(_lit_behind),
        *_flat("np.where(n[:, 2:] < 0, -n, n)")),
    row("plane-normal-by-origin", NORMALS,
        PLANES_BY_ORIGIN,
        *(normals(partial(_turned_by_origin, sign=k)) for k in (1, -1)),
        *_flat("np.where(np.sum(n * eye, axis=-1, keepdims=True) < 0, -n, n)")),
    row("plane-normal-up", NORMALS, "the planes' normals are taken for the board's z axis: they are half_u × half_v",
        *_flat(UP), *normals_at(f"{CROSS_AT} => n = np.array([0.0, 0.0, 1.0])")),
    row("normal-turned-by-other-ray", NORMALS,
        "normals are turned to the eye by a ray in another frame: in n·d both have to be in the board's",
        *(both(put(blocked=others_hide), terms(partial(_turned_by_camera_ray, spheres=balls, inside=dark)))
          for balls, dark in ((True, False), (True, True), (False, False)))),
    row("plane-normal-edge", NORMALS, "the planes' normals lie in the plane: they are half_u × half_v",
        *normals_at(*(f'{CROSS_AT} => n = thing["{edge}"]' for edge in ("half_u", "half_v")))),
    row("normal-not-unit", NORMALS,
        "the spheres' normals are not unit: divide p - center by the radius",
        *_ball('points - thing["center"]', '(points - thing["center"]) * thing["radius"]')),
    row("normal-by-radius-twice", NORMALS,
        "the spheres' normals are divided by the radius once too often: (p - center) / radius is unit",
        *_ball(f'{BALL} / thing["radius"]')),
    row("made-unit-by-square", NORMALS,
        "vectors are divided by v·v, the square of their length: v / √(v·v) is unit",
        *normals_at(f'{FREE} ;; {BALL} => {BALL} / thing["radius"] ;; n / np.linalg.norm(n) => n / (n @ n)',
                    "n / np.linalg.norm(n) => n / (n @ n)")),
    row("normal-by-whole-norm", NORMALS,
        "the normals are divided by the norm of the whole array, or along the wrong axis: each by its own length, "
        "np.linalg.norm(n, axis=-1, keepdims=True)",
        *(terms(partial(_by_norm, of=of)) for of in ("drawn", "left", "columns", "all", "all columns"))),
    row("normal-from-origin", NORMALS,
        "the spheres' normals point away from the origin, not from the sphere's centre: n = (p - center) / radius",
        *_ball(*(f"({p}) / np.linalg.norm({p}, axis=-1, keepdims=True)" for p in ("points", "points - eye")))),
    row("normal-of-another", NORMALS,
        "the spheres' normals point away from another sphere's centre: n = (p - center) / radius, with the centre of "
        "the sphere that was hit",
        *(both(put(blocked=others_hide), terms(partial(_of_other_center, k=k, unit=unit, inside=inside)))
          for k in (-1, 0) for unit, inside in ((True, False), (False, False), (False, True)))),
    row("normal-by-number", NORMALS,
        "the planes' normals are given to the spheres of the same number: in one list of all objects plane k has the "
        "number k + len(spheres)",
        *(both(put(blocked=others_hide), terms(partial(_by_number, inside=dark))) for dark in (True, False))),
    row("normal-to-eye", NORMALS,
        "the spheres' normals are the directions to the eye: n = (p - center) / radius",
        *_ball("(eye - points) / np.linalg.norm(eye - points, axis=-1, keepdims=True)")),
    row("plane-normal-not-unit", NORMALS,
        "the planes' normals are not unit: half_u × half_v has to be divided by its length",
        *normals_at("np.tile(n / np.linalg.norm(n) => np.tile(n")),
    row("one-array", NORMALS,
        "normals and albedo (or points) are kept in one and the same array, so that writing one overwrites the other: "
        "make one for each, a = b = np.zeros(...) makes only one",
        *normals_at(f"{FACED} => n = {PAINT}", f"towards = np => n = {PAINT}\n        towards = np",
                    f"{FACED} => n = points"),
        _colour(lambda x: x.hits.normal)),
    row("normal-axis", NORMALS,
        "one axis of the normals has the wrong sign",
        *_ball(*(f"{BALL} * {signs}" for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1])))),
)  # fmt: skip


# ------------------------------------------------------------------------------------------ light


def shaded(f: Callable[[Terms], Array]) -> Change:
    """Another formula."""
    return put(shade=f)


def lit(f: Callable[[Array, Scene, Hits], Array]) -> Change:
    """Another direction to the light (3, 1) or (3, N), for shading and for shadows."""
    return lambda s: s._replace(light=lambda to, scene, hits: f(s.light(to, scene, hits), scene, hits))


def half_lit(f: Callable[[Array, Scene, Hits], Array]) -> Change:
    """The same for shading alone: shadows are cast rightly."""

    def recast(x: Terms) -> Terms:
        to = f(np.array(x.scene.sun.to_light)[:, None], x.scene, x.hits)
        return x._replace(cos=(x.hits.normal * to).sum(axis=0))

    return terms(recast)


def sun(x: Terms, cos: Any = None) -> Array:
    """The sun's part."""
    return x.albedo / pi * x.irradiance * x.visible * (np.maximum(x.cos, 0) if cos is None else cos)


def ambient(x: Terms) -> Array:
    return x.albedo * x.sky


def sun_times(f: Any) -> Change:
    """The sun's part, a function of it and the terms; or a factor."""
    return terms(lambda x: x._replace(irradiance=x.irradiance * (f(x) if callable(f) else f)))


def sky_times(f: Any) -> Change:
    return terms(lambda x: x._replace(sky=x.sky * (f(x) if callable(f) else f)))


def turned(turn: Callable[[Array], Array]) -> tuple[Change, ...]:
    """The light's direction turned by a function of R: everywhere, or for shading alone."""
    f = lambda to, scene, hits: turn(np.asarray(scene.camera.R_cam_board)) @ to  # noqa: E731
    return lit(f), half_lit(f)


def moved_light(f: Callable[[Array, Array, Array], Array]) -> tuple[Change, ...]:
    """(to, R, t) -> a direction, made unit or not."""

    def g(to: Array, scene: Scene, hits: Hits, unit: bool) -> Array:
        R, t = np.asarray(scene.camera.R_cam_board), np.array(scene.camera.t_cam_board)[:, None]
        return _made_unit(f(to, R, t)) if unit else f(to, R, t)

    return tuple(lit(partial(g, unit=unit)) for unit in (True, False))


def _to_position(to: Array, scene: Scene, hits: Hits) -> Array:
    return _made_unit(to - hits.point)


def _to_eye(to: Array, scene: Scene, hits: Hits, sign: int) -> Array:
    return sign * _made_unit(np.array(scene.camera.eye)[:, None] - hits.point)


def _off_position(to: Array, scene: Scene, hits: Hits) -> Array:
    return _made_unit(hits.point - to)


def _to_place_by_eye(to: Array, scene: Scene, hits: Hits) -> Array:
    """The same in the camera's frame."""
    return _made_unit(to + np.array(scene.camera.eye)[:, None] - hits.point)


def _grey(x: Array) -> Array:
    return np.broadcast_to(x.mean(axis=0, keepdims=True), x.shape)


def _permuted(*order: int, sign: tuple[int, int, int] = (1, 1, 1)) -> Callable[[Array, Scene, Hits], Array]:
    return lambda to, scene, hits: to[list(order)] * np.array(sign)[:, None]


def _of_one(x: Terms, k: int) -> Array:
    """The first or the last object's albedo on all."""
    one = np.array(x.scene.objects[k].material.albedo)[:, None] if x.scene.objects else 1.0
    return one + 0 * x.albedo


def _of_first(x: Terms) -> Array:
    """The first object's albedo on all spheres."""
    first = np.array(x.scene.objects[0].material.albedo)[:, None] if x.scene.objects else 1.0
    spheres = np.array([is_sphere(thing) for thing in x.scene.objects] + [False])[x.hits.ids]
    return np.where(spheres, first, x.albedo)


def _of_next(x: Terms, by: int) -> Array:
    """The albedo of the sphere `by` places on."""
    balls = [i for i, thing in enumerate(x.scene.objects) if is_sphere(thing)]
    table = [thing.material.albedo for thing in x.scene.objects]
    for k, i in enumerate(balls):
        table[i] = x.scene.objects[balls[(k + by) % len(balls)]].material.albedo
    return np.array([*table, (0.0, 0.0, 0.0)])[x.hits.ids].T


def _of_table(x: Terms, f: Callable[[list[Any], list[Any]], list[Any]]) -> Array:
    """By the object's index, from a table in another order: of the spheres' albedos and the planes'."""
    balls, flats = (
        [thing.material.albedo for thing in x.scene.objects if is_sphere(thing) == k] for k in (True, False)
    )
    table = f(balls, flats)
    return np.array([*table, (0.0, 0.0, 0.0)])[np.minimum(x.hits.ids, len(table))].T


def _darkened(x: Terms, f: Callable[[Array], Array]) -> Array:
    """Multiply each albedo by f of all before it, as if an array of the scene were changed in place."""
    each = [f(np.array(thing.material.albedo)) for thing in x.scene.objects]
    return np.cumprod([np.ones(3), *each], axis=0)[x.hits.ids].T


def _darkened_sky(scene: Scene) -> Array:
    return np.array(scene.sky.radiance) * np.prod([thing.material.albedo for thing in scene.objects], axis=0)


def _on_kind(x: Terms, planes: bool, k: float) -> Array:
    """A factor of one kind of objects."""
    return np.where(_on_plane(x) == planes, k, 1.0)


def _sky_scaled(scene: Scene, k: float) -> Array:
    return k * np.array(scene.sky.radiance)


def _falloff(x: Terms) -> Array:
    """1 / (distance to to_light, taken for a place)²."""
    away = np.array(x.scene.sun.to_light)[:, None] - x.hits.point
    return 1 / np.maximum((away * away).sum(axis=0), 1e-12)


def _by_distance(x: Terms, power: int) -> Array:
    return np.linalg.norm(x.hits.point - np.array(x.scene.camera.eye)[:, None], axis=0) ** -power


def _in_shadow(x: Terms) -> Array:
    return np.where((x.visible > 0) & (x.cos > 0), 0.0, 1.0)


def _up(x: Terms) -> Array:
    return (1 + x.hits.normal[2]) / 2


def where_cast(change: Change) -> Change:
    """What is done in shadow is done where another object casts it: what faces away from the sun is not tested."""
    return both(put(blocked=others_hide), change)


shade = partial(slips, "shade")
COS = "np.sum(normals * to_light, axis=-1, keepdims=True)"
CLAMPED, SUN, SUM = (
    f"np.maximum(0, {COS})",
    "albedo / np.pi * irradiance * cosine",
    ("albedo / np.pi * irradiance * cosine + albedo * sky"),
)
SUMMED, SUMMED_SKY = (f"np.repeat(albedo @ {light}[:, None], 3, axis=-1)" for light in ("irradiance", "sky"))
LIGHTS = (
    row("light-reversed", LIGHT,
        "the light comes from the wrong side: to_light points from the surface to the sun, use it as it is",
        lit(lambda to, *_: -to)),
    row("light-reversed-in-shading", LIGHT,
        "n·l is taken with the wrong sign of l, though shadow rays go the right way: to_light points from the surface "
        "to the sun, use it as it is",
        *(both(half_lit(lambda to, *_: -to), put(blocked=test)) for test in (others_hide, offset_by(1e-6))),
        alone=shade(f"{CLAMPED} => np.maximum(0, -{COS})", f"{CLAMPED} => np.minimum(0, {COS})")),
    row("light-in-camera-frame", LIGHT,
        "the sun's direction is given in the board's frame, but your normals are in the camera's (or the other way "
        "round): turn one of them by R",
        *turned(lambda R: R.T)),
    row("light-turned-needlessly", LIGHT,
        "the sun's direction is turned by R although points and normals are in the board's frame already",
        *turned(lambda R: R)),
    row("light-turned-by-transpose", LIGHT,
        "the sun's direction is turned by Rᵀ instead of R",
        *turned(lambda R: R.T @ R.T)),
    row("light-moved", LIGHT,
        "the sun's direction is moved by t as if it were a point (a homogeneous 1): only turn it",
        *moved_light(lambda to, R, t: to + R.T @ t), *moved_light(lambda to, R, t: to - R.T @ t),
        *moved_light(lambda to, R, t: to + t)),
    row("light-axes", LIGHT,
        "the axes of the sun's direction (or of all normals) are mixed up, or one has the wrong sign: z is up here",
        lit(_permuted(0, 2, 1)), lit(_permuted(1, 0, 2)), lit(_permuted(2, 1, 0)),
        lit(_permuted(0, 2, 1, sign=(1, 1, -1))), lit(_permuted(0, 1, 2, sign=(1, -1, 1))),
        lit(_permuted(0, 1, 2, sign=(-1, 1, 1))), lit(_permuted(0, 1, 2, sign=(1, 1, -1))),
        lit(_permuted(0, 1, 2, sign=(-1, -1, 1))), lit(_permuted(0, 2, 1, sign=(1, -1, 1))),
        *(half_lit(_permuted(0, 1, 2, sign=sign)) for sign in ((1, 1, -1), (1, -1, 1), (-1, 1, 1))),
        *(half_lit(_permuted(*order)) for order in ((0, 2, 1), (1, 0, 2), (2, 1, 0)))),
    row("light-as-place", LIGHT,
        "to_light is used as a point that the light sits at: it is a direction, the same for every surface",
        lit(_to_position), both(lit(_to_position), sun_times(_falloff)), half_lit(_to_position), lit(_to_place_by_eye),
        half_lit(_off_position), both(half_lit(_off_position), put(blocked=offset_by(1e-6))),
        both(half_lit(_to_position), sun_times(_falloff)),
        alone=shade(f"{CLAMPED} => np.maximum(0, np.sum(normals * (to_light - points), axis=-1, keepdims=True) / "
                    "np.linalg.norm(to_light - points, axis=-1, keepdims=True))")),
    row("light-at-eye", LIGHT,
        "surfaces are lit from the eye, by n·d of the ray that sees them: the sun's light falls along to_light",
        half_lit(partial(_to_eye, sign=1)), half_lit(partial(_to_eye, sign=-1))),
    row("dot-product", LIGHT,
        "n·l is mistyped: it is n_x l_x + n_y l_y + n_z l_z, each component with the same one of the other",
        *shade(*(f"{COS} => ({COS} - normals[:, {k}:{k + 1}] * to_light[{k}] + {term.format(k=k)})" for term in (
            "normals[:, {k}:{k}+1] ** 2", "to_light[{k}] ** 2", "0") for k in (2, 0, 1)),
            *(f"{COS} => 3 * normals[:, {k}:{k + 1}] * to_light[{k}]" for k in (2, 0, 1)))),
    row("no-clamp", LIGHT,
        "light is negative where a surface faces away from the sun: max(0, n·l)",
        *shade(f"{CLAMPED} => {COS}")),
    row("abs-cosine", LIGHT,
        "surfaces that face away from the sun are lit: max(0, n·l), not |n·l|",
        *(both(*test, *shade(f"{CLAMPED} => np.abs({COS})")) for test in ((), (put(blocked=others_hide),)))),
    row("squared-cosine", LIGHT, "the cosine is squared: max(0, n·l) goes in once",
        *shade(f"{CLAMPED} => {CLAMPED} ** 2", f"{CLAMPED} => {COS} ** 2")),
    row("angle-for-cosine", LIGHT,
        "n·l is the cosine of the angle already: take no arccos, cos or sin of it, and no degrees",
        *shade(*(f"{CLAMPED} => {f.format(c=f'np.clip({COS}, 0, 1)')}" for f in (
            "np.cos({c})", "np.arccos({c})", "np.sqrt(1 - {c} ** 2)", "np.cos(np.degrees(np.arccos({c})))")),
            f"{CLAMPED} => np.maximum(0, np.arccos({COS}))")),
    row("distance-falloff", LIGHT,
        "the sun's light gets weaker with distance: the sun is so far away that its irradiance is the same everywhere",
        *(sun_times(partial(_by_distance, power=k)) for k in (2, 1)),
        both(sun_times(partial(_by_distance, power=2)), sky_times(partial(_by_distance, power=2)))),
    row("no-cosine", LIGHT, "the cosine is missing: the sun's light falls with max(0, n·l)",
        *shade(f"{CLAMPED} => ({COS} > 0)", f"{CLAMPED} => np.ones_like({COS})")),
    row("half-lambert", LIGHT, "n·l is mapped to 0..1 as (1 + n·l) / 2: it has to be max(0, n·l)",
        *shade(f"{CLAMPED} => (1 + {COS}) / 2", f"{CLAMPED} => ((1 + {COS}) / 2) ** 2")),
    row("albedo-missing-sun", LIGHT, "the albedo is missing in the sun's part: albedo/π E max(0, n·l)",
        *shade("albedo / np.pi => 1 / np.pi")),
    row("albedo-missing", LIGHT, "the albedo is missing: it multiplies the sun's part and the sky's",
        *shade(f"{SUM} => irradiance / np.pi * cosine + sky + 0 * albedo")),
    row("albedo-squared", LIGHT, "the albedo is multiplied in twice",
        *shade("albedo / np.pi => albedo**2 / np.pi ;; albedo * sky => albedo**2 * sky",
               "albedo / np.pi => albedo**2 / np.pi", "albedo * sky => albedo**2 * sky")),
    row("albedo-decoded", LIGHT, "the albedo is treated as a display colour: it is linear, use it as it is",
        _colour(lambda x: srgb_decode(x.albedo)), _colour(lambda x: x.albedo**2.2),
        _colour(lambda x: srgb_encode(x.albedo)), _colour(lambda x: x.albedo ** (1 / 2.2)),
        _colour(lambda x: np.sqrt(x.albedo))),
    row("albedo-of-another", LIGHT, "objects have another one's albedo: check the index",
        _colour(_of_first), _colour(partial(_of_one, k=0)), _colour(partial(_of_one, k=-1)),
        *(_colour(partial(_of_next, by=k)) for k in (1, -1))),
    row("albedo-order", LIGHT,
        "the table of albedos is in another order than the objects that the index counts: spheres, then planes, in "
        "both",
        *(_colour(partial(_of_table, f=f)) for f in (
            lambda balls, flats: flats + balls, lambda balls, flats: (balls + flats)[::-1],
            lambda balls, flats: balls + (balls * len(flats))[: len(flats)],
            lambda balls, flats: (balls + flats)[1:] + (balls + flats)[:1],
            lambda balls, flats: (balls + flats)[-1:] + (balls + flats)[:-1]))),
    row("channels-summed", LIGHT,
        "albedo and light are multiplied by a dot product (@), which sums over the channels: multiply channel by "
        "channel (*)",
        *shade(f"{SUN} => {SUMMED} / np.pi * cosine", f"albedo * sky => {SUMMED_SKY}",
               f"{SUN} => {SUMMED} / np.pi * cosine ;; albedo * sky => {SUMMED_SKY}")),
    row("changed-in-place", LIGHT,
        "the scene's own array is changed in place (*=, /=), so that each object changes the light of the next one: "
        "write a = b * c",
        both(sky_times(partial(_darkened, f=lambda a: a)), behind(_darkened_sky)),
        sky_times(partial(_darkened, f=lambda a: a)), sun_times(partial(_darkened, f=lambda a: a)),
        sun_times(partial(_darkened, f=lambda a: a / pi)), sun_times(partial(_darkened, f=lambda a: 1 / pi + 0 * a))),
    row("albedo-channels", LIGHT, "the albedo's channels are mixed up: they are red, green, blue",
        _colour(lambda x: x.albedo[::-1]), _colour(lambda x: np.broadcast_to(x.albedo[:1], x.albedo.shape)),
        _colour(lambda x: _grey(x.albedo))),
    row("light-colour", LIGHT, "the light's colour is lost: irradiance and sky have three channels",
        *shade(*(f"* irradiance => * {one}" for one in (
            "np.mean(irradiance)", "irradiance[0]", "np.max(irradiance)", "np.linalg.norm(irradiance)",
            "np.sum(irradiance)", "irradiance[::-1]")), "albedo * sky => albedo * np.mean(sky)",
               "albedo * sky => albedo * sky[0]")),
    row("irradiance-missing", LIGHT, "the sun's irradiance E is missing: albedo/π E max(0, n·l)",
        *shade(*(f"* irradiance => {new}" for new in (
            "* (irradiance > 0)", "* np.pi * (irradiance > 0)", "* irradiance / max(np.max(irradiance), 1e-300)",
            "* irradiance / max(np.linalg.norm(irradiance), 1e-300)")))),
    row("irradiance-squared", LIGHT, "the sun's irradiance is multiplied in twice",
        *shade("* irradiance => * irradiance**2")),
    row("pi-multiplied", LIGHT, "the sun's part is multiplied by π where it has to be divided: albedo/π E max(0, n·l)",
        *shade("/ np.pi => * np.pi")),
    row("pi-missing", LIGHT,
        "the sun's part is π times too bright: a Lambertian surface reflects albedo/π, not albedo",
        *shade(" / np.pi => ")),
    row("pi-twice", LIGHT, "the sun's part is divided by π twice",
        *shade("/ np.pi => / np.pi**2")),
    row("pi-missing-everywhere", LIGHT, "everything that is lit is π times too bright: reflection is albedo/π of the "
        "irradiance, and a sky of constant radiance gives π Lₛ of it",
        *shade(f"{SUM} => np.pi * ({SUM})")),
    row("one-kind-by-pi", LIGHT,
        "spheres and planes are shaded by different formulas, the sun's part of one of them π times too bright or too "
        "dark: both reflect albedo/π E max(0, n·l)",
        *(sun_times(partial(_on_kind, planes=planes, k=k)) for planes in (False, True) for k in (pi, 1 / pi))),
    *(row(f"one-kind-without-{name}", LIGHT,
          f"spheres and planes are shaded by different formulas, one of them without the {name}'s light: both have "
          "albedo/π E max(0, n·l) + albedo Lₛ",
          *(times(partial(_on_kind, planes=planes, k=0.0)) for planes in (False, True)))
      for name, times in (("sun", sun_times), ("sky", sky_times))),
    row("sun-twice", LIGHT, "the sun's light is added twice",
        *shade("albedo / np.pi => 2 * albedo / np.pi")),
    row("sun-half", LIGHT, "the sun's part is half as bright as it should be",
        *shade("np.pi => (2 * np.pi)")),
    row("sun-missing", LIGHT, "the sun's part is missing: only the sky's light is there",
        *shade(f"{SUM} => albedo * sky + 0 * cosine")),
    row("sky-twice", LIGHT, "the sky's light is added twice",
        *shade("albedo * sky => 2 * albedo * sky")),
    row("sky-missing", LIGHT, "the sky's light (albedo times sky) is missing on surfaces",
        *shade(f"{SUM} => {SUN}")),
    row("sky-by-pi", LIGHT,
        "the sky's part is divided by π: a sky of constant radiance gives albedo Lₛ",
        *shade("albedo * sky => albedo * sky / np.pi")),
    row("sky-times-pi", LIGHT, "the sky's part is π times too bright: it is albedo Lₛ",
        *shade("albedo * sky => albedo * sky * np.pi")),
    row("sky-half", LIGHT, "the sky's part is half as bright as it should be",
        *shade("albedo * sky => albedo * sky / 2")),
    row("sky-without-albedo", LIGHT, "the sky's light is added without the albedo: albedo Lₛ",
        *shade("albedo * sky => sky + 0 * albedo")),
    row("sky-constant", LIGHT,
        "surfaces get a constant for the sky's light (ambient = 0.1): it is albedo Lₛ, Lₛ being the scene's sky",
        *shade(*(f"albedo * sky => {k} * albedo" for k in (0.1, 0.2, 0.05, 0.3, 0.5)))),
    row("sky-without-colour", LIGHT, "the sky's radiance is left out of its part: albedo Lₛ, not albedo",
        *shade("albedo * sky => albedo")),
    row("sky-on-all", LIGHT,
        "the sky's radiance is added to every pixel, to surfaces too: only rays that meet nothing show it as it is",
        *(both(way, *more) for more in ((), (behind(partial(_sky_scaled, k=2.0)),))
          for way in shade("albedo * sky => albedo * sky + sky"))),
    row("sky-times-sun", LIGHT, "the sky's part is multiplied by the sun's irradiance: it is albedo Lₛ",
        sky_times(lambda x: x.irradiance), sky_times(lambda x: x.irradiance / pi),
        *shade(f"{SUM} => cosine * (albedo / np.pi * irradiance + albedo * sky)", f"{SUM} => (cosine > 0) * ({SUM})")),
    row("sky-before-clamp", LIGHT, "the clamp comes too late: max(0, n·l) alone, then the sky's light is added",
        *shade(f"{CLAMPED} => {COS} ;; {SUM} => np.maximum(0, {SUM})",
               f"{CLAMPED} => np.maximum(0, {COS} + sky) ;;  + albedo * sky => ")),
    row("sky-only-in-shadow", LIGHT, "the sky lights only what the sun does not: add it everywhere",
        sky_times(_in_shadow), sky_times(lambda x: 1 - x.visible), sky_times(lambda x: np.where(x.cos > 0, 0.0, 1.0)),
        where_cast(sky_times(lambda x: 1 - x.visible)),
        shaded(lambda x: np.maximum(sun(x), ambient(x))),
        *shade(f"{SUM} => np.where(cosine > 0, {SUN}, albedo * sky)")),
    row("shadow-black", LIGHT, "shadows are black: the sky's light reaches them too",
        sky_times(lambda x: x.visible), sky_times(lambda x: 1 - _in_shadow(x)),
        sky_times(lambda x: np.where(x.cos > 0, 1.0, 0.0)), where_cast(sky_times(lambda x: x.visible))),
    row("sky-by-height", LIGHT, "the sky's light is weighed by the normal: here it is albedo Lₛ whatever way it faces",
        sky_times(_up), sky_times(lambda x: np.maximum(x.hits.normal[2], 0)),
        sky_times(lambda x: np.maximum(x.cos, 0)), sky_times(lambda x: x.visible * np.maximum(x.cos, 0))),
)  # fmt: skip


# ------------------------------------------------------------------------------------------ shadow


def shadows(f: Callable[[Hits, Array, Casters, Steps], Array]) -> Change:
    """(hits, to the light, things, steps) -> (N,) bool: blocked. Without shadows (rung lambert) it has no effect."""
    return put(blocked=f)


def within(limit: float) -> Callable[[Hits, Array, Casters, Steps], Array]:
    """Only what is nearer than this, metres, casts a shadow."""

    def blocked(hits: Hits, to: Array, things: Casters, steps: Steps) -> Array:
        away = (hits.normal * to).sum(axis=0) <= 0
        return away | _any_blocks(hits.point + 1e-7 * hits.normal, to, things, steps, limit)

    return blocked


def _gone(thing: Shape) -> Shape:
    if isinstance(thing, Sphere):
        return msgspec.structs.replace(thing, center=(0.0, 0.0, -1e9), radius=1e-9)
    return msgspec.structs.replace(thing, center=(0.0, 0.0, -1e9), half_u=(1e-9, 0.0, 0.0), half_v=(0.0, 1e-9, 0.0))


def _all_dark(hits: Hits, to: Array, things: Casters, steps: Steps) -> Array:
    return np.ones(hits.t.shape, bool)


def shadowed_by(f: Callable[[Array, Scene, Hits], Array]) -> Change:
    """Another direction to the light, for shadows alone."""

    def rightly(x: Terms) -> Terms:
        return x._replace(cos=(x.hits.normal * np.array(x.scene.sun.to_light)[:, None]).sum(axis=0))

    return both(lit(f), terms(rightly), put(blocked=others_hide))


def _turned_light(to: Array, scene: Scene, hits: Hits, turn: Any) -> Array:
    return np.asarray(turn(np.asarray(scene.camera.R_cam_board)) @ to)


def _recast(x: Terms, lets: Any) -> Terms:
    """The share of the light that n objects on the way let through: lets(n)."""
    if not x.shadows or not x.scene.objects:
        return x
    to = np.broadcast_to(np.array(x.scene.sun.to_light)[:, None], x.hits.point.shape)
    met = np.isfinite(meet_all(x.hits.point, to, x.scene.objects, RIGHT))
    return x._replace(visible=lets((met & (x.hits.ids != np.arange(len(met))[:, None])).sum(axis=0)))


def _without(x: Terms, what: str) -> Array:
    """The factor of the sky's part by which the albedo or the sky is not in it where the sun is hidden."""
    return np.where(x.visible > 0, 1.0, 1 / np.maximum(getattr(x, what), 1e-9))


def _grey_where_dark(x: Terms, k: float) -> Array:
    return np.where(x.visible > 0, lambert(x), k)


def _dimmed(x: Terms, by: float) -> Array:
    return lambert(x._replace(visible=np.ones_like(x.visible))) * np.where(x.visible > 0, 1.0, by)


shadow = partial(slips, "sun_visible")
BLOCKS, TO_SUN = (
    "visible = visible & (own | ~np.isfinite(t[k]))",
    ("t = intersect_all(points, np.tile(to_light, (len(points), 1)), things)"),
)
ON_BALL = 'np.array(["radius" in x for x in things])[which]'
BALLS = 'np.array([["radius" in x] for x in things])'
NUMBERS = '[["radius" in y for y in things[:i]].count("radius" in x) for i, x in enumerate(things)]'
"""The number that each thing has among those of its kind."""


def _free(*tests: str) -> tuple[Change, ...]:
    """What lets the light through: functions of k, thing, which and things."""
    return shadow(*(f"(own | => (own | ({test}) |" for test in tests))


def _towards(*directions: str) -> tuple[Change, ...]:
    """Shadow rays that go elsewhere."""
    unit = "({d}) / np.linalg.norm({d}, axis=-1, keepdims=True)"
    return shadow(*(f"np.tile(to_light, (len(points), 1)) => {unit.format(d=f'({d})')}" for d in directions))


SHADOWS = (
    row("no-shadow", SHADOW, "there are no cast shadows: send a ray from each point to the sun",
        *shadow("return visible => return visible | True")),
    row("shadows-always", SHADOW,
        "shadows are cast with the rung \"lambert\", too: there nothing casts any, only with \"shadow\"",
        put(shadows=lambda asked: True)),
    row("all-in-shadow", SHADOW,
        "every surface is in its own shadow: the shadow ray goes away from the sun (it goes along to_light, not "
        "-to_light), or starts inside the object (move it a little along +n), or t <= 0 counts as a hit",
        *shadow(*(f"return visible => return visible & {on}" for on in ("False", f"~{ON_BALL}", ON_BALL)))),
    row("shadow-offset", SHADOW,
        "the shadow ray starts too far from the surface: shadows near what casts them are lost; 1e-4 of the scene is "
        "enough",
        *(shadows(offset_by(eps, way)) for way in (False, True) for eps in (3e-3, 1e-2, 2e-2, 5e-2))),
    row("shadow-both-ways", SHADOW,
        "what lies on the far side of the surface, away from the sun, casts shadows too: keep t > 0 alone",
        *shadow(*(f"{TO_SUN} => {TO_SUN}\n    back = {TO_SUN[4:].replace('to_light', '-to_light')}\n"
                  f"    t = np.minimum(t, np.where({kind}, back, np.inf))" for kind in ("True", BALLS, f"~{BALLS}")))),
    row("shadow-reversed", SHADOW, "shadow rays go away from the sun: they go along to_light",
        *shadow("np.tile(to_light => np.tile(-to_light")),
    row("shadow-light-turned", SHADOW,
        "shadows fall by another direction than the light: the shadow ray goes along the same to_light, in the same "
        "frame",
        *(shadowed_by(partial(_turned_light, turn=f)) for f in (lambda R: R, lambda R: R.T)),
        *shadow(*(f"np.tile(to_light => np.tile(to_light * {signs}" for signs in ([1, 1, -1], [-1, -1, 1])))),
    row("shadow-to-eye", SHADOW,
        "shadow rays go to the eye, away from it, or along the normal: they go to the sun, along to_light",
        *_towards("eye - points", "points - eye", "normals")),
    row("shadow-to-place", SHADOW,
        "shadow rays go to to_light as if it were a point: it is a direction, the same for every surface",
        *_towards("to_light - points", "to_light + eye - points")),
    row("shadow-bounded", SHADOW,
        "only near objects cast shadows: nothing bounds the way to the sun",
        *(shadows(within(limit)) for limit in (0.2, 0.1, 0.25, 0.3, 0.5, 1.0))),
    row("spheres-receive-none", SHADOW, "no shadow falls on spheres: test every surface, whatever its kind",
        *_free(ON_BALL)),
    row("planes-receive-none", SHADOW, "no shadow falls on planes: test every surface, whatever its kind",
        *_free(f"~{ON_BALL}")),
    row("shadow-own-kind", SHADOW,
        "a surface's own kind is left out of its shadow test: only its own object may be (spheres shadow spheres, "
        "planes planes)",
        *_free(f'("radius" in thing) & {ON_BALL}', f'("radius" not in thing) & ~{ON_BALL}',
               f'("radius" in thing) == {ON_BALL}')),
    row("own-number", SHADOW,
        "sphere i casts no shadow on plane i, nor plane i on sphere i: leave out the surface's own object, not all "
        "that have its number in their list",
        *shadow(f"own = which == k => own = np.array({NUMBERS})[which] == {NUMBERS}[k]")),
    row("other-size-in-shadow", SHADOW,
        "rectangles have another size in the shadow test than the eye sees: half_u and half_v are changed in place "
        "(u /= |u|) or used otherwise there; write u = half_u / |half_u|",
        *map(in_shadow_test, _inside("np.isfinite(t)", _reach(NU, NV), *(
            _reach(f"{k} * (half_u @ half_u)", f"{k} * (half_v @ half_v)") for k in (0.5, 2.0))))),
    row("planes-cast-none", SHADOW, "planes cast no shadows: test shadow rays against planes too",
        *_free('"radius" not in thing')),
    row("spheres-cast-none", SHADOW, "spheres cast no shadows: test shadow rays against spheres too",
        *_free('"radius" in thing')),
    row("one-casts", SHADOW,
        "only one object casts shadows: the answer of each test overwrites the one before; any hit hides the sun",
        *_free("k != 0", f"k != {BALLS}.sum() - 1", "k != len(things) - 1", *(
            f'("radius" in thing) == {ball} and {NUMBERS}[k] != {end}' for ball, ends in (
                (True, ("0", f"{BALLS}.sum() - 1")), (False, ("0", f"(~{BALLS}).sum() - 1"))) for end in ends)),
        *shadow(*(f"{BLOCKS} => visible = np.where(own, visible, ~np.isfinite(t[k])){more}" for more in (
            "", " ;; enumerate(things) => reversed([*enumerate(things)])")))),
    row("half-of-pairs", SHADOW,
        "objects are tested for shadows only against those that come later in the list, or earlier: test against all "
        "but the point's own",
        *_free("k < which", "k > which")),
    row("whole-object-in-shadow", SHADOW,
        "one point in shadow darkens its whole object: np.any over all points instead of over the objects (axis=0), "
        "each point has a shadow ray of its own",
        *shadow("return visible => return np.array([visible[which == w].all() for w in which])")),
    row("one-casts-not", SHADOW, "one of the spheres casts no shadow: test shadow rays against all of them",
        *_free("k == 0", f"k == {BALLS}.sum() - 1")),
    row("shadow-from-elsewhere", SHADOW,
        "shadow rays start in the wrong place: they start at the point that the eye's ray met",
        *shadow('intersect_all(points => intersect_all(np.array([x["center"] for x in things])[which]'),
        *shadow(*(f"intersect_all(points => intersect_all({start}{own}" for own in ("", " ;; (own |  => (")
                  for start in ("0 * points", "eye + 0 * points", "points - eye")))),
    row("shadow-counts", SHADOW,
        "what several objects hide is darker than what one hides: each hit takes light away once more, one is enough",
        *(terms(partial(_recast, lets=lets)) for lets in (lambda n: 1.0 - n, lambda n: 0.5**n))),
    row("shadow-inverted", SHADOW, "light and shadow are swapped: V is 1 where the way to the sun is free",
        *shadow("return visible => return ~visible")),
    row("shadow-colour", SHADOW,
        "shadowed points have a colour of their own: there as elsewhere the sky gives albedo Lₛ, the sun alone is gone",
        *(way(sky_times(partial(_without, what=what))) for way in (both, where_cast) for what in ("albedo", "sky")),
        *(way(shaded(partial(_grey_where_dark, k=k))) for way in (both, where_cast) for k in (0.05, 0.1, 0.2))),
    row("shadow-by-pi", SHADOW,
        "the sky's part is divided by π in shadow: there as elsewhere it is albedo Lₛ; albedo /= π inside shade "
        "changes the array that it was given, so that the next call divides once more",
        *(way(sky_times(lambda x: np.where(x.visible > 0, 1.0, 1 / np.pi))) for way in (both, where_cast))),
    row("shadow-on-sky", SHADOW,
        "shadows take away the sky's light and leave the sun's: it is the other way round",
        shaded(lambda x: lambert(x._replace(visible=np.ones_like(x.visible), sky=x.sky * x.visible))),
        where_cast(shaded(
            lambda x: lambert(x._replace(visible=np.ones_like(x.visible), sky=x.sky * x.visible))))),
    row("shadow-dims-all", SHADOW, "shadows scale the whole light: they take away the sun's part alone",
        *(way(shaded(partial(_dimmed, by=k))) for way in (both, where_cast) for k in (0.5, 0.3, 0.2))),
)  # fmt: skip


# ------------------------------------------------------------------------------------------ output


def shown(f: Callable[[Array], Array]) -> Change:
    """Other values, each by itself."""
    return lambda s: s._replace(output=lambda x, brightest: f(s.output(x, brightest)))


def _normalised(s: Steps) -> Steps:
    return s._replace(output=lambda x, brightest: s.output(x, brightest) / brightest)


def _overflow(x: Array, by: int = 255) -> Array:
    return np.floor(np.maximum(x, 0) * by + 1e-9) % 256 / by


def _gradient(scene: Scene, d: Array, axis: int, camera: bool, blue: bool) -> Array:
    """From white to the sky's radiance, or to a blue, by the unit direction's height: (1 - a) white + a sky."""
    d = _made_unit(d)
    height = -(np.asarray(scene.camera.R_cam_board) @ d)[axis] if camera else d[axis]
    a = (height + 1) / 2
    return (1 - a) + a * (np.array([0.5, 0.7, 1.0]) if blue else np.array(scene.sky.radiance))[:, None]


def _rounded(x: Array, digits: int) -> Array:
    return np.round(x, digits)


def _channel(x: Array, k: int) -> Array:
    return np.broadcast_to(x[..., k : k + 1], x.shape)


def _power(x: Array, k: float) -> Array:
    return np.maximum(x, 0) ** k


OUTPUTS = (
    row("gamma-once", OUTPUT,
        "the values are encoded for display (gamma): hand in linear radiance, without a power of 1/2.2",
        shown(srgb_encode), shown(partial(_power, k=1 / 2.2)), shown(partial(_power, k=1 / 2)),
        shown(lambda x: srgb_encode(np.clip(x, 0, 1))), shown(lambda x: _power(np.clip(x, 0, 1), 1 / 2.2)),
        *shade(f"{SUM} => ({SUM}) ** (1 / 2.2)")),
    row("gamma-twice", OUTPUT, "the values are encoded for display twice",
        shown(lambda x: srgb_encode(srgb_encode(x))), shown(partial(_power, k=1 / 2.2**2))),
    row("gamma-missing", OUTPUT,
        "the values are decoded once too often: linear numbers were written where a display's (sRGB) were expected",
        shown(lambda x: srgb_decode(np.maximum(x, 0))), shown(partial(_power, k=2.2)), shown(partial(_power, k=2))),
    row("bgr", OUTPUT, "red and blue are swapped: OpenCV writes BGR, the order here is RGB",
        shown(lambda x: x[..., ::-1]), *shade(f"{SUM} => ({SUM})[:, ::-1]")),
    row("channels-turned", OUTPUT, "the channels are in the wrong order: red, green, blue",
        shown(lambda x: x[..., [1, 2, 0]]), shown(lambda x: x[..., [2, 0, 1]]), shown(lambda x: x[..., [1, 0, 2]]),
        shown(lambda x: x[..., [0, 2, 1]])),
    row("grey", OUTPUT, "the image has no colours: all channels are equal",
        shown(lambda x: np.broadcast_to(x.mean(axis=-1, keepdims=True), x.shape)),
        shown(lambda x: np.broadcast_to(x @ np.array([0.2126, 0.7152, 0.0722])[:, None], x.shape)),
        shown(lambda x: np.broadcast_to(x @ np.array([0.299, 0.587, 0.114])[:, None], x.shape)),
        *(shown(partial(_channel, k=k)) for k in range(3))),
    row("clamped", OUTPUT, "values are cut off at 1: radiance may be larger, leave it as it is",
        shown(lambda x: np.minimum(x, 1)),
        *shade(f"{SUM} => np.clip({SUM}, 0, 1)")),
    row("overflow", OUTPUT, "8-bit values overflow: what is brighter than white wraps round to black; clip first",
        shown(_overflow), shown(lambda x: np.rint(np.maximum(x, 0) * 255) % 256 / 255),
        shown(partial(_overflow, by=256)), shown(lambda x: srgb_decode(_overflow(srgb_encode(x)))),
        shown(lambda x: _overflow(srgb_encode(x))), shown(lambda x: _overflow(_power(x, 1 / 2.2)))),
    row("eight-bits", OUTPUT, "the values are rounded to 8 bits: hand in floats",
        shown(lambda x: np.floor(np.clip(x, 0, 1) * 255) / 255), shown(lambda x: np.rint(np.clip(x, 0, 1) * 255) / 255),
        shown(lambda x: srgb_decode(np.floor(srgb_encode(np.clip(x, 0, 1)) * 255) / 255)),
        shown(lambda x: srgb_decode(np.rint(srgb_encode(np.clip(x, 0, 1)) * 255) / 255))),
    row("rounded", OUTPUT, "the values are rounded, to whole numbers or a few digits: hand in floats as they are",
        shown(np.floor), shown(np.rint), *(shown(partial(_rounded, digits=k)) for k in (1, 2, 3))),
    row("times-255", OUTPUT, "the values are 255 times too large: radiance is not a byte",
        shown(lambda x: 255 * x), shown(lambda x: np.floor(np.clip(x, 0, 1) * 255)),
        shown(lambda x: np.rint(np.clip(x, 0, 1) * 255))),
    row("by-255", OUTPUT, "the values are divided by 255, though they are no bytes", shown(lambda x: x / 255)),
    row("half-float", OUTPUT, "the values are rounded to half floats (float16): use float32",
        shown(lambda x: np.clip(x, -65504, 65504).astype(np.float16).astype(float))),
    row("upside-down", OUTPUT, "the image is upside down: row 0 is the top one",
        at(lambda u, v, c: (u, c.height - 1 - v)),
        alone=slips("pixels", "return u, v => return u, height - 1 - v")),
    row("mirrored", OUTPUT, "the image is mirrored left to right",
        at(lambda u, v, c: (c.width - 1 - u, v)),
        alone=slips("pixels", "return u, v => return width - 1 - u, v")),
    row("half-turn", OUTPUT, "the image is turned by half a turn",
        at(lambda u, v, c: (c.width - 1 - u, c.height - 1 - v))),
    row("normalised", OUTPUT, "the image is divided by its brightest value: radiance has a scale of its own",
        _normalised),
    row("tone-mapped", OUTPUT, "the values are tone-mapped, x / (1 + x): hand in linear radiance",
        shown(lambda x: x / (1 + np.maximum(x, 0))), shown(lambda x: 1 - np.exp(-np.maximum(x, 0)))),
    row("negative", OUTPUT, "the image is a negative: 1 - value", shown(lambda x: 1 - x)),
    row("background-black", OUTPUT,
        "the background is black: a ray that meets nothing shows the sky's radiance",
        behind(lambda scene: 0.0)),
    row("background-white", OUTPUT, "the background is white: a ray that meets nothing shows the sky's radiance",
        behind(lambda scene: 1.0)),
    row("background-gradient", OUTPUT,
        "the background is a gradient by the rays' directions: a ray that meets nothing shows the sky's radiance, the "
        "same everywhere",
        *(put(background=partial(_gradient, axis=axis, camera=camera, blue=blue))
          for blue in (False, True) for axis, camera in ((1, False), (2, False), (1, True)))),
    row("background-scaled", OUTPUT,
        "the background is not the sky's radiance as it is: a factor of π or 2 has slipped in",
        *(behind(partial(_sky_scaled, k=k)) for k in (pi, 1 / pi, 2.0, 0.5))),
    row("background-sun", OUTPUT, "the background shows the sun's colour: it shows the sky's radiance",
        behind(lambda scene: scene.sun.irradiance),
        behind(lambda scene: np.add(scene.sky.radiance, scene.sun.irradiance)),
        behind(lambda scene: np.array(scene.sun.irradiance) / pi)),
    row("premultiplied", OUTPUT, "colours are multiplied by their own coverage or value once more (premultiplied)",
        shown(lambda x: x * x)),
    row("half-bright", OUTPUT, "the whole image, background too, is half as bright", shown(lambda x: x / 2)),
    row("twice-bright", OUTPUT, "the whole image, background too, is twice as bright", shown(lambda x: 2 * x)),
    row("image-by-pi", OUTPUT, "the whole image, background too, is divided by π", shown(lambda x: x / pi),
        *shade(f"{SUM} => ({SUM}) / np.pi")),
    row("image-times-pi", OUTPUT, "the whole image, background too, is multiplied by π", shown(lambda x: x * pi)),
    row("empty", OUTPUT, "the image is black everywhere", shown(lambda x: 0 * x)),
)  # fmt: skip

# ------------------------------------------------------------------------------------------ sampling


def walked(f: Callable[[Walks], Array]) -> Change:
    """Another sum over random walks; shows only where light is followed."""
    return put(gather=f)


def per_bounce(g: Callable[[Array], Any]) -> Change:
    """Each change of direction weighs g(cos) too much, g = 1 where directions have density cos/π and weigh albedo."""

    def f(walks: Walks) -> Array:
        gain = np.broadcast_to(np.asarray(g(walks.cos), float), walks.cos.shape)
        along = np.concatenate([np.ones_like(gain[:1]), np.cumprod(gain, axis=0)[:-1]])[:, None]
        light = walks.weight * (along * walks.sun + along * gain[:, None] * walks.sky)
        return np.asarray(light.sum(axis=0).mean(axis=-1).T)

    return walked(f)


def without(kept: Callable[[int], float]) -> Change:
    """The sun at the k-th surface, and the sky seen from it, count kept(k) times."""

    def f(walks: Walks) -> Array:
        share = np.array([kept(k) for k in range(len(walks.cos))])[:, None, None, None]
        return gathered(walks._replace(sun=share * walks.sun, sky=share * walks.sky))

    return walked(f)


def _each_sample(f: Callable[[Array], Array], back: Callable[[Array], Array] = lambda x: x) -> Change:
    """The mean of a function of every walk's light."""

    def gather(walks: Walks) -> Array:
        light = (walks.weight * (walks.sun + walks.sky)).sum(axis=0)
        return np.asarray(back(f(light).mean(axis=-1).T))

    return walked(gather)


def _sky_and_ambient(walks: Walks) -> Array:
    """The open sky is added to what the walks find of it."""
    sky = walks.sky.max(axis=(0, 2, 3))[:, None, None]
    return gathered(walks) + np.asarray((walks.weight[0] * sky).mean(axis=-1).T)


SAMPLINGS = (
    row("no-interreflection", SAMPLING, "light that comes by way of another surface is missing: follow the walk on",
        without(lambda k: float(k < 1))),
    row("bounce-missing", SAMPLING,
        "one bounce is missing: every surface on the way adds its own sunlight, the second one too",
        without(lambda k: float(k != 1)), without(lambda k: float(k != 2))),
    row("depth-off-by-one", SAMPLING,
        "walks end too early: depth counts surfaces, light to surface to eye is 2; compare your loop's limit",
        without(lambda k: float(k < 2)), without(lambda k: float(k < 3)), without(lambda k: float(k < 4))),
    row("pdf-too-large", SAMPLING,
        "each bounce is half as bright: directions that are uniform over the hemisphere have density 1/(2π), not 1/π",
        per_bounce(lambda cos: 0.5)),
    row("pdf-too-small", SAMPLING, "each bounce is twice as bright: a density is half of what it should be",
        per_bounce(lambda cos: 2.0)),
    row("bounce-by-pi", SAMPLING, "each bounce is divided by π: albedo/π times cosine, by cosine/π, is albedo",
        per_bounce(lambda cos: 1 / pi)),
    row("bounce-times-pi", SAMPLING, "each bounce is multiplied by π: albedo/π times cosine, by cosine/π, is albedo",
        per_bounce(lambda cos: pi)),
    row("cosine-twice", SAMPLING,
        "the cosine counts twice: directions of density cosine/π hold it already, so a bounce weighs the albedo alone",
        per_bounce(lambda cos: cos), per_bounce(lambda cos: 2 * cos), per_bounce(lambda cos: pi * cos)),
    row("cosine-missing", SAMPLING,
        "the cosine is missing at bounces: uniform directions weigh 2 albedo cosine",
        per_bounce(lambda cos: 1 / np.maximum(cos, 0.02)), per_bounce(lambda cos: 0.5 / np.maximum(cos, 0.02))),
    row("light-twice", SAMPLING, "the sun is counted twice where light is followed: once by its own ray is enough",
        walked(lambda w: gathered(w._replace(sun=2 * w.sun))), without(lambda k: 2.0 if k else 1.0)),
    row("sky-and-ambient", SAMPLING, "the sky is counted twice: walks that leave the scene find it, so add no ambient",
        walked(_sky_and_ambient)),
    row("sky-not-found", SAMPLING, "walks that leave the scene bring no light: there they meet the sky's radiance",
        walked(lambda w: gathered(w._replace(sky=0 * w.sky)))),
    row("gamma-in-mean", SAMPLING,
        "the samples are encoded for display before their mean is taken: average radiance, encode last if at all",
        _each_sample(lambda x: x ** (1 / 2.2)), _each_sample(lambda x: x ** (1 / 2.2), lambda x: x**2.2)),
    row("clamp-in-mean", SAMPLING, "each sample is cut off at 1 before the mean is taken: radiance may be larger",
        _each_sample(lambda x: np.minimum(x, 1))),
)  # fmt: skip

ACNE = row("acne", SHADOW,
    "speckles: rounding puts the start of shadow rays now above, now below the surface, so that it shades itself; "
    "start them a little off it, or leave its own object out", lambda s: s, shadows(_all_dark))  # fmt: skip
"""Which points are dark is chance: told by pixels that are all as lit or as dark as can be, and mixed."""

CHANCES = (
    *(row("plane-normal-by-origin", NORMALS, PLANES_BY_ORIGIN,
          *(normals(partial(_turned_by_origin, sign=k, flat=flat)) for flat in (1, -1))) for k in (1, -1)),
    ACNE,
)  # fmt: skip
"""Faults of which rounding decides, pixel by pixel, what is seen: one of their ways."""

CACHED = (
    "a picture is drawn with the rays of another scene of the same size: what is kept between calls has to be found "
    "by all that it depends on, K and dist too, not by width and height alone"
)


def _kept(own: Camera, kept: dict[Any, Camera]) -> Camera:
    return kept.get(own.image_size, own)


def cached(first: Sequence[Camera], cameras: Sequence[Camera]) -> tuple[Fault, ...]:
    """Rays that are kept by the picture's size: with what one of the first gives all cameras of its size are used."""
    by_size: dict[tuple[int, int], list[Camera]] = {}
    for one in dict.fromkeys(first):
        if any(other.image_size == one.image_size and other != one for other in cameras):
            by_size.setdefault(one.image_size, []).append(one)

    def turned(own: Camera, kept: dict[Any, Camera]) -> Camera:
        """With the kept one's axes, from its own eye."""
        R = _kept(own, kept).R_cam_board
        return msgspec.structs.replace(own, R_cam_board=R, t_cam_board=_three(-np.asarray(R) @ np.array(own.eye)))

    ways: list[Change] = []
    for one_each in islice(product(*by_size.values()), 8 if by_size else 0):
        kept = {one.image_size: one for one in one_each}
        inner = seen(partial(_kept, kept=kept))
        eyes = (partial(turned, kept=kept), partial(_kept, kept=kept))
        ways += [inner, *(both(inner, placed(eye)) for eye in eyes)]
    return (row("rays-kept", CAMERA, CACHED, *ways),) if ways else ()


FACTS = frozenset({"nothing-met", "empty"})
"""Faults that say what is seen, whatever has brought it about: of others that would, too, nothing is said."""

FAULTS: tuple[Fault, ...] = (
    *CAMERAS, *SOLVERS, *ORDERS, *NORMALS_, *LIGHTS, *SHADOWS, *SAMPLINGS, *OUTPUTS,
)  # fmt: skip
"""Every mistake there is, by stage."""


def faced(s: Steps) -> Steps:
    """Normals of spheres, too, are turned to the eye."""
    return normals(lambda n, p, rays, thing: _turned_to_eye(n, rays))(s)


def tested(f: Any) -> Change:
    """Another shadow test, where that is not the mistake itself."""
    return lambda s: s._replace(blocked=f) if s.blocked is hidden else s


COARSE = (others_hide, offset_by(1e-4), offset_by(1e-4, True))
TESTS = (*COARSE, *(offset_by(eps, way) for eps in (1e-6, 1e-5, 1e-3) for way in (False, True)))
"""Ways to test for shadows that are all right: the own object left out, or a start a little off the surface."""
HABITS: tuple[Change, ...] = tuple(
    both(*normal, *test)
    for test in ((), *((tested(one),) for one in COARSE))
    for normal in ((), (faced,), (normals(_made_unit),), (normals(_made_unit), faced))
)[1:]
"""What may be done in one way or another without harm, but shows where something else is wrong: normals turned to the
eye, or made unit; how shadows are tested."""
