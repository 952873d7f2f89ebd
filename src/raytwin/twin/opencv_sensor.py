"""OpenCV's camera in Mitsuba: K, the principal point, two focal lengths, and the inverse of its distortion."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from raytwin.errors import InputError, missing_package
from raytwin.scene import Camera
from raytwin.scene.lens import NEWTON_STEPS, check_lens, newton_step
from raytwin.twin.backend import activate

TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])
"""OpenCV's camera frame -> that of Mitsuba's own cameras, which look along +z with x to the left and y up."""
NEAR_METRES, FAR_METRES = 1e-3, 1e6
"""Metres: what a pinhole of Mitsuba's sees lies between."""
SETTLED = 1e-13
"""Length of Newton's step, in focal lengths, after which the inverse of the distortion is exact in float64."""


class Eye(NamedTuple):
    """A camera in Mitsuba's world: parameters of a kernel, so that another camera runs the one that is compiled.

    `K`: fx, fy, cx, cy; `dist`: k1, k2, p1, p2, k3, or () for a pinhole. `axes`: R_cam_world by columns. `at`: the
    eye. `start`: how far from it rays begin. All are float64.
    """

    K: tuple[Any, ...]
    dist: tuple[Any, ...]
    axes: tuple[Any, ...]
    at: tuple[Any, ...]
    start: Any

    @classmethod
    def of(cls, K: Iterable[float], dist: Iterable[float], R: np.ndarray, at: np.ndarray, start: float = 0.0) -> "Eye":
        """The parameters of these numbers; R (3, 3), at (3,)."""
        import drjit as dr
        import mitsuba as mi

        def parameter(x: Any) -> Any:
            double = dr.float64_array_t(mi.Float)
            return dr.opaque(double, float(x)) if np.ndim(x) == 0 else tuple(map(parameter, x))

        dist = tuple(dist)
        return cls(*map(parameter, (tuple(K), dist if any(dist) else (), R.T, at, start)))

    def direction(self, u: Any, v: Any) -> list[Any]:
        """(x, y, 1) / |(x, y, 1)| in the world's axes, through pixel (u, v): (0, 0) is the top-left one's centre.

        In float32 the rounding of u alone would move a 12 MP image's right edge by 1e-4 px.
        """
        import drjit as dr

        fx, fy, cx, cy = self.K
        x, y = (u - cx) / fx, (v - cy) / fy
        if self.dist:
            x, y = self.undistort(x, y)
        scale = 1 / dr.sqrt(x * x + y * y + 1)
        return [(axis[0] * x + axis[1] * y + axis[2]) * scale for axis in self.axes]

    def undistort(self, xd: Any, yd: Any) -> tuple[Any, Any]:
        """The (x, y) that OpenCV's distortion takes to (xd, yd), by Newton's method from there, as `scene.lens`."""
        import drjit as dr

        def unsettled(steps: Any, x: Any, y: Any, dx: Any, dy: Any) -> Any:
            return (steps < NEWTON_STEPS) & (abs(dx) + abs(dy) > SETTLED)

        def closer(steps: Any, x: Any, y: Any, dx: Any, dy: Any) -> tuple[Any, ...]:
            dx, dy = newton_step(x, y, xd, yd, self.dist)
            return steps + 1, x + dx, y + dy, dx, dy

        first = dr.zeros(dr.uint32_array_t(xd), dr.width(xd)), xd, yd, xd + 1, yd + 1
        return dr.while_loop(first, unsettled, closer)[1:3]

    def ray(self, u: Any, v: Any) -> Any:
        """The ray through the float64 pixel (u, v)."""
        import mitsuba as mi

        d = self.direction(u, v)
        o = [mi.Float(at + self.start * along) for at, along in zip(self.at, d, strict=True)]
        return mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*map(mi.Float, d))))


