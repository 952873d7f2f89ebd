"""The same scene as Mitsuba renders it left to itself: a baseline of speed.

`render` takes care that noise and outlines are comparable: own rays, a sun summed by a shadow ray, batches, a surface.
`render_plain` takes none: Mitsuba's sensor, film and integrator, its own shadow offset, nothing but the picture.
"""

from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Scene
from raytwin.twin.backend import SCALAR, activate
from raytwin.twin.rays import lens_of
from raytwin.twin.twin_scene import UNIT, load, translate

INTEGRATORS = {"direct": {"type": "direct"}, "path": {"type": "path", "max_depth": 8, "rr_depth": 8}}
"""name -> Mitsuba's: light that met one surface (the rung `sky`), and up to seven (the rung `path`)."""

LANES = 1 << 24
"""Most rays in one launch: Mitsuba keeps the state of every sample of a launch in memory."""


def load_plain(scene: Scene, integrator: str = "direct", variant: str | None = None) -> Any:
    """A Mitsuba scene with its own sensor, box filter and integrator, to hand to `render_plain`.

    The sensor is `perspective` where pixels are square and nothing is distorted; else, on the compiled variants, one
    that undoes the distortion (about half as slow again). Raises InputError on `scalar_rgb`, which cannot run that one.
    """
    chosen = activate(variant).variant
    import mitsuba as mi

    camera = scene.camera
    square = abs(camera.fx / camera.fy - 1) < 1e-6
    if chosen == SCALAR and (any(camera.coefficients) or not square):
        raise InputError("camera", f"square pixels and no distortion, for Mitsuba's own camera on {SCALAR}", "neither")
    world: dict[str, Any] = translate(scene, {}) | {"integrator": INTEGRATORS[integrator]}
    film = {
        "type": "hdrfilm", "width": camera.width, "height": camera.height, "rfilter": {"type": "box"},
        "pixel_format": "rgb", "component_format": "float32",
    }  # fmt: skip
    if any(camera.coefficients) or not square:
        _register_lens()
        numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.coefficients)
        world["sensor"] = {"type": "raytwin_lens", "film": film, "steps": lens_of(camera).steps}
        world["sensor"] |= dict(zip(_LENS, map(float, numbers), strict=True))
    else:
        world["sensor"] = {
            "type": "perspective", "film": film, "fov_axis": "x", "near_clip": 1e-3 * UNIT, "far_clip": 1e6 * UNIT,
            "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
            # Mitsuba looks along +z with x to the left and y up.
            "to_world": mi.ScalarTransform4f(np.diag([-1.0, -1.0, 1.0, 1.0])),
            "principal_point_offset_x": (camera.width / 2 - (camera.cx + 0.5)) / camera.width,
            "principal_point_offset_y": (camera.height / 2 - (camera.cy + 0.5)) / camera.height,
        }  # fmt: skip
    return load(world)


def render_plain(loaded: Any, samples: int = 1, seed: int = 0) -> np.ndarray:
    """`samples` a pixel of what `load_plain` loaded: (H, W, 3) float32. The variant must still be the active one."""
    import mitsuba as mi

    film = loaded.sensors()[0].film().size()
    pixels = int(film[0]) * int(film[1])
    each = min(samples, max(1, LANES // pixels)) if mi.variant() != SCALAR else samples
    while samples % each:
        each -= 1
    total = np.zeros((int(film[1]), int(film[0]), 3), np.float32)
    for i in range(samples // each):
        part = np.array(mi.render(loaded, spp=each, seed=seed * (samples // each) + i))
        if each == samples:
            return part
        total += part
    return total / (samples // each)


_LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def _register_lens() -> None:
    """Mitsuba's classes are those of the active variant: the sensor is made anew for it."""
    import drjit as dr
    import mitsuba as mi

    from raytwin.twin.rays import Lens, directions

    class RaytwinLens(mi.Sensor):
        """A pinhole behind Brown and Conrady's distortion, as `rays.py` has it."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            double = dr.float64_array_t(mi.Float)
            fx, fy, cx, cy, *k = (dr.opaque(double, props[name]) for name in _LENS)
            self.lens = Lens(fx, fy, cx, cy, tuple(k), int(props["steps"]))

        def sample_ray(self, time: Any, wave: Any, position: Any, aperture: Any, active: Any) -> tuple[Any, Any]:
            double, size = dr.float64_array_t(mi.Float), self.film().crop_size()
            # The position is (0, 0) at the image's corner; pixel 0's centre is at 1/2.
            u, v = double(position.x) * int(size[0]) - 0.5, double(position.y) * int(size[1]) - 0.5
            d = mi.Vector3f(*map(mi.Float, directions(dr, self.lens, u, v)))
            ray = mi.Ray3f(mi.Point3f(0), d)
            ray.wavelengths, weight = self.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wave, active)
            return ray, weight

        def sample_ray_differential(self, *numbers: Any) -> tuple[Any, Any]:
            ray, weight = self.sample_ray(*numbers)
            return mi.RayDifferential3f(ray), weight

        def to_string(self) -> str:
            return "RaytwinLens[]"

    mi.register_sensor("raytwin_lens", RaytwinLens)
