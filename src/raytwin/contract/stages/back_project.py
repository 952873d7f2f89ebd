"""Pixels to rays: u = fx x' + cx, v = fy y' + cy, where (x', y') is (x, y) as the lens distorts it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from raytwin.contract.stage import Arrays, Case, Function, Stage, Variant, after
from raytwin.scene.lens import distort, undone
from raytwin.tracer import undistort


def back_project(K: Any, dist: Any, width: int, height: int) -> Any:
    """Unit rays (H, W, 3) in the camera frame through the pixels' centres.

    The camera frame is OpenCV's: x right, y down, z forward. Pixel (0, 0) is the centre of the top-left pixel, so row v
    and column u of the result belong to the pixel (u, v).

    K: (3, 3), [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
    dist: (5,), the distortion k1, k2, p1, p2, k3 in OpenCV's order, to be undone.
    width, height: whole numbers, in pixels.
    """
    return _through(K, dist, width, height, undistort)


def _through(K: Any, dist: Any, width: int, height: int, undo: Callable[..., Any]) -> np.ndarray:
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    x, y = undo((u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.asarray(dist, float).tolist())
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


LENSES = {
    "a pinhole": (0, 0, 0, 0, 0),
    "the radial distortion k1 and k2": (-0.22, 0.09, 0, 0, 0),
    "the tangential distortion p1 and p2": (0, 0, 0.012, -0.007, 0),
    "the radial distortion k3": (0.06, -0.04, 0, 0, 0.08),
    "all five coefficients": (-0.18, 0.07, -0.006, 0.011, 0.04),
}
"""What it shows -> coefficients, which the seed varies by a quarter."""


def cases(seed: int) -> list[Case]:
    """Each kind of lens before frames of some 20 x 15 pixels that see about 35 degrees to each side."""
    rng = np.random.default_rng(seed)
    return [_case(shows, dist, rng) for shows, dist in LENSES.items()]


def _case(shows: str, dist: Any, rng: np.random.Generator) -> Case:
    while True:
        width, height = int(rng.integers(18, 25)), int(rng.integers(11, 17))
        fx = width * rng.uniform(0.65, 0.8)
        K = np.array([[fx, 0, width * rng.uniform(0.4, 0.46)], [0, fx * rng.uniform(1.03, 1.08), 0], [0, 0, 1]])
        K[1, 2] = height * rng.uniform(0.53, 0.6)
        varied = np.array(dist, float) * rng.uniform(0.75, 1.25, 5)
        if not undone(K, varied.tolist(), (width, height)).fault:
            args = (K, varied, width, height)
            return Case(shows, args, (back_project(*args),))


def errors(expected: Arrays, got: Arrays) -> np.ndarray:
    """The distance of each ray's tip from where it should be: radians, where the rays are unit."""
    return np.asarray(np.linalg.norm(expected[0] - got[0], axis=-1))


def hint(expected: Arrays, got: Arrays) -> str:
    if len(got) != 1:
        return ""
    h, w, _ = expected[0].shape
    return {
        (w, h, 3): "rows and columns are swapped: the result is indexed [v, u]",
        (3, h, w): "x, y, z belong on the last axis: np.stack(..., axis=-1)",
        (h * w, 3): "one row a pixel is lost: reshape to (height, width, 3)",
        (h, w, 2): "z is missing: the ray is (x, y, 1), made unit",
    }.get(got[0].shape, "")


# ------------------------------------------------------------------------------------------ typical mistakes


def _before(change: Callable[..., tuple[Any, ...]]) -> Callable[[Function], Function]:
    return lambda f: lambda K, dist, width, height: f(*change(np.array(K, float), np.array(dist, float), width, height))


def _lens(undo: Callable[..., Any]) -> Callable[[Function], Function]:
    return lambda f: lambda K, dist, width, height: _through(K, dist, width, height, undo)


def _moved(x: float, y: float) -> Callable[..., tuple[Any, ...]]:
    """The pixel (u, v) taken for (u + x, v + y)."""
    return lambda K, dist, w, h: (K - [[0, 0, x], [0, 0, y], [0, 0, 0]], dist, w, h)


def _stretched(first: float, last: float) -> Callable[..., tuple[Any, ...]]:
    """Pixels from `first` to width + `last`, as linspace makes them, for those from 0 to width - 1."""

    def change(K: Any, dist: Any, width: int, height: int) -> tuple[Any, ...]:
        K = K.copy()
        for axis, side in enumerate((width, height)):
            step = (side + last - first) / (side - 1)
            K[axis, 2] = (K[axis, 2] - first) / step
            K[axis, axis] /= step
        return K, dist, width, height

    return change


def _centred(offset: float) -> Callable[..., tuple[Any, ...]]:
    return lambda K, dist, w, h: (_with(K, K[0, 0], K[1, 1], (w - offset) / 2, (h - offset) / 2), dist, w, h)


def _with(K: Any, fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _only(*kept: int) -> Callable[..., tuple[Any, ...]]:
    return lambda K, dist, w, h: (K, np.where(np.isin(np.arange(5), kept), dist, 0), w, h)


def _fixed_point(steps: int) -> Callable[[Any, Any, Any], Any]:
    """OpenCV's way: divide by the radial part, take the tangential one off, `steps` times."""

    def undo(xd: Any, yd: Any, dist: Any) -> Any:
        k1, k2, p1, p2, k3 = dist
        x, y = xd, yd
        for _ in range(steps):
            rr = x * x + y * y
            radial = 1 + rr * (k1 + rr * (k2 + rr * k3))
            dx, dy = 2 * p1 * x * y + p2 * (rr + 2 * x * x), p1 * (rr + 2 * y * y) + 2 * p2 * x * y
            x, y = (xd - dx) / radial, (yd - dy) / radial
        return x, y

    return undo


def _cumulative(steps: int, divide: bool) -> Callable[[Any, Any, Any], Any]:
    """Each step begins with the estimate, not with the distorted point."""

    def undo(xd: Any, yd: Any, dist: Any) -> Any:
        x, y = xd, yd
        for _ in range(steps):
            x, y = _fixed_point(1)(x, y, dist) if divide else _corrected(1)(x, y, dist)
        return x, y

    return undo


def _corrected(steps: int) -> Callable[[Any, Any, Any], Any]:
    """What is too much after distorting is taken off, `steps` times."""

    def undo(xd: Any, yd: Any, dist: Any) -> Any:
        x, y = xd, yd
        for _ in range(steps):
            fx, fy = distort(x, y, dist)
            x, y = x - (fx - xd), y - (fy - yd)
        return x, y

    return undo


def _flipped(K: Any, dist: Any, width: int, height: int) -> tuple[Any, ...]:
    """Row 0 below: v from height - 1 down to 0, which a negative focal length says, the lens left as it is."""
    return _with(K, K[0, 0], -K[1, 1], K[0, 2], height - 1 - K[1, 2]), dist, width, height


VARIANTS = (
    Variant("half a pixel", "half a pixel is added: integers are already the pixels' centres, the first is u = 0",
            _before(_moved(0.5, 0.5))),
    Variant("half a pixel", "half a pixel is taken off: integers are already the pixels' centres, the first is u = 0",
            _before(_moved(-0.5, -0.5))),
    Variant("one pixel", "pixels are counted from 1: the first column is u = 0, the first row v = 0",
            _before(_moved(1, 1))),
    Variant("to the far edge", "the pixels are spread from 0 to width instead of 0 to width - 1 (np.linspace(0, width, "
            "width)): np.arange(width) has them", _before(_stretched(0, 0))),
    Variant("to the far edge", "the pixels are spread from edge to edge, -0.5 to width - 0.5, instead of from centre "
            "to "
            "centre: np.arange(width) has them", _before(_stretched(-0.5, -0.5))),
    Variant("distortion not undone", "the distortion is not undone: dist is left out", _before(_only())),
    Variant("distortion applied", "the distortion is applied instead of undone: what is seen at (u, v) is distorted "
            "already, and the ideal (x, y) is wanted", _lens(distort)),
    Variant("distortion's sign", "the distortion is undone with the wrong sign: a lens is not undone by its negative "
            "coefficients", _before(lambda K, dist, w, h: (K, -dist, w, h))),
    Variant("distortion's sign", "the distortion is undone by applying it with negative coefficients: that is right to "
            "first order only; iterate", _lens(lambda x, y, dist: distort(x, y, [-k for k in dist]))),
    *(Variant("too few steps", f"the distortion is undone with too few steps ({steps} of the fixed-point iteration"
              f"{', where cv2.undistortPoints stops unless told' if steps == 5 else ''}): iterate until nothing moves",
              _lens(_fixed_point(steps))) for steps in (1, 2, 3, 4, 5)),
    *(Variant("too few steps", f"the distortion is undone with too few steps ({steps} of x += xd - distort(x)): "
              "iterate until nothing moves", _lens(_corrected(steps))) for steps in (2, 3, 4, 5)),
    *(Variant("corrected again and again", "each step that undoes the distortion corrects the estimate of the step "
              "before once more: start every step from the distorted point, x = (x' - tangential) / radial",
              _lens(_cumulative(steps, divide)))
      for divide, some in ((True, (2, 3, 4, 5, 6, 8, 10, 20, 30, 50)), (False, (2, 3, 4, 5, 10))) for steps in some),
    Variant("k3 left out", "k3, the fifth coefficient, is left out", _before(_only(0, 1, 2, 3))),
    Variant("p1 and p2 left out", "the tangential distortion is left out: p1 and p2, the third and fourth coefficient",
            _before(_only(0, 1, 4))),
    Variant("k1 alone", "only k1 is undone: k2, p1, p2 and k3 are left out", _before(_only(0))),
    Variant("k1 and k2 alone", "only k1 and k2 are undone: p1, p2 and k3 are left out", _before(_only(0, 1))),
    Variant("p1 and p2 swapped", "p1 and p2 are swapped: p1 multiplies r² + 2 y² in y, p2 multiplies r² + 2 x² in x",
            _before(lambda K, dist, w, h: (K, dist[[0, 1, 3, 2, 4]], w, h))),
    Variant("coefficients' order", "the coefficients are read as k1, k2, k3, p1, p2: the order is k1, k2, p1, p2, k3",
            _before(lambda K, dist, w, h: (K, dist[[0, 1, 3, 4, 2]], w, h))),
    Variant("focal lengths swapped", "fx and fy are swapped: fx = K[0, 0] belongs to u",
            _before(lambda K, dist, w, h: (_with(K, K[1, 1], K[0, 0], K[0, 2], K[1, 2]), dist, w, h))),
    Variant("one focal length", "fx is used for both axes: v is divided by fy = K[1, 1]",
            _before(lambda K, dist, w, h: (_with(K, K[0, 0], K[0, 0], K[0, 2], K[1, 2]), dist, w, h))),
    Variant("principal point swapped", "cx and cy are swapped: cx = K[0, 2] belongs to u",
            _before(lambda K, dist, w, h: (_with(K, K[0, 0], K[1, 1], K[1, 2], K[0, 2]), dist, w, h))),
    Variant("principal point in the middle", "the principal point is taken to be the image's middle: it is (cx, cy) = "
            "(K[0, 2], K[1, 2])", _before(_centred(1))),
    Variant("principal point in the middle", "the principal point is taken to be (width / 2, height / 2): it is (cx, "
            "cy)"
            " = (K[0, 2], K[1, 2])", _before(_centred(0))),
    Variant("x and y swapped", "x and y of the rays are swapped: x belongs to the column u, y to the row v",
            after(lambda rays: rays[..., [1, 0, 2]])),
    Variant("y up", "y points up: in the camera frame y points down, as rows do", after(lambda rays: rays * [1, -1,
            1])),
    Variant("OpenGL's frame", "y points up and the rays go along -z, as in OpenGL: here y points down, and z forward",
            after(lambda rays: rays * [1, -1, -1])),
    Variant("backwards", "the rays go backwards: z is forward, so it is positive", after(lambda rays: -rays)),
    Variant("rows flipped", "the rows are upside down: row 0 is the top", _before(_flipped)),
    Variant("not unit", "the rays are not unit: divide (x, y, 1) by its length", after(lambda r: r / r[..., 2:])),
)  # fmt: skip

STAGE = Stage(back_project, ("rays",), cases, errors, 2e-5, "radians", VARIANTS, hint=hint)
