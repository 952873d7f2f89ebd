"""The twin on Mitsuba's compiled variants, `llvm_ad_rgb` and `cuda_ad_rgb`: one kernel for all pixels and samples."""

from collections.abc import Mapping
from math import pi
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from raytwin.scene import Scene
from raytwin.twin.batches import Batches
from raytwin.twin.bodies import Body, beyond_floats, distance, dot, normal, offsets, table
from raytwin.twin.outlines import Seen
from raytwin.twin.phong import highlights, lobe
from raytwin.twin.rays import Hit, Lens, directions, lens_of
from raytwin.twin.sky import harmonics
from raytwin.twin.twin_scene import SHADOW_OFFSET, UNIT, load, translate


class Renderer:
    """One scene, loaded. Pixels are numbered row by row; every result is for the pixels [first, first + count).

    `depth`: the longest light path, counted as Mitsuba does; 0 if light is not followed.
    """

    lanes = 1 << 22
    """How many rays to launch at once: enough to fill any machine, 50 MB an array of three floats."""

    def __init__(self, scene: Scene, textures: Mapping[int, np.ndarray], depth: int) -> None:
        self.double, bodies = dr.float64_array_t(mi.Float), table(scene)
        large = [i for i in beyond_floats(bodies) if i not in textures]
        self.scene, self.depth = load(translate(scene, textures, large)), depth
        self.path: Any = load({"type": "path", "max_depth": depth - 1, "rr_depth": depth}) if depth else None
        # Opaque numbers are a kernel's parameters: another camera or light runs the kernel that is compiled already.
        lens = lens_of(scene.camera)
        fx, fy, cx, cy, coefficients = (self._number(field) for field in lens[:5])
        self.lens = Lens(fx, fy, cx, cy, coefficients, lens.steps)
        self.large = {i: Body(body.round, *(self._number(field) for field in body[1:]))
                      for i, body in ((i, bodies.at(i)) for i in large)}  # fmt: skip
        self.offsets = {i: self._number(x) for i, x in enumerate(offsets(bodies)) if i in large}
        self.width, self.R = scene.camera.width, np.asarray(scene.camera.R_cam_board)
        self.to_light = mi.Vector3f((self.R @ scene.sun.to_light).tolist())
        self.toward_sun = self._number(self.R @ scene.sun.to_light)
        self.irradiance = _colour(scene.sun.irradiance)
        self.environment = self.scene.environment() if scene.environment else None
        self.sky = None if scene.environment else _colour(scene.sky.radiance)
        M = harmonics(scene.environment, self.R).tolist() if scene.environment else []
        self.harmonics = [[[dr.opaque(mi.Float, x) for x in row] for row in channel] for channel in M]
        gloss: Any = np.roll(highlights(scene), 1, axis=0).T if scene.glossy else []  # id -1 first
        self.gloss = [mi.Float(np.ascontiguousarray(column, np.float32)) for column in gloss]
        self.albedo = {i: _colour(scene.objects[i].material.albedo) for i in large}
        dr.make_opaque(self.to_light, self.irradiance, self.sky, self.albedo)
        # Mitsuba's shape pointers are small integers: a table takes them to our ids.
        names = {dr.reinterpret_array(mi.UInt32, mi.ShapePtr(s))[0]: int(s.id()[7:]) for s in self.scene.shapes()}
        numbers = np.full(max(names, default=0) + 1, -1, np.int32)
        numbers[list(names)] = list(names.values())
        self.ids = mi.Int32(numbers)
        # Float32 inverts a narrow rectangle's matrix badly: half edges of 0.01 and 0.5 m turn its normal by 2e-5.
        n = np.concatenate([np.zeros((3, 1)), bodies.n], axis=1)  # id -1 first; 0 where it is no rectangle's
        self.normals = [mi.Float(np.ascontiguousarray(x, np.float32)) for x in n] if n.any() else None

    def _number(self, x: Any) -> Any:
        """A float64 parameter of the kernel, or three of them."""
        return dr.opaque(self.double, float(x)) if np.ndim(x) == 0 else tuple(map(self._number, x))

    def exact(self, first: int, count: int, shadows: bool, sky_at_hit: bool) -> tuple[np.ndarray, ...]:
        """Through the pixels' centres: radiance of the first light (n, 3), then `Seen`'s four; where light is followed
        further, albedo (n, 3).
        """
        hit = self._look(dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, first), 0.0, 0.0)
        blocker = self._blocker(hit) if shadows else dr.full(mi.Int32, -1, count)
        colour = self._first_light(hit, blocker, sky_at_hit)
        depth, n = mi.Float(hit.t / UNIT), dr.select(hit.seen, hit.n, 0)
        albedo = [hit.albedo] if self.depth else []
        dr.eval(colour, hit.ids, depth, n, blocker, *albedo)
        n = n.numpy().T @ self.R.astype(np.float32)
        return colour.numpy().T, hit.ids.numpy(), depth.numpy(), n, blocker.numpy(), *(a.numpy().T for a in albedo)

    def sampled(self, first: int, count: int, batches: Batches, seed: int, shadows: bool) -> tuple[np.ndarray, ...]:
        """Radiance by rays spread over the pixel: mean and spread (n, 3), see `Batches`."""
        pixel, sampler = self._lanes(first, count, batches, seed)
        du, dv = sampler.next_2d() - 0.5
        hit = self._look(pixel, du, dv)
        blocker = self._blocker(hit) if shadows else mi.Int32(-1)
        colour = self._first_light(hit, blocker, sky_at_hit=not self.depth)
        if self.depth:
            colour += dr.select(hit.seen, self._incoming(hit, sampler), 0)
        return _gathered(colour, batches)

    def bounced(
        self, first: int, count: int, batches: Batches, seed: int, seen: Seen, albedo: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Return the cosine-weighted radiance that reaches what these pixels' centres see, `seen`: mean and spread.

        In a scene with highlights it is multiplied by π f, which is `albedo` for a surface that has no highlight.
        """
        pixel, sampler = self._lanes(first, count, batches, seed)
        mine = pixel - dr.opaque(mi.UInt32, first)
        ids = dr.gather(mi.Int32, mi.Int32(seen.ids), mine)
        t = dr.gather(mi.Float, mi.Float(seen.depth * np.float32(UNIT)), mine)
        n = dr.gather(mi.Normal3f, mi.Normal3f(np.ascontiguousarray((seen.normal @ self.R.T).T, np.float32)), mine)
        d = self._directions(pixel, 0.0, 0.0)
        reach = self.double(t)  # rounded to float32: where that is too coarse, again
        for i, body in self.large.items():
            reach = dr.select(ids == i, distance(dr, body, (self.double(0),) * 3, d), reach)
        start = self._start(tuple(x * reach for x in d), n, ids)
        rho = dr.gather(mi.Color3f, mi.Color3f(np.ascontiguousarray(albedo.T)), mine) if self.gloss else mi.Color3f(1)
        hit = Hit(ids, t, n, start, rho, mi.Vector3f(*map(mi.Float, d)))
        return _gathered(dr.select(hit.seen, self._incoming(hit, sampler), 0), batches)

    def _lanes(self, first: int, count: int, batches: Batches, seed: int) -> tuple[Any, Any]:
        """The pixel of each lane, a pixel's batches side by side, and a seeded sampler for them all."""
        lanes = count * batches.lanes
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(dr.opaque(mi.UInt32, seed), lanes)
        pixel = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, batches.lanes) + dr.opaque(mi.UInt32, first)
        return pixel, sampler

    def _directions(self, pixel: Any, du: Any, dv: Any) -> tuple[Any, Any, Any]:
        """Unit, in float64, through the pixel moved by (du, dv)."""
        width = dr.opaque(mi.UInt32, self.width)
        row = pixel // width
        u, v = self.double(pixel - row * width) + self.double(du), self.double(row) + self.double(dv)
        return directions(dr, self.lens, u, v)

    def _unit(self, d: Any) -> tuple[Any, ...]:
        """d made unit in float64: its rounding to float32 would put points that far off a surface."""
        wide = tuple(map(self.double, d))
        scale = dr.rsqrt(dot(wide, wide))
        return tuple(x * scale for x in wide)

    def _look(self, pixel: Any, du: Any, dv: Any) -> Hit:
        return self._nearest((self.double(0),) * 3, self._directions(pixel, du, dv))

    def _nearest(self, o: Any, d: Any, active: Any = True) -> Hit:
        """What the rays from o along d, float64 components, meet first."""
        toward = mi.Vector3f(*map(mi.Float, d))
        si = self.scene.ray_intersect(mi.Ray3f(mi.Point3f(*map(mi.Float, o)), toward), active)
        seen = si.is_valid()
        ids = self._id(si.shape, seen)
        t, p, n = dr.select(seen, si.t, 0), si.p, self._normal(si.n, ids)
        albedo = si.bsdf().eval_diffuse_reflectance(si, seen)
        if self.large:
            t, p = self.double(t), tuple(map(self.double, p))
        for i, body in self.large.items():
            here = distance(dr, body, o, d)
            closer = active & (here < dr.select(ids < 0, dr.inf, t))
            ids, t = dr.select(closer, i, ids), dr.select(closer, here, t)
            p = tuple(dr.select(closer, o[k] + here * d[k], p[k]) for k in range(3))
            n = dr.select(closer, mi.Normal3f(*map(mi.Float, normal(body, p))), n)
            albedo = dr.select(closer, self.albedo[i], albedo)
        n = dr.select(dr.dot(n, toward) > 0, -n, n)
        return Hit(ids, t, n, self._start(p, n, ids), albedo, toward)

    def _normal(self, n: Any, ids: Any) -> Any:
        """A rectangle's own, computed in float64; elsewhere n, Mitsuba's."""
        if self.normals is None:
            return n
        own = mi.Normal3f(*(dr.gather(mi.Float, x, ids + 1) for x in self.normals))
        return dr.select(dr.squared_norm(own) > 0, own, n)

    def _start(self, p: Any, n: Any, ids: Any) -> Any:
        """Where rays go on from p: off the surface by a part of p's distance from the eye."""
        part = SHADOW_OFFSET
        for i, offset in self.offsets.items():
            part = dr.select(ids == i, offset, part)
        off = part * dr.norm(mi.Vector3f(*map(mi.Float, p)))
        return tuple(p[k] + n[k] * off for k in range(3))

    def _id(self, shape: Any, seen: Any) -> Any:
        number = dr.reinterpret_array(mi.UInt32, shape)
        return dr.select(seen, dr.gather(mi.Int32, self.ids, number, seen), -1)

    def _blocker(self, hit: Hit, active: Any = True) -> Any:
        """The id of what hides the sun, -1 where nothing does or the surface is turned away from it.

        By Mitsuba's intersection, not its shadow test, which is the less exact of the two.
        """
        facing = active & hit.seen & (dr.dot(hit.n, self.to_light) > 0)
        ray = mi.Ray3f(mi.Point3f(*map(mi.Float, hit.start)), self.to_light)
        met = self.scene.ray_intersect_preliminary(ray, active=facing)
        blocker = self._id(met.shape, facing & met.is_valid())
        for i, body in self.large.items():
            blocker = dr.select(facing & (distance(dr, body, hit.start, self.toward_sun) < dr.inf), i, blocker)
        return blocker

    def _first_light(self, hit: Hit, blocker: Any, sky_at_hit: bool) -> Any:
        """f E V max(0, n·l) (+ (albedo + specular) Ls) where something is hit, Ls elsewhere."""
        colour = self._pi_f(hit, self.to_light) * self._sun(hit, blocker)
        if sky_at_hit:
            both = hit.albedo + mi.Color3f(*self._gloss(hit)[:3]) if self.gloss else hit.albedo
            colour += both * self._diffuse_irradiance(hit.n)
        return dr.select(hit.seen, colour, self._sky(hit.d))

    def _sky(self, d: Any) -> Any:
        """The sky's radiance along d."""
        if self.environment is None:
            return self.sky
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(d))
        si.wi = -d
        return self.environment.eval(si)

    def _diffuse_irradiance(self, n: Any) -> Any:
        """E(n)/π, the radiance of a constant sky of the same light: a map's by its harmonics."""
        if self.environment is None:
            return self.sky
        tall = (n.x, n.y, n.z, 1)
        return mi.Color3f(*(
            dr.maximum(sum(tall[i] * M[i][j] * tall[j] for i in range(4) for j in range(4)), 0) for M in self.harmonics
        ))  # fmt: skip

    def _gloss(self, hit: Hit) -> tuple[Any, ...]:
        """Specular and exponent of what is hit."""
        return tuple(dr.gather(mi.Float, column, hit.ids + 1) for column in self.gloss)

    def _pi_f(self, hit: Hit, to_light: Any) -> Any:
        """π f for light from there."""
        if not self.gloss:
            return hit.albedo
        r, g, b, exponent = self._gloss(hit)
        return hit.albedo + mi.Color3f(r, g, b) * lobe(dr, hit.n, to_light, hit.d, exponent)

    def _sun(self, hit: Hit, blocker: Any) -> Any:
        """E/π V max(0, n·l)."""
        return self.irradiance * (dr.select(blocker < 0, dr.maximum(dr.dot(hit.n, self.to_light), 0), 0) / pi)

    def _incoming(self, hit: Hit, sampler: Any) -> Any:
        """π f times the radiance from one cosine-distributed direction, as Mitsuba's `path` finds it."""
        d = mi.Frame3f(hit.n).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
        weight = self._pi_f(hit, d)
        if self.large:
            return weight * self._walk(hit, sampler, d)
        ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*hit.start), d))
        return weight * self.path.sample(self.scene, sampler, ray, active=hit.seen)[0]

    def _walk(self, hit: Hit, sampler: Any, d: Any) -> Any:
        """What Mitsuba's `path` would find along d, where the scene has an object too large for it."""
        state = (sampler, hit.start, d, mi.Color3f(0), mi.Color3f(1), mi.Bool(hit.seen), mi.UInt32(self.depth - 2))

        def step(sampler: Any, o: Any, d: Any, total: Any, weight: Any, active: Any, left: Any) -> tuple[Any, ...]:
            hit = self._nearest(o, self._unit(d), active)
            total += dr.select(active & ~hit.seen, weight * self._sky(d), 0)
            active &= hit.seen & (left > 0)
            sun = self._pi_f(hit, self.to_light) * self._sun(hit, self._blocker(hit, active))
            total += dr.select(active, weight * sun, 0)
            d = mi.Frame3f(hit.n).to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d(active)))
            weight *= self._pi_f(hit, d)
            return sampler, hit.start, d, total, weight, active, left - 1

        return dr.while_loop(state, lambda *state: state[5], step)[3]


def _colour(rgb: Any) -> Any:
    return mi.Color3f(*map(float, rgb))


def _gathered(colour: Any, batches: Batches) -> tuple[np.ndarray, ...]:
    """Mean and spread (n, 3) of lanes that lie as pixels, batches, samples."""
    dr.eval(colour)  # all channels in one kernel: block_sum would run it once for each
    double = dr.float64_array_t(mi.Float)
    found = []
    for c in colour:
        c = double(c)
        if batches.more < batches.number:  # the last sample of the later batches is one too many
            lane = dr.arange(mi.UInt32, dr.width(c)) % batches.lanes
            c = dr.select((lane % batches.each == batches.each - 1) & (lane // batches.each >= batches.more), 0, c)
        sums = dr.block_sum(c, batches.each)
        mean = dr.block_sum(sums, batches.number) / batches.samples
        batch = dr.arange(mi.UInt32, dr.width(sums)) % batches.number
        size = batches.each - dr.select(batch < batches.more, double(0), 1)
        off = sums / size - dr.repeat(mean, batches.number)
        found.append((mean, dr.block_sum(off * off * size, batches.number)))
    dr.eval(found)
    return tuple(np.stack([x.numpy() for x in columns], axis=1) for columns in zip(*found, strict=True))
