"""What the twin's float32 cannot tell: single pixels at outlines, objects of extreme size, the sides of sharp highlights.

Float32 puts a point off by δ = 2⁻²² (its distance from the origin + its sphere's radius): a quarter of that is the
rounding of one coordinate, and the largest errors of 400 random scenes lie between the two. Of the surface, depth errs
by δ / cos θ and a sphere's normal by δ / (r cos θ), θ between the normal and the ray.
"""

from dataclasses import replace

import numpy as np

from raytwin.image import Image, Surface
from raytwin.scene import Phong, Rectangle, Scene, Sphere
from raytwin.twin.rays import directions, lens_of
from raytwin.twin.twin_scene import place_of

ROUNDING = 2.0**-22

SMALL, LARGE = 128.0, 16.0
"""Distance from the origin over a sphere's radius, and radius over the eye's distance from the surface, beyond which an
object is said to be in single precision. At 128 a rim's normal is off by 5e-6; at 16 the surface by 1e-6 of its
distance."""


def settle(test: Image, reference: Image, scene: Scene) -> tuple[Image, np.ndarray | None, tuple[str, ...]]:
    """The test with the twin's answer where float32 cannot tell, what its rounding may add to radiance, and what to say.

    The second is (H, W, 3), None where nothing matters. `reference` is the twin's image of the scene.
    """
    surface = reference.surface
    if surface is None or not scene.objects:
        return test, None, ()
    said = []
    if test.surface is not None and test.surface.ids.shape == surface.ids.shape:
        undecided = _undecided(scene, test.surface, surface)
        if undecided.any():
            test = _with(test, reference, undecided)
            count = int(np.count_nonzero(undecided))
            said.append(f"{count} pixel{'s' * (count > 1)} on an outline, where single precision cannot tell: not compared")
    extreme = _extreme(scene)
    granted = _highlights(scene, surface) if scene.glossy else None
    pixels = np.flatnonzero(np.isin(surface.ids.ravel(), list(extreme)))
    if pixels.size:
        test, more = _granted(test, reference, scene, pixels, extreme)
        granted = more if granted is None else granted + more
        names = ", ".join(f"object {i}" for i in sorted(set(surface.ids.ravel()[pixels].tolist())))
        said.append(
            f"single precision: {pixels.size} pixels of {names}, whose size float32 holds to {max(extreme.values()):.1g} "
            "of its distance, are compared with that in mind"
        )
    return test, granted, tuple(said)


def highlight_rounding(scene: Scene, surface: Surface) -> np.ndarray:
    """By how much float32 may put the sun's highlight off at each pixel (H, W, 3): |∂L/∂(r·v)| times the error of r·v.

    A normal errs by δ / r, and r·v by 4 times that at most. A sharp lobe makes n / (r·v) times as much of it, where
    Lambert's law makes 1.
    """
    return _highlights(scene, surface)


