"""The light levels in Mitsuba: its intersector, emitters, shadow test, BSDFs and path tracer behind OpenCV's camera."""

from collections.abc import Callable, Mapping, Sequence
from math import pi
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from raytwin.images.image import BACKGROUND, Image, Surface
from raytwin.progress import Progress
from raytwin.rungs import RUNGS, Rung
from raytwin.scene import Scene
from raytwin.twin.opencv_sensor import lens_at
from raytwin.twin.rendering import Plan
from raytwin.twin.twin_scene import SHADOW_OFFSET, SPHERE_OFFSET, load, number_of, place_of, translate

LANES = 1 << 22
"""Rays per launch: enough to fill any machine; an array of three floats takes 50 MB."""
SKY_GRID = 2048, 1024
"""Directions, around and down, over which a map's light is summed: a map of one radiance comes out within 1e-5."""


class Seen(NamedTuple):
    """What rays meet: Mitsuba's record of the `hit`, whether it is `any` object, the normal `n` on the eye's side."""

    hit: Any
    any: Any
    n: Any


def seen_along(loaded: Any, ray: Any) -> Seen:
    """What the rays meet first in a Mitsuba scene."""
    hit = loaded.ray_intersect(ray)
    return Seen(hit, hit.is_valid(), dr.select(dr.dot(hit.n, ray.d) > 0, -hit.n, hit.n))


def surface_of(loaded: Any, seen: Seen, numbers: Sequence[int], depth: Any, size: tuple[int, int]) -> Surface:
    """What is seen through each of size = (width, height) pixels; `numbers`: the ids of Mitsuba's shapes in order."""
    # Mitsuba's pointers to shapes are small integers, and 0 is none.
    keys = dr.reinterpret_array(mi.UInt32, loaded.shapes_dr()).numpy()
    table = np.full(keys.max(initial=0) + 1, BACKGROUND, np.int32)
    table[keys] = numbers
    shape = dr.select(seen.any, dr.reinterpret_array(mi.UInt32, seen.hit.shape), 0)
    found = shape, mi.Float(dr.select(seen.any, depth, 0)), dr.select(seen.any, seen.n, 0)
    dr.eval(found)
    key, distance, normal = (np.array(part) for part in found)
    rows = size[::-1]
    return Surface(table[key].reshape(rows), distance.reshape(rows), normal.T.reshape(*rows, 3).copy())


