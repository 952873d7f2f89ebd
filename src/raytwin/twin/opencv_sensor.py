"""OpenCV's camera as Mitsuba's: K, the principal point, two focal lengths, and lens distortion."""

from typing import Any

import numpy as np

from raytwin.errors import InputError, missing_package
from raytwin.scene import Camera
from raytwin.twin.backend import activate
from raytwin.twin.rays import Lens, directions, lens_of

TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])
"""OpenCV's camera frame -> that of Mitsuba's own cameras, which look along +z with x to the left and y up."""
NEAR_METRES, FAR_METRES = 1e-3, 1e6
"""Metres: what a pinhole of Mitsuba's sees lies between."""
_LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


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
    lens = lens_of(camera)
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.coefficients)
    made = {"type": "raytwin_lens", "steps": lens.steps, "width": camera.width, "height": camera.height}
    made |= dict(zip(_LENS, map(float, numbers), strict=True))
    return common | made | {"to_world": mi.ScalarTransform4f(to_world)}


def _register() -> None:
    """Register the sensor with the active variant, whose classes it is made of."""
    import drjit as dr
    import mitsuba as mi

    class RaytwinLens(mi.Sensor):
        """A pinhole behind Brown and Conrady's distortion, as `rays.py` has it."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            double = dr.float64_array_t(mi.Float)
            fx, fy, cx, cy, *k = (dr.opaque(double, props[name]) for name in _LENS)
            self.lens = Lens(fx, fy, cx, cy, tuple(k), int(props["steps"]))
            self.frame = int(props["width"]), int(props["height"])

        def sample_ray(self, time: Any, wave: Any, position: Any, aperture: Any, active: Any) -> tuple[Any, Any]:
            double, film = dr.float64_array_t(mi.Float), self.film()
            # The position is (0, 0) at the crop's corner; pixel 0's centre is at 1/2.
            u, v = (
                (double(at) * int(crop) + int(first)) * (side / int(size)) - 0.5
                for at, crop, first, size, side in zip(
                    (position.x, position.y), film.crop_size(), film.crop_offset(), film.size(), self.frame, strict=True
                )
            )
            d = mi.Vector3f(*map(mi.Float, directions(dr, self.lens, u, v)))
            ray = mi.Ray3f(self.world_transform() @ mi.Point3f(0), self.world_transform() @ d)
            ray.wavelengths, weight = self.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wave, active)
            return ray, weight

        def sample_ray_differential(self, *numbers: Any) -> tuple[Any, Any]:
            ray, weight = self.sample_ray(*numbers)
            return mi.RayDifferential3f(ray), weight

        def to_string(self) -> str:
            return "RaytwinLens[]"

    mi.register_sensor("raytwin_lens", RaytwinLens)
