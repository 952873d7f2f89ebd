"""What the twin's float32 cannot tell: pixels on an outline or at a shadow's edge, extreme spheres, sharp highlights.

A point is off by δ = 2⁻²² (the ray's length to it, or its distance from the origin, + its sphere's radius): a quarter
of that is the rounding of one coordinate. On an outline Mitsuba itself says so: a hair beside the pixel's centre, δ
wide, it sees the other object, or the sun. Depth errs by δ / cos θ, and a sphere's normal by δ / (r cos θ), θ between
the normal and the ray. A highlight's power n makes n times as much of an error of r·v.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from raytwin.images.image import Image, Surface
from raytwin.scene import Phong, Scene
from raytwin.scene.camera_rays import camera_rays
from raytwin.twin.twin_scene import SHADOW_OFFSET, SPHERE_OFFSET, place_of

ROUNDING = 2.0**-22
"""δ as a part of these lengths: four roundings of a float32 coordinate."""
SMALL_RATIO, LARGE_RATIO = 128.0, 16.0
"""That length over a sphere's radius, and radius over the eye's distance from the surface, beyond which an
object is said to be in single precision. At 128 a rim's normal is off by 5e-6; at 16 the surface by 1e-6 of its
distance."""
LEAST_CHANGE = 1e-3
"""Of the sun's irradiance: changes of radiance below this are no shadow."""
CHANGE = 0.5, 2.0
"""Least and largest change of radiance beside that from the pixel's centre to a hair beside it: more is a firefly.
Noise and other light leave room."""
SAME_DEPTH = 1e-4
"""Of the depth: two objects that differ by less are met on their common edge, of which `compare` has a sentence."""


def settle(test: Image, reference: Image, scene: Scene) -> tuple[Image, np.ndarray | None, tuple[str, ...]]:
    """The test with the twin's answer where float32 cannot tell, what rounding may add to radiance, and what to say.

    The second is (H, W, 3), None where nothing matters. `reference` is the twin's image of the scene.
    """
    surface, said, names = reference.surface, [], []
    if surface is None or not scene.objects:
        return test, None, ()
    if (undecided := _undecided(test, reference, scene)).any():
        test = replace(test, mean=np.where(undecided[..., None], reference.mean, test.mean))
        test = _with_surface(test, reference, undecided)
        count = int(np.count_nonzero(undecided))
        where = f"{count} pixel{'s' * (count > 1)} on an outline or at a shadow's edge"
        said.append(f"{where}, where single precision cannot tell, {'were' if count > 1 else 'was'} not compared")
    granted, alike, shown = np.zeros(reference.shape, np.float32), np.zeros(surface.ids.shape, bool), 0
    for i, (thing, reach) in enumerate(zip(scene.objects, _reaches(scene), strict=True)):
        if isinstance(thing.material, Phong):  # r·v errs by at most 4 times what the normal does
            error = 4 * ROUNDING * (1 + reach / getattr(thing, "radius", np.inf))
            granted[surface.ids == i] = thing.material.exponent * error * reference.mean[surface.ids == i]
    for i, reach in extreme_spheres(scene).items():
        ball, here = scene.spheres[i], surface.ids == i
        n, off = surface.normal[here].astype(float), ROUNDING * (reach + ball.radius)
        # At a rim cos² θ itself is off by as much as δ / r.
        cosine = np.square((n * camera_rays(scene.camera, np.argwhere(here)[:, ::-1]).directions).sum(axis=1))
        error = off / np.sqrt(np.maximum(cosine - 4 * off / ball.radius, off / ball.radius))
        # (n + 1) / 2 at `surface`, Lambert's law else.
        turned = np.maximum(np.multiply(ball.material.albedo, scene.sun.irradiance) / np.pi, 0.5)
        granted[here] += (error / ball.radius)[:, None] * turned
        if (own := test.surface) is not None and own.ids.shape == here.shape:
            near = (own.ids[here] == i) & (abs(own.depth[here] - surface.depth[here]) <= error)
            alike[here] = near & (np.linalg.norm(own.normal[here] - n, axis=1) <= error / ball.radius)
        if here.any():
            names.append(f"object {i} (its surface to {off:.2g} m)")
            shown += int(np.count_nonzero(here))
    if names:
        said.append(f"single precision: {shown} pixels, compared within the rounding of {', '.join(names)}")
    return _with_surface(test, reference, alike), granted if granted.any() else None, tuple(said)