def _rays(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """The unit directions (k, 3), board axes, through the centres of the pixels of these numbers, row by row."""
    v, u = np.divmod(pixels, scene.camera.width)
    d = directions(np, lens_of(scene.camera), u.astype(float), v.astype(float))
    return np.asarray(np.stack(d, axis=1) @ np.asarray(scene.camera.R_cam_board))


def _extreme(scene: Scene) -> dict[int, float]:
    """The spheres whose surface float32 holds badly: id -> δ in metres."""
    origin, eye = place_of(scene).origin, np.asarray(scene.camera.eye)
    found = {}
    for i, thing in enumerate(scene.objects):
        if isinstance(thing, Sphere):
            reach = float(np.linalg.norm(thing.center - origin))
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
    cosine = np.maximum(-(normal * _rays(scene, pixels)).sum(axis=1), 1e-3)
    error = np.array([extreme.get(i, 0.0) for i in range(len(scene.objects))])[ids] / cosine
    radius = np.array([getattr(thing, "radius", np.inf) for thing in scene.objects])[ids]
    albedo = np.array([thing.material.albedo for thing in scene.objects])[ids]
    granted = np.zeros((surface.ids.size, 3), np.float32)
    granted[pixels] = (error / radius)[:, None] * albedo * np.asarray(scene.sun.irradiance) / np.pi
    if (own := test.surface) is not None and own.ids.shape == surface.ids.shape:
        depth, normals = own.depth.copy().ravel(), own.normal.copy().reshape(-1, 3)
        near = (own.ids.ravel()[pixels] == ids) & (abs(depth[pixels] - surface.depth.ravel()[pixels]) <= error)
        alike = near & (np.linalg.norm(normals[pixels] - normal, axis=1) <= error / radius)
        depth[pixels[near]] = surface.depth.ravel()[pixels[near]]
        normals[pixels[alike]] = normal[alike]
        shape = own.ids.shape
        test = replace(test, surface=Surface(own.ids, depth.reshape(shape), normals.reshape(*shape, 3)))
    return test, granted.reshape(test.shape)


def _undecided(scene: Scene, test: Surface, reference: Surface) -> np.ndarray:
    """Where the two see unlike objects and the ray passes an outline of one of them within rounding: (H, W)."""
    undecided = np.zeros(test.ids.size, bool)
    origin, eye = place_of(scene).origin, np.asarray(scene.camera.eye)
    differ = np.flatnonzero(test.ids != reference.ids)
    for pixel, d in zip(differ, _rays(scene, differ), strict=True):
        for i in {int(test.ids.flat[pixel]), int(reference.ids.flat[pixel])} & set(range(len(scene.objects))):
            thing = scene.objects[i]
            to, away = np.subtract(thing.center, eye), float(np.linalg.norm(np.subtract(thing.center, origin)))
            if isinstance(thing, Rectangle):
                t = (to @ thing.normal) / (d @ thing.normal)
                off = min(
                    abs(abs((t * d - to) @ np.asarray(edge)) / np.linalg.norm(edge) - np.linalg.norm(edge))
                    for edge in (thing.half_u, thing.half_v)
                ) * abs(d @ thing.normal)  # fmt: skip
                size = float(np.hypot(np.linalg.norm(thing.half_u), np.linalg.norm(thing.half_v)))
            else:
                off, size = abs(np.linalg.norm(to - (to @ d) * d) - thing.radius), thing.radius
            undecided[pixel] |= bool(off < ROUNDING * (away + size))
    return undecided.reshape(test.ids.shape)


def _with(test: Image, reference: Image, chosen: np.ndarray) -> Image:
    """The test image with the reference's pixels where `chosen`."""
    own, other, wide = test.surface, reference.surface, chosen[..., None]
    assert own is not None
    assert other is not None
    parts = np.where(chosen, other.ids, own.ids), np.where(chosen, other.depth, own.depth)
    surface = Surface(*parts, np.where(wide, other.normal, own.normal))
    return replace(test, mean=np.where(wide, reference.mean, test.mean), surface=surface)


def _highlights(scene: Scene, surface: Surface) -> np.ndarray:
    granted = np.zeros((surface.ids.size, 3), np.float32)
    origin, to_light = place_of(scene).origin, np.asarray(scene.sun.to_light)
    for i, thing in enumerate(scene.objects):
        if not isinstance(thing.material, Phong):
            continue
        pixels = np.flatnonzero(surface.ids.ravel() == i)
        n, d, power = surface.normal.reshape(-1, 3)[pixels], _rays(scene, pixels), thing.material.exponent
        reach = np.linalg.norm(np.subtract(thing.center, origin)) / getattr(thing, "radius", np.inf)
        facing = np.maximum(n @ to_light, 0)
        along = np.clip(2 * (n @ to_light) * -(n * d).sum(axis=1) + d @ to_light, 1e-3, 1)
        steep = (power + 2) / (2 * np.pi) * power * along ** (power - 1) * facing * 4 * ROUNDING * (1 + reach)
        granted[pixels] = steep[:, None] * np.asarray(thing.material.specular) * np.asarray(scene.sun.irradiance)
    return granted.reshape(*surface.ids.shape, 3)
