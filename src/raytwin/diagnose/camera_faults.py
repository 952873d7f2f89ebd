"""Mistakes from the pixel to the ray: pixels, lens, camera matrix, pose."""

from functools import partial
from typing import Any

from raytwin.diagnose.changes import (
    UNIT,
    Ways,
    by_key,
    lens,
    pixels,
    posed,
)
from raytwin.diagnose.predict import Pipeline, replaced, slips
from raytwin.tracer import undistort


def _newton(right: Any, steps: int) -> Any:
    return lambda xd, yd, dist: undistort(xd, yd, dist.tolist(), steps=steps)


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


CAMERAS: Ways = {
    "nothing-met": by_key("np.inf + every_t"),
    "half-pixel": pixels("u + 0.5, v + 0.5", "u - 0.5, v - 0.5", "u + 0.5, v", "u, v + 0.5"),
    "count-from-one": pixels("u + 1, v + 1", "u - 1, v - 1", "u + 1, v", "u, v + 1"),
    "linspace": pixels("u * width / (width - 1), v * height / (height - 1)",
        "u * width / (width - 1) - 0.5, v * height / (height - 1) - 0.5",
        "u * (width - 1) / width, v * (height - 1) / height"),
    "distortion-kept": slips("through", f"{UNDO} => ((u - cx) / fx, (v - cy) / fy)"),
    "distortion-forward": lens_of(f"{STEP} => {FORWARD}", f"{DIST} => {DIST}\n    p1 = p2 = 0 ;; {STEP} => {FORWARD}"),
    "distortion-sign": (*_dist("k1, k2, p1, p2, k3 = -k1, -k2, -p1, -p2, -k3", "k1, k2, k3 = -k1, -k2, -k3", "k1 = -k1",
        "p1, p2 = -p1, -p2"),
        *lens_of(f"{STEP} => x, y = (xd - dx) * radial, (yd - dy) * radial",
        f"{DIST} => {DIST}\n    k1, k2, p1, p2, k3 = -k1, -k2, -p1, -p2, -k3 ;; {STEP} => {FORWARD}")),
    "distortion-few-steps": (
        *(way for step, counts in ((STEP, (1, 2, 3, 4, 5, 6, 8)), (TAKEN_OFF, (2, 3, 4, 5, 6, 8))) for n in counts
        for way in lens_of(f"range(30) => range({n}) ;; {STEP} => {step}")),
        *(replaced(undistort=partial(_newton, steps=n)) for n in (1, 2))),
    "distortion-cumulative": tuple(way for step, counts, more in (
        (AGAIN, (2, 3, 4, 5, 6, 8, 10, 20, 30, 50), ""), (AGAIN, (5, 10), "\n    p1 = p2 = 0"),
        (TAKEN_OFF.replace("xd", "x").replace("yd", "y"), (2, 3, 4, 5, 10), "")) for n in counts
        for way in lens_of(f"{DIST} => {DIST}{more} ;; range(30) => range({n}) ;; {STEP} => {step}")),
    "k3-left-out": _dist("k3 = 0"),
    "k2-left-out": _dist("k2 = 0", "k2 = k3 = 0", "k2 = p1 = p2 = k3 = 0"),
    "tangential-left-out": (*_dist("p1 = p2 = 0", "p1 = p2 = k3 = 0"),
        *lens_of(*(f"{one} => 0 * x" for one in (XY1, XX, YY, XY2)),
        *(f"{one} => 0 * x ;; {other} => 0 * y" for one, other in ((XY1, XX), (YY, XY2))))),
    "tangential-swapped": (*_dist("p1, p2 = p2, p1"),
        *lens_of(*map(_other, (XY1, XX, YY, XY2)),
        *(f"{_other(one)} ;; {_other(two)}" for one, two in ((XY1, XX), (YY, XY2))))),
    "coefficients-order": _dist("p1, p2, k3 = p2, k3, p1", "p1, p2, k3 = 0, 0, p1"),
    "tangential-factor":
        lens_of(ONE_CROSS, ONE_SQUARE, f"{ONE_CROSS} ;; {ONE_SQUARE}", f"{XX} => p2 * r2 ;; {YY} => p1 * r2",
        *ONE_CROSS.split(" ;; "), *ONE_SQUARE.split(" ;; ")),
    "tangential-after": lens_of(f"{STEP} => x, y = xd / radial - dx, yd / radial - dy"),
    "powers-of-r": lens_of("r2**2 => r2 ;; r2**3 => r2", "r2**3 => r2**2", "r2**3 => r2**4",
        f"{POWERS} => k1 * r2**2 + k2 * r2**4 + k3 * r2**6", "r2**2 => r2", "r2**3 => r2"),
    "radius-for-its-square": lens_of(f"{DIST} => {DIST}\n    p1 = p2 = 0 ;; x * x + y * y => np.sqrt(x * x + y * y)",
        "x * x + y * y => np.sqrt(x * x + y * y)", f"{POWERS} => k1 * r2**0.5 + k2 * r2 + k3 * r2**1.5"),
    "swapped-axes": pixels("v, u"),
    "reshaped": pixels("(v * width + u) // height, (v * width + u) % height",
        "(u * height + v) % width, (u * height + v) // width"),
    "swapped-focal": _K("fx, fy = fy, fx"),
    "one-focal": _K("fy = fx", "fx = fy", "fx = fy = (fx + fy) / 2"),
    "swapped-centre": _K("cx, cy = cy, cx", "cx = cy", "cy = cx"),
    "whole-numbers": tuple(way for f in ("np.floor", "np.rint") for way in _K(
        f"cx, cy = {f}(cx), {f}(cy)", f"fx, fy = {f}(fx), {f}(fy)", f"fx, fy, cx, cy = {f}([fx, fy, cx, cy])")),
    "centre-of-image": (
        *(lens(cx=lambda c, k=k: (c["width"] - k) / 2, cy=lambda c, k=k: (c["height"] - k) / 2) for k in (0, 1)),
        lens(cx=lambda c: c["height"] / 2, cy=lambda c: c["width"] / 2),
        lens(cx=lambda c: c["width"] / 2), lens(cy=lambda c: c["height"] / 2)),
    "centre-left-out": _K("cx = cy = 0", "cx = 0", "cy = 0", "cx, cy = -cx, -cy"),
    "x-for-y": _ray("y, x, one"),
    "y-up": _ray("x, -y, one"),
    "x-left": _ray("-x, y, one"),
    "z-backwards": _ray("x, y, -one", "x, -y, -one", "-x, y, -one", "-x, -y, -one", "-x, -y, one"),
    "transposed-R": posed(("-R.T @ t", "rays @ R.T"), ("-R @ t", "rays @ R.T")),
    "inverse-pose": posed(("t", "rays @ R.T")),
    "wrong-eye": posed(*((eye, "rays @ R") for eye in ("t", "-t", "R.T @ t", "-R @ t", "R @ t")),
        ("R.T @ t", "rays @ R.T"), ("-t", "rays @ R.T")),
    "direction-as-point": slips("to_board", *(
        f"directions = rays @ R => d = {rays} @ {moved}\n"
        "    directions = d / np.linalg.norm(d, axis=-1, keepdims=True)"
        for moved in ("R + eye", "R.T + t") for rays in ("rays", "(rays / rays[:, 2:])"))),
    "eye-at-origin": posed(("0 * t", "rays @ R"), ("0 * t", "rays @ R.T")),
    "rotation-left-out": posed(("-R.T @ t", "rays"), ("-t", "rays"), ("t", "rays")),
    "distance-by-camera-ray": slips("met", "intersect_all(origins, directions => intersect_all(origins, rays"),
}  # fmt: skip

ALONE: Ways = {
    "rays-long": slips("through", f"{UNIT} => rays"),
    "centre-of-image": _K("cx, cy = np.max(u) / 2, np.max(v) / 2", "cx, cy = (np.max(u) + 1) / 2, (np.max(v) + 1) / 2"),
    "rays-by-norm-of-many": slips("through", *(f"{UNIT} => rays / np.linalg.norm(rays{axis})" for axis in (
        "", *(f", axis={k}, keepdims=True" for k in (0, 1, (0, 1)))))),
}  # fmt: skip
