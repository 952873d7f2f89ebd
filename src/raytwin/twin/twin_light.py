"""The light levels in Mitsuba: its intersector, emitters, shadow test, BSDFs and path tracer behind our own rays."""

from collections.abc import Callable, Mapping
from math import pi
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from raytwin.rungs import Rung
from raytwin.scene import Scene
from raytwin.twin.rays import Lens, directions, lens_of
from raytwin.twin.twin_scene import SHADOW_OFFSET, SPHERE_OFFSET, load, number_of, place_of, translate

LANES = 1 << 22
"""How many rays to launch at once: enough to fill any machine, 50 MB an array of three floats."""

SKY_GRID = 2048, 1024
"""Directions, around and down, by which a map's light is summed: a map of one radiance comes out within 1e-5."""


class Seen(NamedTuple):
    """What rays meet: `hit`, Mitsuba's record; `n`, the normal on the eye's side; `start`, where rays go on."""

    ray: Any
    hit: Any
    n: Any
    start: Any

    @property
    def any(self) -> Any:
        return self.hit.is_valid()


class TwinLight:
    """One scene, loaded. Pixels are numbered row by row. `depth`: the longest light path, counted as Mitsuba does."""

    def __init__(self, scene: Scene, textures: Mapping[int, np.ndarray], depth: int | None) -> None:
        self.place, self.double = place_of(scene), dr.float64_array_t(mi.Float)
        self.scene = load(translate(scene, self.place, textures))
        self.numbers = numbers_of(self.scene, number_of)
        self.sun = next((e for e in self.scene.emitters() if not e.is_environment()), None)
        self.sky = self.scene.environment()
        self.path: Any = load({"type": "path", "max_depth": depth - 1, "rr_depth": depth}) if depth else None
        # Opaque numbers are a kernel's parameters: another camera runs the kernel that is compiled already.
        lens = lens_of(scene.camera)
        fx, fy, cx, cy, coefficients = map(self._number, lens[:5])
        self.lens = Lens(fx, fy, cx, cy, coefficients, lens.steps)
        self.width, self.start = scene.camera.width, self._number(self.place.start)
        self.eye, self.R = self._number(self.place.eye), self._number(np.asarray(scene.camera.R_cam_board).T)
        largest = max((ball.radius for ball in scene.spheres), default=0.0)
        self.offset = dr.opaque(mi.Float, SPHERE_OFFSET * self.place.unit * largest)
        self.irradiance: Any = None
        if depth is None:
            self.irradiance = open_sky(self.sky) if scene.environment else lambda n: mi.Color3f(*scene.sky.radiance)

    def _number(self, x: Any) -> Any:
        """A float64 parameter of the kernel, or nested tuples of them."""
        return dr.opaque(self.double, float(x)) if np.ndim(x) == 0 else tuple(map(self._number, x))

    def hit_of(self, pixel: Any, du: Any = 0.0, dv: Any = 0.0) -> Seen:
        """What the rays through the pixels, moved by (du, dv), meet first."""
        width = dr.opaque(mi.UInt32, self.width)
        row = pixel // width
        u, v = self.double(pixel - row * width) + self.double(du), self.double(row) + self.double(dv)
        ahead = directions(dr, self.lens, u, v)
        d = [sum(self.R[i][k] * ahead[k] for k in range(3)) for i in range(3)]
        o = [mi.Float(self.eye[i] + self.start * d[i]) for i in range(3)]
        ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*map(mi.Float, d))))
        hit = self.scene.ray_intersect(ray)
        n = dr.select(dr.dot(hit.n, ray.d) > 0, -hit.n, hit.n)
        return Seen(ray, hit, n, hit.p + n * (SHADOW_OFFSET * dr.norm(hit.p) + self.offset))

    def surface(self, seen: Seen) -> tuple[Any, Any, Any]:
        """Ids, depth in metres and normals, in the board's frame."""
        depth = (self.double(seen.hit.t) + self.start) / self.place.unit
        ids = dr.gather(mi.Int32, self.numbers, dr.reinterpret_array(mi.UInt32, seen.hit.shape), seen.any)
        return dr.select(seen.any, ids, -1), mi.Float(dr.select(seen.any, depth, 0)), dr.select(seen.any, seen.n, 0)

    def unsampled(self, rung: Rung, seen: Seen) -> Any:
        """The light without noise: the sun's at what is seen, the open sky's, and the sky behind all objects."""
        bsdf, context, colour = seen.hit.bsdf(seen.ray), mi.BSDFContext(), mi.Color3f(0)
        if self.sun is not None:
            there, weight = self.sun.sample_direction(seen.hit, mi.Point2f(0.5), seen.any)
            lit = seen.any & (dr.dot(seen.n, there.d) > 0)
            if rung.shadows:
                lit &= ~self.scene.ray_test(mi.Ray3f(seen.start, there.d), lit)
            value = bsdf.eval(context, seen.hit, seen.hit.to_local(there.d), lit)
            colour += dr.select(lit, value * weight, 0)
        if self.irradiance is not None:
            colour += bsdf.eval_diffuse_reflectance(seen.hit, seen.any) * self.irradiance(seen.n)
        background = mi.Color3f(0) if self.sky is None else self.sky.eval(seen.hit, ~seen.any)
        return dr.select(seen.any, colour, background)

    def bounced(self, seen: Seen, sampler: Any) -> Any:
        """What one direction, drawn by the BSDF, brings of all other light, as Mitsuba's `path` finds it."""
        bsdf = seen.hit.bsdf(seen.ray)
        sample, weight = bsdf.sample(mi.BSDFContext(), seen.hit, sampler.next_1d(), sampler.next_2d(), seen.any)
        onward = mi.Ray3f(seen.start, seen.hit.to_world(sample.wo))
        light = self.path.sample(self.scene, sampler, mi.RayDifferential3f(onward), None, seen.any)[0]
        return dr.select(seen.any, weight * light, 0)


