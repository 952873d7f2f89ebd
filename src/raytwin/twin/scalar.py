"""The twin on Mitsuba's `scalar_rgb`, which runs on any machine: the same rays, one at a time.

Slow (a few microseconds a ray) and as exact as the compiled variants, distorted cameras included: what C++ does here is
Mitsuba's hit test, shadow test and path tracer; rays before them and shading after them are NumPy in float64.
"""

from collections.abc import Mapping
from math import inf, pi
from typing import Any

import mitsuba as mi
import numpy as np

from raytwin.scene import Scene
from raytwin.twin.rays import directions, lens_of
from raytwin.twin.world import SHADOW_OFFSET, UNIT, load, translate


class Renderer:
    """One scene, loaded. Pixels are numbered row by row; every result is for the pixels [first, first + count)."""

    lanes = 1 << 16
    """How many rays to take at once: the progress shows in these steps."""

    def __init__(
        self,
        scene: Scene,
        textures: Mapping[int, np.ndarray],
        integrator: dict[str, Any] | None,
    ) -> None:
        self.scene = load(translate(scene, textures))
        self.integrator = mi.load_dict(integrator) if integrator else None
        self.lens, self.width = lens_of(scene.camera), scene.camera.width
        self.R = np.asarray(scene.camera.R_cam_board)
        self.to_light = self.R @ scene.sun.to_light
        self.irradiance, self.sky = np.asarray(scene.sun.irradiance), np.asarray(scene.sky.radiance)
        self.albedo = np.array([*(thing.material.albedo for thing in scene.objects), (0, 0, 0)])
        self.textured = sorted(textures)
        self.ids = {shape: int(shape.id()[7:]) for shape in self.scene.shapes()}

    def exact(self, first: int, count: int, rung: str) -> tuple[np.ndarray, ...]:
        """Radiance (n, 3), id (n,), depth (n,) in metres, normal (n, 3) in the board frame, through pixel centres."""
        ids, t, n, p, albedo, _ = self._hit(np.arange(first, first + count), 0.0)
        colour = np.zeros((count, 3))
        if rung != "surface":
            colour = self._first_light(ids, t, n, p, albedo, rung == "shadow", True)
        return colour, ids, t / UNIT, n @ self.R

    def sampled(self, first: int, count: int, rung: str, area: bool, samples: int, seed: int) -> np.ndarray:
        """The mean (n, 3) of `samples` independent estimates per pixel."""
        pixel = np.repeat(np.arange(first, first + count), samples)
        rng = np.random.default_rng(seed)
        jitter = rng.random((2, len(pixel))) - 0.5 if area else 0.0
        ids, t, n, p, albedo, hits = self._hit(pixel, jitter)
        colour = self._first_light(ids, t, n, p, albedo, rung != "lambert", self.integrator is None)
        if self.integrator is not None:
            colour += self._bounce(hits, seed)
        return colour.reshape(count, samples, 3).mean(axis=1)

    def _hit(self, pixel: np.ndarray, jitter: Any) -> tuple[Any, ...]:
        du, dv = jitter if np.ndim(jitter) else (0.0, 0.0)
        d = np.stack(directions(np, self.lens, pixel % self.width + du, pixel // self.width + dv), axis=1)
        ids, t, n = np.full(len(d), -1, np.int32), np.zeros(len(d)), np.zeros((len(d), 3))
        hits: list[Any] = [None] * len(d)
        intersect, Ray, eye, known = self.scene.ray_intersect, mi.Ray3f, mi.Point3f(0), self.ids
        where, found_ids, found_t, found_n = [], [], [], []
        for i, direction in enumerate(d.astype(np.float32).tolist()):
            si = intersect(Ray(eye, direction))
            if (distance := si.t) < inf:
                hits[i] = si
                where.append(i)
                found_ids.append(known[si.shape])
                found_t.append(distance)
                found_n.append(list(si.n))
        if where:
            ids[where], t[where], n[where] = found_ids, found_t, found_n
        n[(n * d).sum(axis=1) > 0] *= -1
        albedo = self.albedo[ids]
        for i in np.flatnonzero(np.isin(ids, self.textured)):
            albedo[i] = list(hits[i].bsdf().eval_diffuse_reflectance(hits[i]))
        return ids, t, n, d * t[:, None], albedo, hits

    def _first_light(self, ids, t, n, p, albedo, shadows: bool, sky_at_hit: bool) -> np.ndarray:
        """albedo/π E V max(0, n·l) (+ albedo Ls) where something is hit, Ls elsewhere."""
        cosine = np.maximum(n @ self.to_light, 0)
        if shadows:
            lit = np.flatnonzero(cosine > 0)
            start = (p[lit] + n[lit] * (SHADOW_OFFSET * t[lit, None])).tolist()
            test, Ray, sun = self.scene.ray_test, mi.Ray3f, mi.Vector3f(self.to_light.tolist())
            cosine[lit[[test(Ray(o, sun)) for o in start]]] = 0
        colour = albedo / pi * self.irradiance * cosine[:, None]
        if sky_at_hit:
            colour += albedo * self.sky
        colour[ids < 0] = self.sky
        return colour

    def _bounce(self, hits: list[Any], seed: int) -> np.ndarray:
        """albedo times the radiance that Mitsuba's integrator finds in one cosine-distributed direction."""
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed)
        context, path, Onward = mi.BSDFContext(), self.integrator.sample, mi.RayDifferential3f
        colour = np.zeros((len(hits), 3))
        for i, si in enumerate(hits):
            if si is not None:
                bounce, weight = si.bsdf().sample(context, si, sampler.next_1d(), sampler.next_2d())
                onward = Onward(si.spawn_ray(si.to_world(bounce.wo)))
                colour[i] = list(weight * path(self.scene, sampler, onward)[0])
        return colour
