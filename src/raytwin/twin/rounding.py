"""What the twin's float32 cannot tell: single pixels at outlines, objects of extreme size, sides of sharp highlights.

Float32 puts a point off by δ = 2⁻²² (the ray's length to it, or its distance from the origin, + its sphere's radius): a
quarter of that is the rounding of one coordinate. Of the surface, depth errs
by δ / cos θ and a sphere's normal by δ / (r cos θ), θ between the normal and the ray.
"""

from dataclasses import replace

import numpy as np

from raytwin.images.image import Image, Surface
from raytwin.scene import Phong, Rectangle, Scene, Shape, Sphere, Sun
from raytwin.twin.rays import directions, lens_of
from raytwin.twin.twin_scene import SHADOW_OFFSET, SPHERE_OFFSET, place_of

ROUNDING = 2.0**-22
"""δ as a part of these lengths: four roundings of a float32 coordinate."""

SMALL_RATIO, LARGE_RATIO = 128.0, 16.0
"""That length over a sphere's radius, and radius over the eye's distance from the surface, beyond which an
object is said to be in single precision. At 128 a rim's normal is off by 5e-6; at 16 the surface by 1e-6 of its
distance."""


SUNLIGHT, LEAST_CHANGE = 0.5, 1e-3
"""Changes of radiance below this part of the sun's light on a pixel, or of its irradiance, leave a shadow as it is."""
MOST_CHANGE = 2.0
"""Times the sun's light on a pixel: a larger change is no shadow, but a firefly. Noise and other light leave room."""


SAME_DEPTH = 1e-4
"""Of the depth: two objects that differ by less are met on their common edge."""


def settle(test: Image, reference: Image, scene: Scene) -> tuple[Image, np.ndarray | None, tuple[str, ...]]:
    """The test with the twin's answer where float32 cannot tell, what rounding may add to radiance, and what to say.

    The second is (H, W, 3), None where nothing matters. `reference` is the twin's image of the scene.
    """
    surface = reference.surface
    if surface is None or not scene.objects:
        return test, None, ()
    said = []
    if (undecided := _undecided(test, reference, scene)).any():
        test = _with(test, reference, undecided)
        count = int(np.count_nonzero(undecided))
        where = f"{count} pixel{'s' * (count > 1)} on an outline or at a shadow's edge"
        said.append(f"{where}, where single precision cannot tell, {'were' if count > 1 else 'was'} not compared")
    granted, alike, names, count = np.zeros(reference.shape, np.float32), np.zeros(surface.ids.shape, bool), [], 0
    for i, (thing, reach) in enumerate(zip(scene.objects, _reaches(scene), strict=True)):
        here, extreme = surface.ids == i, is_extreme(thing, reach, scene)
        if not (here.any() and (extreme or isinstance(thing.material, Phong))):
            continue
        n, d = surface.normal[here].astype(float), _rays(scene, np.flatnonzero(here))
        if isinstance(thing.material, Phong):
            granted[here] += _highlight(thing, reach, scene.sun, n, d)
        if isinstance(thing, Sphere) and extreme:
            off = ROUNDING * (reach + thing.radius)
            # At a rim cos² θ itself is off by as much as δ / r.
            cosine = np.square((n * d).sum(axis=1))
            error = off / np.sqrt(np.maximum(cosine - 4 * off / thing.radius, off / thing.radius))
            # (n + 1) / 2 at `surface`, Lambert's law else.
            turned = np.maximum(np.multiply(thing.material.albedo, scene.sun.irradiance) / np.pi, 0.5)
            granted[here] += (error / thing.radius)[:, None] * turned
            if (own := test.surface) is not None and own.ids.shape == here.shape:
                near = (own.ids[here] == i) & (abs(own.depth[here] - surface.depth[here]) <= error)
                alike[here] = near & (np.linalg.norm(own.normal[here] - n, axis=1) <= error / thing.radius)
            names.append(f"object {i} (its surface to {off:.2g} m)")
            count += int(np.count_nonzero(here))
    if names:
        said.append(f"single precision: {count} pixels, compared within the rounding of {', '.join(names)}")
    return _surface_with(test, reference, alike), granted if granted.any() else None, tuple(said)


