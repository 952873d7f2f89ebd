"""What the twin's float32 cannot tell: pixels on an outline or at a shadow's edge, extreme spheres, sharp highlights.

A point of an object is off by δ = 2⁻²² (its distance from the origin, or from where its ray begins, whichever is more,
plus its sphere's radius). To see what that changes, Mitsuba renders such pixels again at four points beside the
centre, as far from it as δ moves the image.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from raytwin.images.image import Image, Surface
from raytwin.scene import Scene
from raytwin.twin.twin_scene import SHADOW_OFFSET, SPHERE_OFFSET, place_of

ROUNDING = 2.0**-22
"""δ as a part of these lengths: four roundings of a float32 coordinate."""
MAX_DISTANCE, MAX_RADIUS = 128.0, 16.0
"""A sphere is extreme if it lies beyond so many of its radii, or if its radius is so many times the eye's distance
to its surface. At 128 a rim's normal is off by 5e-6; at 16 the surface by 1e-6 of its distance."""
LEAST_CHANGE = 1e-3
"""Share of the sun's irradiance: a smaller change of radiance is not counted as a shadow."""
MIN_RATIO, MAX_RATIO = 0.5, 2.0
"""|test - reference| over the change that Mitsuba sees beside the centre: below the first, it is no
shadow's edge. Above the second, it is more than rounding."""


def settle(test: Image, reference: Image, scene: Scene) -> tuple[Image, tuple[str, ...]]:
    """Copy the twin's pixels into the test where float32 cannot tell. Return it, and sentences that say where.

    `reference` is the twin's image of the scene. What differs by more than rounding stays.
    """
    seen, said = reference.surface, []
    if seen is None or not scene.objects or test.shape != reference.shape:
        return test, ()
    own, change = test.surface or seen, np.abs(test.mean - reference.mean)
    other = own.ids != seen.ids
    apart = other | ((change.max(axis=-1) > LEAST_CHANGE * max(scene.sun.irradiance)) & seen.mask)
    extreme = [i for i in extreme_spheres(scene) if (seen.ids == i).any()]
    glossy = [i for i, thing in enumerate(scene.objects) if thing.highlight]
    valid = (np.isfinite(test.mean) & (test.mean >= 0)).all(axis=-1)  # rounding makes no other values
    coarse = np.isin(seen.ids, [*extreme, *glossy])
    if (asked := valid & (apart | coarse)).any():
        test, taken = _taken(test, reference, scene, asked, other, apart, coarse)
        if count := int(np.count_nonzero(taken & apart)):
            where = f"{count} pixel{'s' * (count > 1)} on an outline or at a shadow's edge"
            said.append(f"{where}, where single precision cannot tell, {'were' if count > 1 else 'was'} not compared")
    if extreme:
        names = ", ".join(f"object {i} (its surface to {_offsets(scene)[i]:.2g} m)" for i in extreme)
        count = int(np.count_nonzero(np.isin(seen.ids, extreme)))
        said.append(f"single precision: {count} pixels, compared within the rounding of {names}")
    return test, tuple(said)


def extreme_spheres(scene: Scene) -> list[int]:
    """The ids of the spheres whose surface float32 holds badly."""
    found = []
    for i, (ball, off) in enumerate(zip(scene.spheres, _offsets(scene), strict=False)):
        gap = abs(float(np.linalg.norm(np.subtract(ball.center, scene.camera.eye))) - ball.radius)
        if off > ROUNDING * (MAX_DISTANCE + 1) * ball.radius or ball.radius > MAX_RADIUS * gap:
            found.append(i)
    return found


def _offsets(scene: Scene) -> np.ndarray:
    """δ of each object, and 0 for the background, in metres."""
    place, centers = place_of(scene), np.array([thing.center for thing in scene.objects])
    away = np.linalg.norm(centers - place.origin, axis=1)
    ray = np.linalg.norm(centers - np.asarray(scene.camera.eye), axis=1) - place.start / place.unit
    radii = [getattr(thing, "radius", 0.0) for thing in scene.objects]
    return np.append(ROUNDING * (np.maximum(away, ray) + radii), 0.0)


def _taken(
    test: Image, reference: Image, scene: Scene, asked: np.ndarray, other: np.ndarray, apart: np.ndarray,
    coarse: np.ndarray,
) -> tuple[Image, np.ndarray]:  # fmt: skip
    """The test with the twin's answer in those of the pixels `asked` that differ by rounding, and which these are.

    All masks are (H, W). `other`: pixels that see another object. `apart`: these, and those with another shadow.
    `coarse`: pixels on extreme spheres and glossy objects, where shading differs, too.
    """
    from raytwin.twin.twin_light import TwinLight

    seen, own = reference.surface, test.surface or reference.surface
    assert seen is not None
    assert own is not None
    (v, u), other, apart = np.nonzero(asked), other[asked], apart[asked]
    depth, offsets = np.maximum(own.depth, seen.depth)[asked], _offsets(scene)
    off = np.maximum(offsets[own.ids[asked]], offsets[seen.ids[asked]])
    twin, places = TwinLight(scene, {}, 2), ((0, 0), *product((-1, 1), repeat=2))
    seen_at = scene.camera.eye + depth[:, None] * twin.directions(u, v)
    away = np.linalg.norm(seen_at - twin.place.origin, axis=1)
    start = SPHERE_OFFSET * max((ball.radius for ball in scene.spheres), default=0.0) + 2 * SHADOW_OFFSET * away
    hair = 2 * scene.camera.fx * (off + np.where(apart & ~other, start, 0)) / np.maximum(depth, off)
    beside = [twin.at(u + du * hair, v + dv * hair) for du, dv in places]
    ids, far, normal, light = (np.stack(part) for part in zip(*beside, strict=True))
    turn = np.ptp(normal, axis=0)
    spread = np.ptp(light, axis=0)
    bound = MAX_RATIO * np.maximum(spread, turn / 2)  # at `surface` the light is (n + 1) / 2
    found = (ids == own.ids[asked]).any(axis=0)
    change, largest = np.abs(test.mean - reference.mean)[asked], spread.max(axis=-1)
    shadow = (largest > LEAST_CHANGE * max(scene.sun.irradiance)) & (change.max(axis=-1) > MIN_RATIO * largest)
    shade = (change <= bound).all(axis=-1) & (shadow | coarse[asked])
    near = np.abs(own.depth - seen.depth)[asked] <= off + np.ptp(far, axis=0)
    near &= np.linalg.norm((own.normal - seen.normal)[asked], axis=1) <= np.linalg.norm(turn, axis=1) + ROUNDING
    lit, alike = np.zeros((2, *asked.shape), bool)
    lit[asked], alike[asked] = np.where(other, found, shade), np.where(other, found, near)
    mean = np.where(lit[..., None], reference.mean, test.mean)
    if test.surface is None:
        return replace(test, mean=mean), lit
    parts = np.where(alike, seen.ids, own.ids), np.where(alike, seen.depth, own.depth)
    surface = Surface(*parts, np.where(alike[..., None], seen.normal, own.normal))
    return replace(test, mean=mean, surface=surface), lit
