"""The twin on Mitsuba's compiled variants, `llvm_ad_rgb` and `cuda_ad_rgb`: one kernel for all pixels and samples."""

from collections.abc import Mapping
from math import pi
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from raytwin.scene import Scene
from raytwin.twin.rays import Lens, directions, lens_of
from raytwin.twin.world import SHADOW_OFFSET, UNIT, load, translate


class Renderer:
    """One scene, loaded. Pixels are numbered row by row; every result is for the pixels [first, first + count)."""

    lanes = 1 << 22
    """How many rays to launch at once: enough to fill any machine, 50 MB an array of three floats."""

    def __init__(
        self,
        scene: Scene,
        textures: Mapping[int, np.ndarray],
        integrator: dict[str, Any] | None,
    ) -> None:
        self.scene = load(translate(scene, textures))
        self.integrator = mi.load_dict(integrator) if integrator else None
        # Opaque numbers are a kernel's parameters: another camera or light runs the kernel that is compiled already.
        double = dr.float64_array_t(mi.Float)
        fx, fy, cx, cy, coefficients, steps = lens_of(scene.camera)
        numbers = [dr.opaque(double, a) for a in (fx, fy, cx, cy, *coefficients)]
        self.lens = Lens(*numbers[:4], tuple(numbers[4:]), steps)
        R = np.asarray(scene.camera.R_cam_board)
        self.to_light = mi.Vector3f((R @ scene.sun.to_light).tolist())
        self.irradiance, self.sky = mi.Color3f(scene.sun.irradiance), mi.Color3f(scene.sky.radiance)
        dr.make_opaque(self.to_light, self.irradiance, self.sky)
        self.width, self.R = scene.camera.width, R
        # Mitsuba's shape pointers are small integers: a table takes them to our ids.
        names = {dr.reinterpret_array(mi.UInt32, mi.ShapePtr(s))[0]: int(s.id()[7:]) for s in self.scene.shapes()}
        table = np.full(max(names, default=0) + 1, -1, np.int32)
        table[list(names)] = list(names.values())
        self.ids = mi.Int32(table)

    def exact(self, first: int, count: int, rung: str) -> tuple[np.ndarray, ...]:
        """Radiance (n, 3), id (n,), depth (n,) in metres, normal (n, 3) in the board frame, through pixel centres."""
        si, n = self._hit(*self._pixels(dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, first), 0.0, 0.0))
        seen = si.is_valid()
        ids = dr.gather(mi.Int32, self.ids, dr.reinterpret_array(mi.UInt32, si.shape), seen)
        ids = dr.select(seen, ids, -1)
        depth, n = dr.select(seen, si.t / UNIT, 0), dr.select(seen, n, 0)
        colour = mi.Color3f(0) if rung == "surface" else self._first_light(si, n, rung == "shadow")
        dr.eval(colour, ids, depth, n)
        return colour.numpy().T, ids.numpy(), depth.numpy(), n.numpy().T @ self.R.astype(np.float32)

    def sampled(self, first: int, count: int, rung: str, area: bool, samples: int, seed: int) -> np.ndarray:
        """The mean (n, 3) of `samples` independent estimates per pixel."""
        width = count * samples
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(dr.opaque(mi.UInt32, seed), width)
        pixel = dr.arange(mi.UInt32, width) // dr.opaque(mi.UInt32, samples) + dr.opaque(mi.UInt32, first)
        jitter = sampler.next_2d() - 0.5 if area else mi.Point2f(0)
        si, n = self._hit(*self._pixels(pixel, jitter.x, jitter.y))
        colour = self._first_light(si, n, rung != "lambert", sky_at_hit=self.integrator is None)
        if self.integrator is not None:
            seen = si.is_valid()
            bounce, weight = si.bsdf().sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), seen)
            onward = mi.RayDifferential3f(si.spawn_ray(si.to_world(bounce.wo)))
            incoming = self.integrator.sample(self.scene, sampler, onward, active=seen)[0]
            colour += dr.select(seen, weight * incoming, 0)
        dr.eval(colour)  # all channels in one kernel: block_sum would run it once for each
        return np.stack([dr.block_sum(c, samples).numpy() for c in colour], axis=1) / samples

    def _pixels(self, pixel: Any, du: Any, dv: Any) -> tuple[Any, Any]:
        double, width = dr.float64_array_t(mi.Float), dr.opaque(mi.UInt32, self.width)
        row = pixel // width
        return double(pixel - row * width) + double(du), double(row) + double(dv)

    def _hit(self, u: Any, v: Any) -> tuple[Any, Any]:
        """What the rays through (u, v) meet first, and its normal on the eye's side."""
        d = mi.Vector3f(*map(mi.Float, directions(dr, self.lens, u, v)))
        si = self.scene.ray_intersect(mi.Ray3f(mi.Point3f(0), d))
        return si, dr.select(dr.dot(si.n, d) > 0, -si.n, si.n)

    def _first_light(self, si: Any, n: Any, shadows: bool, sky_at_hit: bool = True) -> Any:
        """albedo/π E V max(0, n·l) (+ albedo Ls) where something is hit, Ls elsewhere."""
        seen = si.is_valid()
        albedo = si.bsdf().eval_diffuse_reflectance(si, seen)
        cosine = dr.maximum(dr.dot(n, self.to_light), 0)
        if shadows:
            ray = mi.Ray3f(dr.fma(n, SHADOW_OFFSET * si.t, si.p), self.to_light)
            cosine = dr.select(self.scene.ray_test(ray, seen & (cosine > 0)), 0, cosine)
        colour = albedo * (self.irradiance * (cosine / pi))
        if sky_at_hit:
            colour += albedo * self.sky
        return dr.select(seen, colour, self.sky)