def numbers_of(loaded: Any, number: Callable[[str], int]) -> Any:
    """A table from Mitsuba's shape pointers, which are small integers, to the `number` of each shape's name."""
    keys = dr.reinterpret_array(mi.UInt32, loaded.shapes_dr()).numpy()
    table = np.full(keys.max(initial=0) + 1, -1, np.int32)
    table[keys] = [number(shape.id()) for shape in loaded.shapes()]
    return mi.Int32(table)


def open_sky(sky: Any) -> Any:
    """Return n -> E(n)/π, the radiance of a constant sky of the same light, to the second order of a map's harmonics.

    The cosine's coefficients are π, 2π/3, π/4 (Ramamoorthi and Hanrahan 2001, eq. 8), and the harmonics of one order
    sum to (2 l + 1)/4π P_l(n·ω). So E/π = ∫ L (1/4π + n·ω/2π + 5 (3 (n·ω)² - 1)/32π) dω: three moments of L.
    """
    around, down = SKY_GRID
    index = dr.arange(mi.UInt32, around * down)
    z = 1 - (2 * mi.Float(index // around) + 1) / down  # even steps of z and of the angle: equal solid angles
    turn = (mi.Float(index % around) + 0.5) * (2 * pi / around)
    level = dr.sqrt(1 - z * z)
    w = mi.Vector3f(level * dr.cos(turn), level * dr.sin(turn), z)
    hit = dr.zeros(mi.SurfaceInteraction3f, around * down)
    hit.wi = -w
    light = np.asarray(sky.eval(hit).numpy(), float).reshape(3, -1) * (4 * pi / (around * down))
    d = np.asarray(w.numpy(), float)
    total, first = light.sum(axis=1), light @ d.T
    second = np.einsum("cn,in,jn->cij", light, d, d, optimize=True)
    even, slope, bend = 3 / (32 * pi) * total, first / (2 * pi), 15 / (32 * pi) * second

    def irradiance(n: Any) -> Any:
        return mi.Color3f(*(
            dr.maximum(
                float(even[c]) + sum(n[i] * (float(slope[c, i]) + sum(float(bend[c, i, j]) * n[j] for j in range(3)))
                                     for i in range(3)), 0)
            for c in range(3)
        ))  # fmt: skip

    return irradiance