def mitsuba_sensor(
    camera: Camera, *, samples: int = 16, unit: float = 1.0, frame: str = "board", film: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Return a Mitsuba sensor that sees what `camera` sees, as a dict for `mi.load_dict`.

    It is Mitsuba's `perspective` where pixels are square and nothing is distorted; else a sensor that undoes OpenCV's
    k1, k2, p1, p2, k3 for each ray in double precision, registered with the current variant: set that first. `unit`:
    units of Mitsuba's world per metre (1000 where it is in millimetres). `frame`: what that world's axes are, those of
    the "board", or of the "camera" (OpenCV's: x right, y down, z forward). `samples` per pixel; `film` replaces
    entries of the film, as {"rfilter": {"type": "gaussian"}}.

    Raises MachineError without Mitsuba, InputError for a lens that cannot be undone, and on Mitsuba's scalar variants
    for one that is distorted: they run no sensor written in Python. A film of another size sees the same frame, scaled.
    """
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise missing_package("mitsuba_sensor", error) from None
    if mi.variant() is None:
        activate()
    R = np.asarray(camera.R_cam_board, float) if frame == "board" else np.eye(3)
    eye = -R.T @ np.asarray(camera.t_cam_board, float) * unit if frame == "board" else np.zeros(3)
    return sensor_at(camera, R, eye, unit, samples, film)


def sensor_at(
    camera: Camera, R: np.ndarray, eye: np.ndarray, unit: float, samples: int = 16, film: dict[str, Any] | None = None
) -> dict[str, Any]:
    """The same, at `eye` (3,) of Mitsuba's world, whose axes R (3, 3) turns into the camera's."""
    import mitsuba as mi

    shape = {"width": camera.width, "height": camera.height, "pixel_format": "rgb", "component_format": "float32"}
    common = {
        "film": {"type": "hdrfilm", "rfilter": {"type": "box"}} | shape | (film or {}),
        "sampler": {"type": "independent", "sample_count": samples},
    }
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = R.T, eye
    if not any(camera.coefficients) and abs(camera.fx / camera.fy - 1) < 1e-6:
        return common | {
            "type": "perspective", "fov_axis": "x", "near_clip": NEAR_METRES * unit, "far_clip": FAR_METRES * unit,
            "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
            "to_world": mi.ScalarTransform4f(to_world @ TURNED),
            "principal_point_offset_x": (camera.width / 2 - (camera.cx + 0.5)) / camera.width,
            "principal_point_offset_y": (camera.height / 2 - (camera.cy + 0.5)) / camera.height,
        }  # fmt: skip
    if mi.variant().startswith("scalar"):
        expected = f"square pixels and no distortion, for Mitsuba's own camera on {mi.variant()}"
        raise InputError("camera", expected, "neither")
    _register()
    check_lens(camera)
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.coefficients)
    made: dict[str, Any] = {f"lens_{i}": float(x) for i, x in enumerate(numbers)}
    made |= {"type": "raytwin_lens", "width": camera.width, "height": camera.height}
    return common | made | {"to_world": mi.ScalarTransform4f(to_world)}


def _register() -> None:
    """Register the sensor with the active variant, whose classes it is made of."""
    import drjit as dr
    import mitsuba as mi

    class RaytwinLens(mi.Sensor):
        """A pinhole behind Brown and Conrady's distortion: `Eye` behind Mitsuba's film."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            lens, to_world = [props[f"lens_{i}"] for i in range(9)], np.array(props["to_world"].matrix)
            self.eye = Eye.of(lens[:4], lens[4:], to_world[:3, :3].T, to_world[:3, 3])
            self.frame = int(props["width"]), int(props["height"])

        def sample_ray_differential(
            self, time: Any, wave: Any, position: Any, aperture: Any, active: Any = True
        ) -> tuple[Any, Any]:
            double, film = dr.float64_array_t(mi.Float), self.film()
            # The position is (0, 0) at the crop's corner; pixel 0's centre is at 1/2.
            u, v = (
                (double(at) * int(crop) + int(first)) * (side / int(size)) - 0.5
                for at, crop, first, size, side in zip(
                    (position.x, position.y), film.crop_size(), film.crop_offset(), film.size(), self.frame, strict=True
                )
            )
            ray = self.eye.ray(u, v)
            ray.wavelengths, weight = self.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wave, active)
            return ray, weight

        def sample_ray(self, *numbers: Any) -> tuple[Any, Any]:
            return self.sample_ray_differential(*numbers)

        def to_string(self) -> str:
            return "RaytwinLens[]"

    mi.register_sensor("raytwin_lens", RaytwinLens)
