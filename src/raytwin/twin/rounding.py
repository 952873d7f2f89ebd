"""What the twin's float32 cannot tell: single pixels at outlines, objects of extreme size, sides of sharp highlights.

Float32 puts a point off by δ = 2⁻²² (the ray's length to it, or its distance from the origin, + its sphere's radius): a
quarter of that is the rounding of one coordinate. Of the surface, depth errs
by δ / cos θ and a sphere's normal by δ / (r cos θ), θ between the normal and the ray.
"""

from dataclasses import replace

import numpy as np

from raytwin.image import Image, Surface
from raytwin.scene import Phong, Rectangle, Scene, Sphere
from raytwin.twin.rays import directions, lens_of
from raytwin.twin.twin_scene import SHADOW_OFFSET, SPHERE_OFFSET, place_of

ROUNDING = 2.0**-22
"""δ as a part of these lengths: four roundings of a float32 coordinate."""

SMALL, LARGE = 128.0, 16.0
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
    extreme = extreme_spheres(scene)
    granted = _highlights(scene, surface) if scene.glossy else None
    pixels = np.flatnonzero(np.isin(surface.ids.ravel(), list(extreme)))
    if pixels.size:
        test, more = _granted(test, reference, scene, pixels, extreme)
        granted = more if granted is None else granted + more
        shown = sorted(set(surface.ids.ravel()[pixels].tolist()))
        names = ", ".join(f"object {i} (its surface to {extreme[i]:.2g} m)" for i in shown)
        said.append(f"single precision: {pixels.size} pixels, compared within the rounding of {names}")
    return test, granted, tuple(said)


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


def extreme_spheres(scene: Scene) -> dict[int, float]:
    """The spheres whose surface float32 holds badly: id -> δ in metres."""
    eye, found = np.asarray(scene.camera.eye), {}
    for i, (thing, reach) in enumerate(zip(scene.objects, _reaches(scene), strict=True)):
        if isinstance(thing, Sphere):
            gap = abs(float(np.linalg.norm(thing.center - eye)) - thing.radius)
            if reach > SMALL * thing.radius or thing.radius > LARGE * gap:
                found[i] = ROUNDING * (reach + thing.radius)
    return found


def _granted(
    test: Image, reference: Image, scene: Scene, pixels: np.ndarray, extreme: dict[int, float]
) -> tuple[Image, np.ndarray]:
    """The test with the twin's depth and normals where they agree within rounding, and what radiance may err by."""
    surface = reference.surface
    assert surface is not None
    ids, normal = surface.ids.ravel()[pixels], surface.normal.reshape(-1, 3)[pixels].astype(float)
    off = np.array([extreme.get(i, 0.0) for i in range(len(scene.objects))])[ids]
    radius = np.array([getattr(thing, "radius", np.inf) for thing in scene.objects])[ids]
    albedo = np.array([thing.material.albedo for thing in scene.objects])[ids]
    # At a rim cos² θ itself is off by as much as δ / r.
    cosine = (normal * _rays(scene, pixels)).sum(axis=1)
    error = off / np.sqrt(np.maximum(np.square(cosine) - 4 * off / radius, off / radius))
    granted = np.zeros((surface.ids.size, 3), np.float32)  # (n + 1) / 2 at `surface`, Lambert's law else
    turned = np.maximum(albedo * np.asarray(scene.sun.irradiance) / np.pi, 0.5)
    granted[pixels] = (error / radius)[:, None] * turned
    if (own := test.surface) is not None and own.ids.shape == surface.ids.shape:
        depth, normals = own.depth.copy().ravel(), own.normal.copy().reshape(-1, 3)
        near = (own.ids.ravel()[pixels] == ids) & (abs(depth[pixels] - surface.depth.ravel()[pixels]) <= error)
        alike = near & (np.linalg.norm(normals[pixels] - normal, axis=1) <= error / radius)
        depth[pixels[near]] = surface.depth.ravel()[pixels[near]]
        normals[pixels[alike]] = normal[alike]
        shape = own.ids.shape
        test = replace(test, surface=Surface(own.ids, depth.reshape(shape), normals.reshape(*shape, 3)))
    return test, granted.reshape(test.shape)


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
    own, other, wide = test.surface, reference.surface, chosen[..., None]
    test = replace(test, mean=np.where(wide, reference.mean, test.mean))
    if own is None or other is None:
        return test
    parts = np.where(chosen, other.ids, own.ids), np.where(chosen, other.depth, own.depth)
    surface = Surface(*parts, np.where(wide, other.normal, own.normal))
    return replace(test, surface=surface)


def _highlights(scene: Scene, surface: Surface) -> np.ndarray:
    """By how much float32 may put the sun's highlight off at each pixel (H, W, 3): |∂L/∂(r·v)| times the error of r·v.

    A normal errs by δ / r, and r·v by 4 times that at most. A sharp lobe makes n / (r·v) times as much of it, where
    Lambert's law makes 1.
    """
    granted = np.zeros((surface.ids.size, 3), np.float32)
    to_light = np.asarray(scene.sun.to_light)
    for i, (thing, reach) in enumerate(zip(scene.objects, _reaches(scene), strict=True)):
        if not isinstance(thing.material, Phong):
            continue
        pixels = np.flatnonzero(surface.ids.ravel() == i)
        n, d, power = surface.normal.reshape(-1, 3)[pixels], _rays(scene, pixels), thing.material.exponent
        error = 4 * ROUNDING * (1 + reach / getattr(thing, "radius", np.inf))
        facing = np.maximum(n @ to_light, 0)
        along = np.clip(2 * (n @ to_light) * -(n * d).sum(axis=1) + d @ to_light, 1e-3, 1)
        steep = (power + 2) / (2 * np.pi) * power * along ** (power - 1) * facing * error
        granted[pixels] = steep[:, None] * np.asarray(thing.material.specular) * np.asarray(scene.sun.irradiance)
    return granted.reshape(*surface.ids.shape, 3)
