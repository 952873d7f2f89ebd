"""Mistakes from the pixel to the ray: pixels, lens, camera matrix, pose."""

from collections.abc import Callable
from functools import partial
from math import pi
from typing import Any

import numpy as np

from raytwin.diagnose.changes import (
    CAMERA,
    UNIT,
    Thing,
    by_key,
    is_ball,
    lens,
    other,
    pixels,
    posed,
    row,
)
from raytwin.diagnose.predict import RIGHT, Array, Pipeline, SceneDict, replaced, slips, written
from raytwin.tracer import undistort


def bent(f: Callable[[SceneDict, Array, Array], tuple[Array, Array]]) -> Pipeline:
    """(scene, u, v) -> the x and y of rays (x, y, 1) that are made unit."""

    def rays(scene: SceneDict, u: Array, v: Array) -> Array:
        x, y = f(scene, u, v)
        d = np.stack([x, y, np.ones_like(x)], axis=-1)
        return d / np.linalg.norm(d, axis=-1, keepdims=True)

    return replaced(rays=lambda right: rays)


def _undone(scene: SceneDict, u: Array, v: Array, fx: Any, fy: Any, cx: Any, cy: Any) -> tuple[Array, Array]:
    """The distortion is undone in (u - cx) / fx, (v - cy) / fy; then u and v again."""
    x, y = undistort((u - cx) / fx, (v - cy) / fy, scene["dist"].tolist())
    return x * fx + cx, y * fy + cy


def _newton(right: Any, steps: int) -> Any:
    return lambda xd, yd, dist: undistort(xd, yd, dist.tolist(), steps=steps)


def _by_K(K: Array, u: Array, v: Array) -> tuple[Array, Array]:
    return (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]


def _in_other_units(scene: SceneDict, u: Array, v: Array, by: Any, middle: bool) -> tuple[Array, Array]:
    """By (sx, sy) = by(width, height) about the image's middle, or about (cx, cy)."""
    size, K = (scene["width"], scene["height"]), scene["K"]
    centre = np.array(size) / 2 if middle else K[:2, 2]
    return _by_K(K, *_undone(scene, u, v, *by(*size), *centre))


def _by_new_matrix(scene: SceneDict, u: Array, v: Array, whole: bool) -> tuple[Array, Array]:
    """Undistorted into the pixels of a new matrix that shows the `whole` image, or as much as has no empty edge; then
    made rays with the old one."""
    K, (w, h) = scene["K"], (scene["width"] - 1, scene["height"] - 1)
    edge = np.meshgrid(np.linspace(0, w, 9), np.linspace(0, h, 9))
    x, y = _by_K(K, *_undone(scene, *edge, K[0, 0], K[1, 1], *K[:2, 2]))
    if whole:
        left, right, top, bottom = x.min(), x.max(), y.min(), y.max()
    else:
        left, right, top, bottom = x[:, 0].max(), x[:, -1].min(), y[0].max(), y[-1].min()
    x, y = _by_K(K, *_undone(scene, u, v, K[0, 0], K[1, 1], *K[:2, 2]))
    if not scene["dist"].any():
        return x, y
    return _by_K(K, w / (right - left) * (x - left), h / (bottom - top) * (y - top))


def angles(f: Callable[[float, float, SceneDict], tuple[float, float]]) -> Pipeline:
    """Other focal lengths by the fields of view, radians, of both axes."""

    def focal(scene: SceneDict, k: int) -> float:
        h, v = (2 * float(np.arctan(scene[size] / 2 / scene["K"][i, i])) for i, size in enumerate(("width", "height")))
        return f(h, v, scene)[k]

    return lens(fx=partial(focal, k=0), fy=partial(focal, k=1))


