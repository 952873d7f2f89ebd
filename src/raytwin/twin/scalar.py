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
from raytwin.twin.batches import Batches
from raytwin.twin.bodies import beyond_floats, distance, normal, offsets, table
from raytwin.twin.direct_light import albedos, first_light, sunlight
from raytwin.twin.outlines import Seen
from raytwin.twin.phong import pi_f
from raytwin.twin.rays import Hit, directions, lens_of
from raytwin.twin.sky import sky_of
from raytwin.twin.twin_scene import SHADOW_OFFSET, UNIT, load, translate


class Renderer:
    """One scene, loaded. Pixels are numbered row by row; every result is for the pixels [first, first + count).

    `depth`: the longest light path, counted as Mitsuba does; 0 if light is not followed.
    """

    lanes = 1 << 16
    """How many rays to take at once: the progress shows in these steps."""

    def __init__(self, scene: Scene, textures: Mapping[int, np.ndarray], depth: int) -> None:
        bodies = table(scene)
        self.large = {i: bodies.at(i) for i in beyond_floats(bodies) if i not in textures}
        self.offsets = np.full(len(scene.objects) + 1, SHADOW_OFFSET)  # the last: of no object
        self.offsets[list(self.large)] = offsets(bodies)[list(self.large)]
        self.scene, self.depth = load(translate(scene, textures, self.large)), depth
        self.path: Any = load({"type": "path", "max_depth": depth - 1, "rr_depth": depth}) if depth else None
        self.lens, self.width = lens_of(scene.camera), scene.camera.width
        self.R = np.asarray(scene.camera.R_cam_board)
        self.to_light = self.R @ scene.sun.to_light
        self.record, self.albedo = scene, albedos(scene)
        self.textured = sorted(textures)
        # Float32 inverts a narrow rectangle's matrix badly; 0 for spheres, and at the end for no object.
        self.normals = np.concatenate([bodies.n.T, np.zeros((1, 3))])
        self.ids = {shape: int(shape.id()[7:]) for shape in self.scene.shapes()}

    def exact(self, first: int, count: int, shadows: bool, sky_at_hit: bool) -> tuple[np.ndarray, ...]:
        """Through the pixels' centres: radiance of the first light (n, 3), then `Seen`'s four; where light is followed
        further, albedo (n, 3).
        """
        hit = self._look(np.arange(first, first + count), 0.0, 0.0)
        blocker = self._blocker(hit) if shadows else np.full(count, -1)
        colour = self._first_light(hit, blocker, sky_at_hit)
        albedo = [hit.albedo] if self.depth else []
        return colour, hit.ids, hit.t / UNIT, hit.n @ self.R, blocker, *albedo

    def sampled(self, first: int, count: int, batches: Batches, seed: int, shadows: bool) -> tuple[np.ndarray, ...]:
        """Radiance by rays spread over the pixel: mean and spread (n, 3), see `Batches`."""
        pixel, rng = np.repeat(np.arange(first, first + count), batches.lanes), np.random.default_rng(seed)
        hit = self._look(pixel, *(rng.random((2, len(pixel))) - 0.5))
        blocker = self._blocker(hit) if shadows else np.full(len(pixel), -1)
        colour = self._first_light(hit, blocker, sky_at_hit=not self.depth)
        if self.depth:
            colour += self._incoming(hit, rng)
        return batches.gathered(colour)

    def bounced(
        self, first: int, count: int, batches: Batches, seed: int, seen: Seen, albedo: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Return the cosine-weighted radiance that reaches what these pixels' centres see, `seen`: mean and spread.

        In a scene with highlights it is multiplied by π f, which is `albedo` for a surface that has no highlight.
        """
        pixel = np.repeat(np.arange(first, first + count), batches.lanes)
        found = (seen.ids, seen.depth * UNIT, seen.normal @ self.R.T)
        ids, t, n = (np.repeat(x, batches.lanes, axis=0) for x in found)
        d = self._directions(pixel, 0.0, 0.0)
        rho = np.repeat(albedo, batches.lanes, axis=0) if self.record.glossy else np.ones((len(ids), 3))
        for i, body in self.large.items():  # float32's depth may be too coarse
            t = np.where(ids == i, distance(np, body, np.zeros((3, 1)), d.T), t)
        hit = Hit(ids, t, n, self._start(d * t[:, None], n, ids), rho, d)
        return batches.gathered(self._incoming(hit, np.random.default_rng(seed)))

    def _directions(self, pixel: np.ndarray, du: Any, dv: Any) -> np.ndarray:
        return np.stack(directions(np, self.lens, pixel % self.width + du, pixel // self.width + dv), axis=1)

    def _look(self, pixel: np.ndarray, du: Any, dv: Any) -> Hit:
        return self._nearest(np.zeros((len(pixel), 3)), self._directions(pixel, du, dv), np.full(len(pixel), True))

    def _nearest(self, o: np.ndarray, d: np.ndarray, active: np.ndarray) -> Hit:
        """What the rays from o along d, (n, 3), meet first."""
        ids, t, n, albedo = (
            np.full(len(d), -1, np.int32),
            np.zeros(len(d)),
            np.zeros((len(d), 3)),
            np.zeros((len(d), 3)),
        )
        meet, Ray, known, textured = self.scene.ray_intersect, mi.Ray3f, self.ids, self.textured
        where, found = [], []
        lanes = np.flatnonzero(active)
        for i, start, direction in zip(lanes.tolist(), o[lanes].tolist(), d[lanes].tolist(), strict=True):
            si = meet(Ray(start, direction))
            if (far := si.t) < inf:
                which = known[si.shape]
                where.append(i)
                found.append((which, far, *si.n))
                if which in textured:
                    albedo[i] = list(si.bsdf().eval_diffuse_reflectance(si))
        if where:
            columns = np.array(found)
            ids[where], t[where], n[where] = columns[:, 0].astype(np.int32), columns[:, 1], columns[:, 2:]
            flat = (ids >= 0) & self.normals[ids].any(axis=1)
            n[flat] = self.normals[ids[flat]]
        for i, body in self.large.items():
            here = distance(np, body, o.T, d.T)
            closer = active & (here < np.where(ids < 0, inf, t))
            ids[closer], t[closer] = i, here[closer]
            n[closer] = np.stack(normal(body, (o[closer] + here[closer, None] * d[closer]).T), axis=-1)
        n[(n * d).sum(axis=1) > 0] *= -1
        plain = ~np.isin(ids, textured)
        albedo[plain] = self.albedo[ids[plain]]
        return Hit(ids, t, n, self._start(o + d * t[:, None], n, ids), albedo, d)

    def _start(self, p: np.ndarray, n: np.ndarray, ids: np.ndarray) -> np.ndarray:
        return np.asarray(p + n * (self.offsets[ids] * np.linalg.norm(p, axis=1))[:, None])

    def _blocker(self, hit: Hit) -> np.ndarray:
        """The id of what hides the sun, -1 where nothing does or the surface is turned away from it."""
        facing = (hit.ids >= 0) & (hit.n @ self.to_light > 0)
        blocker, lanes = np.full(len(facing), -1, np.int32), np.flatnonzero(facing)
        meet, Ray, sun = self.scene.ray_intersect_preliminary, mi.Ray3f, mi.Vector3f(self.to_light.tolist())
        for i, start in zip(lanes.tolist(), hit.start[lanes].tolist(), strict=True):
            if (met := meet(Ray(start, sun))).is_valid():
                blocker[i] = self.ids[met.shape]
        for i, body in self.large.items():
            blocker[facing & (distance(np, body, hit.start.T, self.to_light) < inf)] = i
        return blocker

    def _first_light(self, hit: Hit, blocker: np.ndarray, sky_at_hit: bool) -> np.ndarray:
        return first_light(self.record, hit.ids, hit.albedo, hit.n @ self.R, hit.d @ self.R, blocker, sky_at_hit)

    def _pi_f(self, hit: Hit, to_light: np.ndarray) -> np.ndarray:
        return pi_f(self.record, hit.ids, hit.albedo, hit.n, hit.d, to_light)

    def _incoming(self, hit: Hit, rng: np.random.Generator) -> np.ndarray:
        """π f times the radiance from a cosine-distributed direction, as Mitsuba's `path` finds it; 0 without a hit."""
        d = _cosine(hit.n, rng)
        weight = self._pi_f(hit, d)
        if self.large:
            return weight * self._walk(hit, rng, d)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(int(rng.integers(1 << 32)))
        path, Ray, Onward = self.path.sample, mi.Ray3f, mi.RayDifferential3f
        colour, lanes = np.zeros((len(d), 3)), np.flatnonzero(hit.ids >= 0)
        for i, start, direction in zip(lanes.tolist(), hit.start[lanes].tolist(), d[lanes].tolist(), strict=True):
            colour[i] = list(path(self.scene, sampler, Onward(Ray(start, direction)))[0])
        return weight * colour

    def _walk(self, hit: Hit, rng: np.random.Generator, d: np.ndarray) -> np.ndarray:
        """What Mitsuba's `path` would find along d, where the scene has an object too large for it."""
        active = hit.ids >= 0
        total, weight = np.zeros((len(d), 3)), np.ones((len(d), 3))
        for left in reversed(range(self.depth - 1)):
            hit = self._nearest(hit.start, d, active)
            missed = active & (hit.ids < 0)
            total[missed] += weight[missed] * sky_of(self.record).radiance(d[missed] @ self.R)
            active &= hit.ids >= 0
            if left:
                sun = self._pi_f(hit, self.to_light) * sunlight(self.record, hit.n @ self.R, self._blocker(hit))
                total += weight * sun * active[:, None]
                d = _cosine(hit.n, rng)
                weight *= self._pi_f(hit, d)
        return total


def _cosine(n: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Directions about the normals n, with density cos / π: a point of the unit sphere about n's tip, made unit."""
    z, turn = rng.random(len(n)) * 2 - 1, rng.random(len(n)) * 2 * pi
    ring = np.sqrt(1 - z * z)
    d = n + np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    return np.asarray(d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-300))