class TwinLight:
    """One scene, loaded. `depth`: the longest light path, counted as Mitsuba does; None: the sky is open."""

    def __init__(self, scene: Scene, textures: Mapping[int, np.ndarray], depth: int | None = None) -> None:
        camera, self.place, self.double = scene.camera, place_of(scene), dr.float64_array_t(mi.Float)
        world = translate(scene, self.place, textures)
        if "sun" in world and world.get("sky", {}).get("type") == "constant":
            # `path` would toss a coin between the sun and the sky. Directions by the cosine find an even sky best.
            world["sky"]["sampling_weight"] = 0.0
        self.scene = load(world)
        self.sun = next((e for e in self.scene.emitters() if not e.is_environment()), None)
        self.sky = self.scene.environment()
        self.path: Any = load({"type": "path", "max_depth": depth - 1, "rr_depth": depth}) if depth else None
        self.lens: Any = mi.load_dict(lens_at(camera, self.place.eye, self.place.start))
        self.size, self.width = camera.image_size, dr.opaque(mi.UInt32, camera.width)
        largest = max((ball.radius for ball in scene.spheres), default=0.0)
        self.offset = dr.opaque(mi.Float, SPHERE_OFFSET * self.place.unit * largest)
        self.irradiance: Any = None
        if depth is None:
            self.irradiance = open_sky(self.sky) if scene.environment else lambda n: mi.Color3f(*scene.sky.radiance)

    def seen(self, pixel: Any, du: Any = 0.0, dv: Any = 0.0) -> Seen:
        """What the rays through the pixels' centres, moved by (du, dv) pixels, meet first."""
        row = pixel // self.width
        u, v = self.double(pixel - row * self.width), self.double(row)
        return seen_along(self.scene, self.lens.ray(u + self.double(du), v + self.double(dv)))

    def surface(self, seen: Seen, size: tuple[int, int]) -> Surface:
        """What is seen through each of size = (width, height) pixels: depth in metres, normals in the board's frame."""
        numbers = [number_of(shape.id()) for shape in self.scene.shapes()]
        depth = (self.double(seen.hit.t) + self.lens.start) / self.place.unit
        return surface_of(self.scene, seen, numbers, depth, size)

    def directions(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Unit directions (k, 3), in the board's frame, of the rays through these places of the image."""
        return np.stack([part.numpy() for part in self.lens.direction(self.double(u), self.double(v))], axis=1)

    def at(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Ids (k,), depth (k,), normals (k, 3) and the sun's light (k, 3) at these places of the image."""
        seen = seen_along(self.scene, self.lens.ray(self.double(u), self.double(v)))
        light = self.sunlight(seen, shadows=True)
        dr.schedule(light)
        surface = self.surface(seen, (len(u), 1))
        return surface.ids[0], surface.depth[0], surface.normal[0], np.array(light).T

    def onward(self, seen: Seen, d: Any) -> Any:
        """Rays that go on along d."""
        start = seen.hit.p + seen.n * (SHADOW_OFFSET * dr.norm(seen.hit.p) + self.offset)
        return mi.RayDifferential3f(mi.Ray3f(start, d))

    def sunlight(self, seen: Seen, shadows: bool) -> Any:
        """The sun's light that is sent to the eye, 0 in its `shadows`."""
        if self.sun is None:
            return mi.Color3f(0)
        there, weight = self.sun.sample_direction(seen.hit, mi.Point2f(0.5), seen.any)
        lit = seen.any & (dr.dot(seen.n, there.d) > 0)
        if shadows:
            lit &= ~self.scene.ray_test(self.onward(seen, there.d), lit)
        f_cos = seen.hit.bsdf().eval(mi.BSDFContext(), seen.hit, seen.hit.to_local(there.d), lit)
        return dr.select(lit, weight * f_cos, 0)

    def unsampled(self, rung: Rung, seen: Seen) -> Any:
        """The light without noise: the sun's at what is seen, the open sky's, and the sky behind all objects."""
        colour = self.sunlight(seen, rung.shadows)
        if self.irradiance is not None:
            albedo = seen.hit.bsdf().eval_diffuse_reflectance(seen.hit, seen.any)
            colour += dr.select(seen.any, albedo * self.irradiance(seen.n), 0)
        return colour + (dr.select(seen.any, 0, self.sky.eval(seen.hit, ~seen.any)) if self.sky else 0)

    def bounced(self, seen: Seen, sampler: Any) -> Any:
        """What one direction, drawn by the BSDF, brings of all other light, as Mitsuba's `path` finds it."""
        one, two = sampler.next_1d(), sampler.next_2d()
        sample, weight = seen.hit.bsdf().sample(mi.BSDFContext(), seen.hit, one, two, seen.any)
        onward = self.onward(seen, seen.hit.to_world(sample.wo))
        return dr.select(seen.any, weight * self.path.sample(self.scene, sampler, onward, None, seen.any)[0], 0)

    def image(self, plan: Plan, progress: Progress) -> Image:
        """The image that is asked for. Its surface has depth in metres and normals in the board's frame."""
        rung, (width, height), by_centre = RUNGS[plan.rung], self.size, plan.sampling == "center"
        shape, n = (height, width, 3), width * height
        seen = self.seen(dr.arange(mi.UInt32, n))
        exact = self.unsampled(rung, seen) if rung.lit and by_centre else dr.zeros(mi.Color3f, n)
        dr.schedule(exact)
        surface = self.surface(seen, self.size)
        mean = np.array(exact).T.reshape(shape).copy()
        if not rung.lit:
            mean = np.where(surface.mask[..., None], (surface.normal + 1) / 2, np.float32(0))
        if not rung.sampled(plan.sampling):
            return Image(mean, surface=surface)
        found, block, batches = np.empty((3, n, 3), np.float32), max(1, LANES // plan.samples), plan.batches or 1
        for a in range(0, n, block):
            b = min(n, a + block)
            number = np.random.SeedSequence([plan.seed, a, plan.samples]).generate_state(1)[0]
            sampler, lanes = mi.load_dict({"type": "independent"}), (b - a) * plan.samples
            sampler.seed(dr.opaque(mi.UInt32, int(number)), lanes)
            pixel = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, plan.samples) + dr.opaque(mi.UInt32, a)
            seen = self.seen(pixel) if by_centre else self.seen(pixel, *(sampler.next_2d() - 0.5))
            colour = mi.Color3f(0) if by_centre else self.unsampled(rung, seen)
            colour += self.bounced(seen, sampler) if self.path else 0
            dr.eval(colour)  # all channels in one kernel: block_sum would run it once for each
            each = plan.samples // batches
            for channel, c in enumerate(colour):
                moment = moments(dr.block_sum(self.double(c), each) / each, batches)
                found[:, a:b, channel] = [part.numpy() for part in moment]
            progress("twin", round(100 * b / n), 100)
        bounced, variance, third = found.reshape(3, *shape)
        return Image(
            mean + bounced, variance if batches > 1 else None, plan.samples, surface, batches,
            third=third if batches > 2 else None,
        )  # fmt: skip


def moments(means: Any, batches: int) -> tuple[Any, Any, Any]:
    """The mean of each pixel's batches, given their means, that mean's variance and its third central moment.

    `means`: float64 of Dr.Jit, pixel by pixel. Unbiased; 0 from fewer than 2 and 3 batches. See ImagePool.
    """
    mean = dr.block_sum(means, batches) / batches
    dr.eval(mean)
    step = means - dr.repeat(mean, batches)
    square, pairs = dr.square(step), max(1, batches * (batches - 1))
    third = dr.block_sum(square * step, batches) / (pairs * max(1, batches - 2))
    return mean, dr.block_sum(square, batches) / pairs, third


def open_sky(sky: Any) -> Callable[[Any], Any]:
    """Return n -> E(n)/π, the radiance of a constant sky of the same light, to the second order of a map's harmonics.

    The cosine's coefficients are π, 2π/3, π/4 (Ramamoorthi and Hanrahan 2001, eq. 8), and the harmonics of one order
    sum to (2 l + 1)/4π P_l(n·ω). So E/π = ∫ L (1/4π + n·ω/2π + 5 (3 (n·ω)² - 1)/32π) dω = (n, 1)ᵀ M (n, 1).
    """
    around, down = SKY_GRID
    turn, z = np.meshgrid((np.arange(around) + 0.5) * (2 * pi / around), 1 - (2 * np.arange(down) + 1) / down)
    level = np.sqrt(1 - z * z)
    w = np.stack([level * np.cos(turn), level * np.sin(turn), z, np.ones_like(z)]).reshape(4, -1)  # equal solid angles
    hit = dr.zeros(mi.SurfaceInteraction3f, w.shape[1])
    hit.wi = -mi.Vector3f(w[:3].astype(np.float32))
    light = sky.eval(hit).numpy() * (4 * pi / w.shape[1])
    factors = np.full((4, 4), 15 / (32 * pi))
    factors[3], factors[:, 3], factors[3, 3] = 1 / (4 * pi), 1 / (4 * pi), 3 / (32 * pi)
    M = factors * np.einsum("cn,in,jn->cij", light, w, w, optimize=True)

    def radiance(n: Any) -> Any:
        n1 = mi.Vector4f(n.x, n.y, n.z, 1)
        return dr.maximum(mi.Color3f(*(dr.dot(n1, mi.Matrix4f(m.astype(np.float32)) @ n1) for m in M)), 0)

    return radiance