def _left_behind(x: Thing, scene: SceneDict, balls: bool, turned: bool) -> Thing:
    """Take coordinates of this kind in the board's frame, `turned` or not, as the camera's."""
    R, t = scene["R_cam_board"], scene["t_cam_board"]
    back = np.eye(3) if turned else R.T
    if is_ball(x) != balls:
        return x
    edges = {name: back @ x[name] for name in ("half_u", "half_v") if name in x}
    return x | {"center": back @ x["center"] - R.T @ t} | edges


def _by_norm_of_many(right: Any, axis: tuple[int, ...], board: bool) -> Any:
    """(H, W, 3) rays, before or after they are turned, divided by their norm over rows, columns or both."""

    def rays(scene: SceneDict, u: Array, v: Array) -> Array:
        d, R, (w, h) = right(scene, u, v), scene["R_cam_board"], (scene["width"], scene["height"])
        if w * h > MOST_RAYS:
            return d
        all_ = written(RIGHT)["through"](scene["K"], scene["dist"], *np.meshgrid(np.arange(w), np.arange(h)))
        norm = np.sqrt(np.square(all_ @ R if board else all_).sum(axis=axis, keepdims=True))
        columns, rows = (np.clip(np.rint(x), 0, n - 1).astype(int) for x, n in ((u, w), (v, h)))
        by = np.broadcast_to(norm, all_.shape)[rows, columns]
        return (d @ R / by) @ R.T if board else d / by

    return rays


MOST_RAYS = 50_000
"""Pixels; no norm of a larger picture over all rays is predicted."""


lens_of = partial(slips, "undistort")
UNDO = "undistort((u - cx) / fx, (v - cy) / fy, dist)"
ONE, RAY = "np.ones_like(x)", "np.stack([x, y, np.ones_like(x)], axis=-1)"
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


def _dist(*lines: str) -> tuple[Pipeline, ...]:
    """The coefficients, changed after they are read."""
    return lens_of(*(f"{DIST} => {DIST}\n    {line}" for line in lines))


def _K(*lines: str) -> tuple[Pipeline, ...]:
    return slips("through", *(f"{OF_K} => {OF_K}\n    {line}" for line in lines))


def _ray(*axes: str) -> tuple[Pipeline, ...]:
    """Other axes of the rays, functions of x, y and one."""
    return slips("through", *(f"{RAY} => np.stack([{xyz.replace('one', ONE)}], axis=-1)" for xyz in axes))


def _other(term: str) -> str:
    """The term with the other coefficient."""
    return f"{term} => {term.replace('p1', 'p').replace('p2', 'p1').replace('p ', 'p2 ')}"


