"""OpenCV's camera in Mitsuba: K, the principal point, two focal lengths, and the inverse of its distortion."""

from typing import Any

import numpy as np

from raytwin.errors import InputError, missing_package
from raytwin.scene import Camera
from raytwin.scene.lens import NEWTON_STEPS, check_lens, newton_step
from raytwin.twin.backend import activate

SETTLED = 1e-13
"""Length of Newton's step, in focal lengths, after which the inverse of the distortion is exact in float64."""


def mitsuba_sensor(camera: Camera, *, samples: int = 16, unit: float = 1.0) -> dict[str, Any]:
    """Return a Mitsuba sensor that sees what `camera` sees, as a dict for `mi.load_dict`; the axes are the board's.

    It undoes OpenCV's k1, k2, p1, p2, k3 for each ray in double precision, and is registered with the current variant:
    set that first. `unit`: units of Mitsuba's world per metre (1000 where it is in millimetres). `samples` per pixel.

    Raises MachineError without Mitsuba, InputError for a lens that cannot be undone, and on Mitsuba's scalar variants,
    which run no sensor written in Python.
    """
    try:
        import mitsuba as mi
    except ModuleNotFoundError as error:
        raise missing_package("mitsuba_sensor", error) from None
    if mi.variant() is None:
        activate()
    film = {"type": "hdrfilm", "rfilter": {"type": "box"}, "width": camera.width, "height": camera.height}
    return lens_at(camera, np.asarray(camera.eye) * unit) | {
        "film": film | {"pixel_format": "rgb", "component_format": "float32"},
        "sampler": {"type": "independent", "sample_count": samples},
    }


def lens_at(camera: Camera, eye: np.ndarray, start: float = 0.0) -> dict[str, Any]:
    """The sensor at `eye` (3,) of Mitsuba's world, registered with the active variant; rays begin `start` from it."""
    import mitsuba as mi

    if mi.variant().startswith("scalar"):
        raise InputError("variant", "one of Mitsuba's that run a sensor written in Python", mi.variant())
    check_lens(camera)
    _register()
    numbers = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "start": start}
    numbers |= {f"dist_{i}": k for i, k in enumerate(camera.coefficients)}
    pose = np.eye(4)  # the camera's frame -> Mitsuba's world
    pose[:3, :3], pose[:3, 3] = np.asarray(camera.R_cam_board).T, eye
    made: dict[str, Any] = {"type": "raytwin_lens", "pinhole": not any(camera.dist)}
    made |= {name: float(x) for name, x in numbers.items()}
    return made | {"to_world": mi.ScalarTransform4d(pose)}


def _register() -> None:
    import drjit as dr
    import mitsuba as mi

    class RaytwinLens(mi.Sensor):
        """A pinhole behind Brown and Conrady's distortion, all in float64.

        Its numbers are a kernel's parameters, so that another camera runs the kernel that is compiled already.
        """

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.double = dr.float64_array_t(mi.Float)
            names = ("fx", "fy", "cx", "cy", "start", *(f"dist_{i}" for i in range(5)))
            numbers = [dr.opaque(self.double, props[name]) for name in names]
            self.fx, self.fy, self.cx, self.cy, self.start, *self.dist = numbers
            matrix = np.array(props["to_world"].matrix).tolist()
            self.rows = [[dr.opaque(self.double, x) for x in row] for row in matrix[:3]]
            self.pinhole = bool(props["pinhole"])

        def direction(self, u: Any, v: Any) -> list[Any]:
            """(x, y, 1) / |(x, y, 1)| in the world's axes, through pixel (u, v): (0, 0) is the top-left one's centre.

            In float32 the rounding of u alone would move a 12 MP image's right edge by 1e-4 px.
            """
            x, y = (u - self.cx) / self.fx, (v - self.cy) / self.fy
            if not self.pinhole:
                x, y = self.undistort(x, y)
            scale = 1 / dr.sqrt(x * x + y * y + 1)
            return [(row[0] * x + row[1] * y + row[2]) * scale for row in self.rows]

        def undistort(self, xd: Any, yd: Any) -> tuple[Any, Any]:
            """The (x, y) that OpenCV's distortion takes to (xd, yd), by Newton's method from there, as `scene.lens`."""

            def unsettled(count: Any, x: Any, y: Any, step: Any) -> Any:
                return (count < NEWTON_STEPS) & (step > SETTLED)

            def closer(count: Any, x: Any, y: Any, step: Any) -> tuple[Any, ...]:
                dx, dy = newton_step(x, y, xd, yd, self.dist)
                return count + 1, x + dx, y + dy, abs(dx) + abs(dy)

            return dr.while_loop((dr.zeros(mi.UInt32, dr.width(xd)), xd, yd, abs(xd) + 1), unsettled, closer)[1:3]

        def ray(self, u: Any, v: Any) -> Any:
            """The ray through the float64 pixel (u, v)."""
            d = self.direction(u, v)
            o = [mi.Float(row[3] + self.start * along) for row, along in zip(self.rows, d, strict=True)]
            return mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*map(mi.Float, d))))

        def sample_ray_differential(
            self, time: Any, wave: Any, position: Any, aperture: Any, active: Any = True
        ) -> tuple[Any, Any]:
            film = self.film()
            # The position is (0, 0) at the crop's corner. Pixel 0's centre is at 1/2 there, and at 0 in OpenCV.
            sides = zip(position, film.crop_size(), film.crop_offset(), strict=True)
            ray = self.ray(*(self.double(at) * int(size) + int(offset) - 0.5 for at, size, offset in sides))
            ray.wavelengths, weight = self.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wave, active)
            return ray, weight

        def sample_ray(self, *numbers: Any) -> tuple[Any, Any]:
            return self.sample_ray_differential(*numbers)

        def to_string(self) -> str:
            return "RaytwinLens[]"

    mi.register_sensor("raytwin_lens", RaytwinLens)