def extreme_spheres(scene: Scene) -> dict[int, float]:
    """The ids of the spheres whose surface float32 holds badly, and how far each is from where rays begin."""
    found = {}
    for i, (ball, reach) in enumerate(zip(scene.spheres, _reaches(scene), strict=False)):
        gap = abs(float(np.linalg.norm(np.subtract(ball.center, scene.camera.eye))) - ball.radius)
        if reach > SMALL_RATIO * ball.radius or ball.radius > LARGE_RATIO * gap:
            found[i] = reach
    return found


def _reaches(scene: Scene) -> list[float]:
    """How far from each object its rays begin, or how far it is from the origin, whichever is more, in metres."""
    place, eye = place_of(scene), np.asarray(scene.camera.eye)
    ways = [np.linalg.norm(np.asarray(thing.center) - place.origin) for thing in scene.objects]
    rays = [np.linalg.norm(np.asarray(thing.center) - eye) - place.start / place.unit for thing in scene.objects]
    return [float(max(both)) for both in zip(ways, rays, strict=True)]


def _undecided(test: Image, reference: Image, scene: Scene) -> np.ndarray:
    """Where the two differ, and Mitsuba sees as much of a difference a hair beside the pixel's centre: (H, W)."""
    surface, brightest = reference.surface, max(scene.sun.irradiance)
    assert surface is not None
    undecided = np.zeros(surface.ids.shape, bool)
    if test.shape != reference.shape:
        return undecided
    own = surface if test.surface is None else test.surface
    change = np.abs(np.subtract(test.mean, reference.mean, dtype=np.float32)).max(axis=-1)
    tied = (abs(own.depth - surface.depth) <= SAME_DEPTH * surface.depth) & own.mask & surface.mask
    other = (own.ids != surface.ids) & ~tied
    valid = (np.isfinite(test.mean) & (test.mean >= 0)).all(axis=-1)  # rounding makes no other values
    v, u = np.nonzero(valid & (other | ((change > LEAST_CHANGE * brightest) & surface.mask)))
    if v.size:
        ids, light = _beside(scene, np.stack([u, v], axis=1), (own, surface))
        spread = np.ptp(light, axis=0).max(axis=-1)
        least, largest = (part * spread for part in CHANGE)
        shadow = (spread > LEAST_CHANGE * brightest) & (change[v, u] > least) & (change[v, u] <= largest)
        undecided[v, u] = np.where(other[v, u], (ids == own.ids[v, u]).any(axis=0), shadow)
    return undecided


def _beside(scene: Scene, pixels: np.ndarray, seen: Sequence[Surface]) -> tuple[np.ndarray, np.ndarray]:
    """What Mitsuba sees at pixels (k, 2) and a hair beside, on four sides: ids (5, k), the sun's light (5, k, 3).

    The hair is twice what rounding moves an outline of the objects `seen`, or a shadow's edge on them.
    """
    from raytwin.twin.twin_light import TwinLight

    rays, (u, v) = camera_rays(scene.camera, pixels), pixels.T
    radii = [getattr(thing, "radius", 0.0) for thing in scene.objects]
    sizes = np.append(np.add(_reaches(scene), radii), 0.0)  # the last is of BACKGROUND
    depth = np.max([surface.depth[v, u] for surface in seen], axis=0)
    away = np.linalg.norm(rays.origin + depth[:, None] * rays.directions - place_of(scene).origin, axis=1)
    off = ROUNDING * np.max([sizes[surface.ids[v, u]] for surface in seen], axis=0)
    start = SPHERE_OFFSET * max(radii) + 2 * SHADOW_OFFSET * away
    off = 2 * np.where(seen[0].ids[v, u] == seen[1].ids[v, u], off + start, off)
    hair = scene.camera.fx * off / np.maximum(depth, off)
    twin = TwinLight(scene, {}, 2)
    found = [twin.at(u + du * hair, v + dv * hair) for du, dv in ((0, 0), *product((-1, 1), repeat=2))]
    return np.stack([ids for ids, _ in found]), np.stack([light for _, light in found])


def _with_surface(test: Image, reference: Image, chosen: np.ndarray) -> Image:
    """The test image with the reference's objects, depth and normals where `chosen`."""
    own, other = test.surface, reference.surface
    if own is None or other is None or not chosen.any():
        return test
    parts = np.where(chosen, other.ids, own.ids), np.where(chosen, other.depth, own.depth)
    return replace(test, surface=Surface(*parts, np.where(chosen[..., None], other.normal, own.normal)))