CAMERAS = (
    row("rays-long", CAMERA, "the rays are not unit: divide (x, y, 1) by its length",
        alone=slips("through", f"{UNIT} => rays")),
    row("nothing-met", CAMERA,
        "no ray meets anything, the picture is the sky alone: look where rays start, which way they go, over which "
        "axis they are made unit, and whether the test throws every hit away",
        *by_key("np.inf + every_t")),
    row("half-pixel", CAMERA,
        "your rays go half a pixel beside the pixels' centres: here (0, 0) is the centre of the top-left pixel, so "
        "use u and v as they are, without 0.5",
        *pixels("u + 0.5, v + 0.5", "u - 0.5, v - 0.5", "u + 0.5, v", "u, v + 0.5")),
    row("count-from-one", CAMERA,
        "your pixels are a whole one off: the first is u = 0, v = 0",
        *pixels("u + 1, v + 1", "u - 1, v - 1", "u + 1, v", "u, v + 1")),
    row("linspace", CAMERA,
        "your pixels reach to the far edge (linspace(0, width, width)): the last is width - 1, a step of 1",
        *pixels("u * width / (width - 1), v * height / (height - 1)",
              "u * width / (width - 1) - 0.5, v * height / (height - 1) - 0.5",
              "u * (width - 1) / width, v * (height - 1) / height")),
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
        *(replaced(undistort=partial(_newton, steps=n)) for n in (1, 2))),
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
        *(bent(partial(_in_other_units, by=by, middle=middle))
          for by in (lambda w, h: (w / 2, h / 2), lambda w, h: (w, h), lambda w, h: (max(w, h),) * 2)
          for middle in (True, False))),
    row("new-camera-matrix", CAMERA,
        "points are undistorted into the pixels of a new camera matrix (getOptimalNewCameraMatrix), but rays are made "
        "with the old K: use one of them for both",
        *(bent(partial(_by_new_matrix, whole=whole)) for whole in (True, False))),
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
        *pixels("v, u")),
    row("reshaped", CAMERA,
        "width and height are swapped where the image is put together (reshape, or meshgrid with indexing='ij'): it "
        "has height rows of width pixels, so reshape(height, width, 3) and transpose nothing",
        *pixels("(v * width + u) // height, (v * width + u) % height",
              "(u * height + v) % width, (u * height + v) // width")),
    row("swapped-focal", CAMERA, "fx and fy are swapped: x = (u - cx) / fx, y = (v - cy) / fy", *_K("fx, fy = fy, fx")),
    row("one-focal", CAMERA, "one focal length is used for both axes: x goes with fx, y with fy",
        *_K("fy = fx", "fx = fy", "fx = fy = (fx + fy) / 2")),
    row("swapped-centre", CAMERA, "cx and cy are mixed up: x = (u - cx) / fx, y = (v - cy) / fy",
        *_K("cx, cy = cy, cx", "cx = cy", "cy = cx")),
    row("whole-numbers", CAMERA, "K is rounded to whole numbers: use fx, fy, cx and cy as they are",
        *(way for f in ("np.floor", "np.rint") for way in _K(
            f"cx, cy = {f}(cx), {f}(cy)", f"fx, fy = {f}(fx), {f}(fy)", f"fx, fy, cx, cy = {f}([fx, fy, cx, cy])"))),
    row("centre-of-image", CAMERA,
        "the image's middle is taken for the principal point: use cx and cy from K",
        *(lens(cx=lambda c, k=k: (c["width"] - k) / 2, cy=lambda c, k=k: (c["height"] - k) / 2) for k in (0, 1)),
        lens(cx=lambda c: c["height"] / 2, cy=lambda c: c["width"] / 2),
        lens(cx=lambda c: c["width"] / 2), lens(cy=lambda c: c["height"] / 2),
        alone=_K("cx, cy = np.max(u) / 2, np.max(v) / 2", "cx, cy = (np.max(u) + 1) / 2, (np.max(v) + 1) / 2")),
    row("centre-from-far-edge", CAMERA,
        "the principal point is counted from the wrong edge: cx from the left and cy from the top, like u and v",
        *(lens(cy=lambda c, k=k: c["height"] - k - c["K"][1, 2]) for k in (1, 0)),
        *(lens(cx=lambda c, k=k: c["width"] - k - c["K"][0, 2]) for k in (1, 0))),
    row("field-of-view", CAMERA,
        "a focal length is made of a field of view by a wrong formula: half the width is f tan(half the horizontal "
        "angle), so heights and widths go with the tangents, not with the angles; or use fx and fy of K as they are",
        angles(lambda h, v, c: (c["width"] / 2 * pi / h / 2, c["height"] / 2 * pi / v / 2)),
        angles(lambda h, v, c: (c["K"][0, 0], c["height"] / 2 / np.tan(h * c["height"] / c["width"] / 2))),
        angles(lambda h, v, c: (c["width"] / 2 / np.tan(v * c["width"] / c["height"] / 2), c["K"][1, 1])),
        angles(lambda h, v, c: (c["width"] / 2 / np.tan(h), c["height"] / 2 / np.tan(v)))),
    row("centre-left-out", CAMERA, "the principal point (cx, cy) is not subtracted: x = (u - cx) / fx",
        *_K("cx = cy = 0", "cx = 0", "cy = 0", "cx, cy = -cx, -cy")),
    row("x-for-y", CAMERA, "x and y of the rays are swapped: x belongs to the column u, y to the row v",
        *_ray("y, x, one")),
    row("y-up", CAMERA,
        "the camera's y axis points down here (OpenCV): yours points up, so that the image is seen upside down",
        *_ray("x, -y, one")),
    row("x-left", CAMERA, "the camera's x axis points right here (OpenCV): yours points left", *_ray("-x, y, one")),
    row("z-backwards", CAMERA,
        "the camera looks along +z here (OpenCV), not along -z (OpenGL)",
        *_ray("x, y, -one", "x, -y, -one", "-x, y, -one", "-x, -y, -one", "-x, -y, one")),
    row("transposed-R", CAMERA,
        "R is transposed: p_cam = R p_board + t, so directions go to the board's frame by d_board = Rᵀ d_cam",
        *posed(("-R.T @ t", "rays @ R.T"), ("-R @ t", "rays @ R.T"))),
    row("inverse-pose", CAMERA,
        "the pose is used the wrong way round: (R, t) takes board to camera, not camera to board",
        *posed(("t", "rays @ R.T"))),
    row("wrong-eye", CAMERA,
        "the eye is in the wrong place: the camera's centre in the board's frame is -Rᵀ t",
        *posed(*((eye, "rays @ R") for eye in ("t", "-t", "R.T @ t", "-R @ t", "R @ t")),
               ("R.T @ t", "rays @ R.T"), ("-t", "rays @ R.T"))),
    row("kind-not-moved", CAMERA,
        "only spheres, or only planes, are moved to the camera's frame: p_cam = R p_board + t holds for every centre, "
        "and edges are turned by R",
        *(other(partial(_left_behind, balls=balls, turned=turned))
          for balls in (True, False) for turned in (False, True))),
    row("direction-as-point", CAMERA,
        "the rays' directions are moved as if they were points (a homogeneous 1): only turn them, d_board = Rᵀ d_cam",
        *slips("to_board", *(
            f"directions = rays @ R => d = {rays} @ {moved}\n"
            "    directions = d / np.linalg.norm(d, axis=-1, keepdims=True)"
            for moved in ("R + eye", "R.T + t") for rays in ("rays", "(rays / rays[:, 2:])")))),
    row("eye-at-origin", CAMERA,
        "rays start at the board's origin: the camera's centre there is -Rᵀ t",
        *posed(("0 * t", "rays @ R"), ("0 * t", "rays @ R.T"))),
    row("rotation-left-out", CAMERA,
        "the camera's rotation is left out: turn the rays by Rᵀ",
        *posed(("-R.T @ t", "rays"), ("-t", "rays"), ("t", "rays"))),
    row("distance-by-camera-ray", CAMERA,
        "t is found with the rays of the camera's frame and applied to the turned ones: turn the rays by Rᵀ first, and "
        "use the same vector for both",
        *slips("met", "intersect_all(origins, directions => intersect_all(origins, rays")),
    row("rays-by-norm-of-many", CAMERA,
        "the rays are divided by a norm over pixels, not over x, y and z: np.linalg.norm(d, axis=-1, keepdims=True)",
        *(replaced(rays=partial(_by_norm_of_many, axis=axis, board=board))
          for axis in ((0, 1), (0,), (1,)) for board in (False, True)),
        alone=slips("through", *(f"{UNIT} => rays / np.linalg.norm(rays{axis})" for axis in (
            "", *(f", axis={k}, keepdims=True" for k in (0, 1, (0, 1))))))),
    row("rays-in-halves", CAMERA,
        "the rays' directions are rounded to half floats (float16), which leaves three digits: use float64",
        *slips("to_board", *(
            f"rays @ R => {d}.astype(np.float16).astype(float){turn}"
            for d, turn in (("(rays @ R)", ""), ("rays", " @ R"))))),
)  # fmt: skip
