"""The same scene as Mitsuba renders it left to itself: a baseline of speed, and spheres as triangle meshes.

`render` takes care that noise and outlines are comparable: own rays, a sun summed by a shadow ray, batches, a surface.
`render_plain` takes none: Mitsuba's sensor, film and integrator, its own shadow offset, nothing but the picture.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import Camera, Scene, Sphere
from raytwin.twin.backend import SCALAR, activate
from raytwin.twin.rays import lens_of
from raytwin.twin.world import UNIT, translate

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
        world["sensor"] = {"type": "raytwin_lens", "film": film}
        world["sensor"] |= dict(zip(("fx", "fy", "cx", "cy", "steps"), _numbers(camera), strict=True))
        world["sensor"] |= {f"k{i}": float(k) for i, k in enumerate(camera.coefficients)}
    else:
        world["sensor"] = {
            "type": "perspective", "film": film, "fov_axis": "x", "near_clip": 1e-3 * UNIT, "far_clip": 1e6 * UNIT,
            "fov": float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))),
            # Mitsuba looks along +z with x to the left and y up.
            "to_world": mi.ScalarTransform4f(np.diag([-1.0, -1.0, 1.0, 1.0])),
            "principal_point_offset_x": (camera.width / 2 - (camera.cx + 0.5)) / camera.width,
            "principal_point_offset_y": (camera.height / 2 - (camera.cy + 0.5)) / camera.height,
        }  # fmt: skip
    return mi.load_dict(world)


def render_plain(loaded: Any, samples: int = 1, seed: int = 0) -> np.ndarray:
    """`samples` a pixel of what `load_plain` loaded: (H, W, 3) float32. The variant must still be the active one."""
    import mitsuba as mi

    film = loaded.sensors()[0].film().size()
    pixels = int(film[0]) * int(film[1])
    each = min(samples, max(1, LANES // pixels)) if "scalar" not in mi.variant() else samples
    while samples % each:
        each -= 1
    total = np.zeros((int(film[1]), int(film[0]), 3), np.float32)
    for i in range(samples // each):
        part = np.array(mi.render(loaded, spp=each, seed=seed * (samples // each) + i))
        if each == samples:
            return part
        total += part
    return total / (samples // each)


def load_mesh(scene: Scene, levels: int, variant: str | None = None) -> Any:
    """The twin of the scene with every sphere a mesh of 20 · 4^levels flat triangles, to hand to `render_mesh`."""
    chosen = activate(variant).variant
    from raytwin.twin.render import _engine

    return _engine(chosen).Renderer(scene, {}, None, meshes(scene, levels))


def render_mesh(loaded: Any, camera: Camera, rung: str = "shadow") -> Image:
    """A rung without noise, through the pixels' centres of the camera that the scene was loaded with."""
    from raytwin.twin.render import _exact

    mean, surface = _exact(loaded, camera, rung, lambda _: None)
    return Image(mean, surface=surface)


def meshes(scene: Scene, levels: int) -> Mapping[int, Any]:
    """object id -> a Mitsuba mesh in the place of the sphere, its corners on the sphere."""
    import mitsuba as mi

    points, faces = icosphere(levels)
    R, t = np.asarray(scene.camera.R_cam_board), np.asarray(scene.camera.t_cam_board)
    made = {}
    for i, thing in enumerate(scene.objects):
        if isinstance(thing, Sphere):
            properties = mi.Properties()
            properties["bsdf"] = mi.load_dict(
                {
                    "type": "twosided",
                    "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(thing.albedo)}},
                }
            )
            mesh = mi.Mesh(f"object-{i}", len(points), len(faces), props=properties)
            corners = (R @ thing.center + t + thing.radius * points) * UNIT
            numbers = mi.traverse(mesh)
            numbers["vertex_positions"] = corners.astype(np.float32).ravel()
            numbers["faces"] = faces.ravel()
            numbers.update()
            made[i] = mesh
    return made


def icosphere(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """An icosahedron whose triangles are split in four `levels` times: unit points (n, 3), faces (20 · 4^levels, 3)."""
    g = (1 + 5**0.5) / 2
    points = np.array([(0, s, t * g) for s in (-1, 1) for t in (-1, 1)], float)
    points = np.concatenate([np.roll(points, k, axis=1) for k in range(3)])
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    near = np.isclose(apart, 2)  # the edges of this icosahedron
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]]
    )
    points /= np.linalg.norm(points[0])
    for _ in range(levels):
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        unique, where = np.unique(edges, axis=0, return_inverse=True)
        middle = points[unique].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ab, bc, ca = where.reshape(3, -1) + len(points)
        a, b, c = faces.T
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        points = np.concatenate([points, middle])
    inwards = (np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
               * points[faces[:, 0]]).sum(axis=1) < 0  # fmt: skip
    faces[inwards] = faces[inwards][:, ::-1]
    return points, faces.astype(np.uint32)


def _numbers(camera: Camera) -> tuple[float, float, float, float, int]:
    return camera.fx, camera.fy, camera.cx, camera.cy, max(lens_of(camera).steps, 0)


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
            k = tuple(dr.opaque(double, props[f"k{i}"]) for i in range(5))
            self.lens = Lens(*(dr.opaque(double, props[n]) for n in ("fx", "fy", "cx", "cy")), k, int(props["steps"]))

        def sample_ray(self, time, wavelength_sample, position_sample, aperture_sample, active=True):
            double, size = dr.float64_array_t(mi.Float), self.film().crop_size()
            # The position is (0, 0) at the image's corner; pixel 0's centre is at 1/2.
            u = double(position_sample.x) * int(size[0]) - 0.5
            v = double(position_sample.y) * int(size[1]) - 0.5
            d = mi.Vector3f(*map(mi.Float, directions(dr, self.lens, u, v)))
            ray = mi.Ray3f(mi.Point3f(0), d)
            wavelengths, weight = self.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), wavelength_sample, active)
            ray.wavelengths = wavelengths
            return ray, weight

        def sample_ray_differential(self, time, wavelength_sample, position_sample, aperture_sample, active=True):
            ray, weight = self.sample_ray(time, wavelength_sample, position_sample, aperture_sample, active)
            return mi.RayDifferential3f(ray), weight

        def to_string(self) -> str:
            return "RaytwinLens[]"

    mi.register_sensor("raytwin_lens", RaytwinLens)