def _rays(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """The unit directions (k, 3), board axes, through the centres of the pixels of these numbers, row by row."""
    v, u = np.divmod(pixels, scene.camera.width)
    d = directions(np, lens_of(scene.camera), u.astype(float), v.astype(float))
    return np.asarray(np.stack(d, axis=1) @ np.asarray(scene.camera.R_cam_board))


def _reaches(scene: Scene) -> list[float]:
    """How far from each object its rays begin, or how far it is from the origin, whichever is more, in metres."""
    place, eye = place_of(scene), np.asarray(scene.camera.eye)
    ways = [np.linalg.norm(np.asarray(thing.center) - place.origin) for thing in scene.objects]
    rays = [np.linalg.norm(np.asarray(thing.center) - eye) - place.start / place.unit for thing in scene.objects]
    return [float(max(both)) for both in zip(ways, rays, strict=True)]


def extreme_spheres(scene: Scene) -> list[int]:
    """The ids of the spheres whose surface float32 holds badly."""
    reaches = zip(scene.objects, _reaches(scene), strict=True)
    return [i for i, (thing, reach) in enumerate(reaches) if is_extreme(thing, reach, scene)]


def is_extreme(thing: Shape, reach: float, scene: Scene) -> bool:
    """Whether float32 holds a sphere's surface badly."""
    if not isinstance(thing, Sphere):
        return False
    gap = abs(float(np.linalg.norm(np.subtract(thing.center, scene.camera.eye))) - thing.radius)
    return reach > SMALL_RATIO * thing.radius or thing.radius > LARGE_RATIO * gap


def _undecided(test: Image, reference: Image, scene: Scene) -> np.ndarray:
    """Where the two differ, and the ray or the sun's ray passes an outline within rounding: (H, W)."""
    surface, sun = reference.surface, scene.sun
    assert surface is not None
    undecided, eye, origin = np.zeros(surface.ids.size, bool), np.asarray(scene.camera.eye), place_of(scene).origin
    if test.shape != reference.shape:
        return undecided.reshape(surface.ids.shape)
    valid = (np.isfinite(test.mean) & (test.mean >= 0)).all(axis=-1)  # rounding makes no other values
    if test.surface is not None and test.surface.ids.shape == surface.ids.shape:
        near = abs(np.subtract(test.surface.depth, surface.depth)) <= SAME_DEPTH * surface.depth
        tied = near & (test.surface.ids >= 0) & (surface.ids >= 0)  # `compare` has a sentence of its own for these
        other = np.flatnonzero((test.surface.ids != surface.ids) & ~tied & valid)
        undecided[other] = _grazing(scene, np.broadcast_to(eye, (other.size, 3)), _rays(scene, other), origin, 0.0)
    change = np.abs(np.subtract(test.mean, reference.mean, dtype=np.float32)).max(axis=-1).ravel()
    lit = valid.ravel() & (surface.ids.ravel() >= 0) & ~undecided
    seen = np.flatnonzero((change > LEAST_CHANGE * max(sun.irradiance)) & lit)
    if any(sun.irradiance) and seen.size:
        albedo = np.array([thing.material.albedo for thing in scene.objects])[surface.ids.ravel()[seen]]
        facing = np.maximum(surface.normal.reshape(-1, 3)[seen] @ np.asarray(sun.to_light), 0)
        term = (albedo * np.asarray(sun.irradiance)).max(axis=1) / np.pi * facing
        all_of_it = term if not scene.glossy else np.inf  # a highlight's is not bounded by Lambert's law
        part_of_it = (change[seen] > SUNLIGHT * term) & (change[seen] <= MOST_CHANGE * all_of_it)
        seen = seen[part_of_it & (term > LEAST_CHANGE * max(sun.irradiance))]
        points = eye + surface.depth.ravel()[seen, None] * _rays(scene, seen)
        lift = SPHERE_OFFSET * max((thing.radius for thing in scene.spheres), default=0.0)
        toward = np.broadcast_to(sun.to_light, points.shape)
        undecided[seen] |= _grazing(scene, points, toward, origin, lift, SHADOW_OFFSET)
    return undecided.reshape(surface.ids.shape)


def _grazing(
    scene: Scene, o: np.ndarray, d: np.ndarray, origin: np.ndarray, lift: float, part: float = 0.0
) -> np.ndarray:
    """Which rays from o along d (k, 3) pass the outline of an object within its rounding (k,).

    `lift` and `part`: how far off its surface the ray began, in metres and as a part of the distance from the origin.
    """
    grazing, lifted = np.zeros(len(o), bool), 2 * (lift + part * np.linalg.norm(o - origin, axis=1))
    for thing, reach in zip(scene.objects, _reaches(scene), strict=True):
        to = thing.center - o
        if isinstance(thing, Rectangle):
            with np.errstate(divide="ignore", invalid="ignore"):
                ahead = (to @ thing.normal) / (d @ thing.normal)
                edges = np.stack([thing.half_u, thing.half_v])
                half = np.linalg.norm(edges, axis=1)
                beyond = abs((ahead[:, None] * d - to) @ (edges / half[:, None]).T) - half
                off, size = beyond.max(axis=1) * abs(d @ thing.normal), float(np.linalg.norm(half))
        else:
            ahead, size = (to * d).sum(axis=1), thing.radius
            off = np.linalg.norm(to - ahead[:, None] * d, axis=1) - size
        grazing |= (ahead > 0) & (abs(off) < ROUNDING * (reach + size) + lifted)
    return grazing


def _with(test: Image, reference: Image, chosen: np.ndarray) -> Image:
    """The test image with the reference's pixels where `chosen`."""
    test = replace(test, mean=np.where(chosen[..., None], reference.mean, test.mean))
    return _surface_with(test, reference, chosen)


def _surface_with(test: Image, reference: Image, chosen: np.ndarray) -> Image:
    """The test image with the reference's objects, depth and normals where `chosen`."""
    own, other = test.surface, reference.surface
    if own is None or other is None or not chosen.any():
        return test
    parts = np.where(chosen, other.ids, own.ids), np.where(chosen, other.depth, own.depth)
    return replace(test, surface=Surface(*parts, np.where(chosen[..., None], other.normal, own.normal)))


def _highlight(thing: Shape, reach: float, sun: Sun, n: np.ndarray, d: np.ndarray) -> np.ndarray:
    """By how much float32 may put the sun's highlight off at each pixel (k, 3): |∂L/∂(r·v)| times the error of r·v.

    A normal errs by δ / r, and r·v by 4 times that at most. A sharp lobe makes n / (r·v) times as much of it, where
    Lambert's law makes 1. `n`, `d` (k, 3): what is seen there, and along which ray.
    """
    assert isinstance(thing.material, Phong)
    power, to_light = thing.material.exponent, np.asarray(sun.to_light)
    error = 4 * ROUNDING * (1 + reach / getattr(thing, "radius", np.inf))
    along = np.clip(2 * (n @ to_light) * -(n * d).sum(axis=1) + d @ to_light, 1e-3, 1)
    steep = (power + 2) / (2 * np.pi) * power * along ** (power - 1) * np.maximum(n @ to_light, 0) * error
    return np.asarray(steep[:, None] * np.multiply(thing.material.specular, sun.irradiance))
