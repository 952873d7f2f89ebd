"""Rectangles that share a place with another, or with the eye: floats alone go wrong there, and raytwin refuses."""

import numpy as np

from raytwin.arrays import unit
from raytwin.atlas.experiment import U32, Error, Experiment, decades
from raytwin.atlas.reference_faults import DOWN, FLOOR, GREY, SIDE, TO_SUN, TRACER, TWIN, beyond, seen_by, view
from raytwin.errors import InputError
from raytwin.scene import Camera, Rectangle, Scene, Sun, to_camera_frame
from raytwin.tracer import intersect_rectangle


def fought(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Two floors, the upper x of the eye's height above the lower: the share of pixels that see the wrong one."""
    turn = np.array([[0.8, 0.6, 0], [-0.6 * 0.6, 0.6 * 0.8, -0.8], [-0.8 * 0.6, 0.8 * 0.8, 0.6]])
    R = turn @ DOWN if np.linalg.det(turn @ DOWN) > 0 else turn
    camera = view((0.1, 0.2, 1.0), R)
    upper = Rectangle((0.05, 0.02, x), (3.0, 0.0, 0.0), (0.0, 3.0, 0.0), GREY)
    lower = Rectangle((0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0), GREY)
    found: dict[str, Error] = {}
    a, b, c = TO_SUN.tolist()
    for name, image in seen_by(Scene("fight", camera, (lower, upper), (Sun((a, b, c)),))).items():
        found[name] = None if image is None or image.surface is None else float((image.surface.ids == 0).mean())
    # The same test of planes in float32, without a check, from the same eye.
    R32, t32 = (np.array(m, np.float32) for m in (camera.R_cam_board, camera.t_cam_board))
    at = np.arange(SIDE, dtype=np.float32) - np.float32(camera.cx)
    u, v = (g.ravel() / np.float32(camera.fx) for g in np.meshgrid(at, at))
    way = unit((u, v, np.ones_like(u)))
    nearest = [intersect_rectangle((np.float32(0),) * 3, way, turned(plane, R32, t32)) for plane in (lower, upper)]
    return found | {"float32, unchecked": float((nearest[0] <= nearest[1]).mean())}


def turned(plane: Rectangle, R: np.ndarray, t: np.ndarray) -> Rectangle:
    """In the camera's frame, in the floats of R and t."""
    kind = R.dtype.type
    middle, u, v = (R @ np.array(a, kind) for a in (plane.center, plane.half_u, plane.half_v))
    return Rectangle(tuple(middle + t), tuple(u), tuple(v))


def within(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The eye x above a floor of 2 m, in n turns, looking up from it: the share of rays that meet it all the same."""
    height, unchecked, found = x if x > 1e-19 else 0.0, {np.float32: 0.0, np.float64: 0.0}, 0.0
    refused = False
    for _ in range(n):
        q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        R = q * np.linalg.det(q)
        eye = np.array((0.1, 0.2, height))
        up = np.abs(rng.normal(size=(3, 200))) * np.array([[1], [1], [0.5]]) * (2 * rng.integers(0, 2, (3, 200)) - 1)
        up[2] = np.abs(up[2]) + 1e-3
        d = R @ (up / np.linalg.norm(up, axis=0))
        for kind in unchecked:
            local = turned(FLOOR, R.astype(kind), (-R @ eye).astype(kind))
            way = d.astype(kind)
            t = intersect_rectangle((kind(0),) * 3, (way[0], way[1], way[2]), local)
            unchecked[kind] += float(np.isfinite(t).mean()) / n
        r = [tuple(row) for row in R.tolist()]
        camera = Camera((1, 1), EYE_K, (r[0], r[1], r[2]), tuple((-R @ eye).tolist()))
        try:
            floor = to_camera_frame(Scene("eye", camera, (FLOOR,))).rectangles[0]
            found += float(np.isfinite(intersect_rectangle((0.0, 0.0, 0.0), (d[0], d[1], d[2]), floor)).mean()) / n
        except InputError:
            refused = True
    return {
        **{f"n·f / n·d, {np.dtype(k)}": e for k, e in unchecked.items()},
        "raytwin's tracer": None if refused else found,
    }


EYE_K = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


EXPERIMENTS = (
    Experiment(
        "planes-fight", "Two sheets, one close above the other", "distance apart / height of the eye",
        "share of pixels that see the lower",
        1e-3, decades(-1, -16), fought, (TWIN, TRACER),
        "Sheets nearer to each other than rounding fight for each pixel, and shade each other in patches. raytwin "
        "refuses a scene whose rectangles lie in one place, to the floats that are used, and says which two.",
        "Lapidous and Jiao, Optimal Depth Buffer for Low-Cost Graphics Hardware (1999): the same in rasterisers",
        {"float32, unchecked": beyond(U32, 0.3)}, trials=1, many=1,
    ),
    Experiment(
        "plane-eye", "An eye within a sheet, looking up from it", "height of the eye, m",
        "share of rays that meet the sheet",
        1e-3, decades(-1, -19), within, (TRACER,),
        "An eye exactly in a plane lies, to rounding, on one side or the other, and then sees the plane at a distance "
        "of 1e-17 in half of its directions. What it should see is a matter of taste, so raytwin refuses.",
        "The distance t = n·f / n·d, whose numerator is all rounding",
        {"n·f / n·d, float32": beyond(0.2 * U32, 0.3), "n·f / n·d, float64": beyond(0.2 * 2.0**-53, 0.3)}, trials=8,
        many=64,
    ),
)  # fmt: skip
