"""Where the shadow of one object falls on another: a caster slid along the sun's rays, before any pixel is traced."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from raytwin.scene import Scene, Shape, Sphere

GRAZING = 1e-3
"""The least n · l of the light on a plane; below it, a shadow is taken to reach anywhere."""


class CastShadow(NamedTuple):
    """Shadows of k pairs. `meets` (k,): the ray from the caster's middle, away from the light, meets the shaded object
    (a rectangle's plane), and does so at `middle` (k, 3). `axes` (k, 2, 3): the caster's half-axes, slid into the plane
    that touches there. `reach` (k,): no point of the shadow in that plane lies farther from the middle."""

    meets: np.ndarray
    middle: np.ndarray
    axes: np.ndarray
    reach: np.ndarray


def fall(scene: Scene, shaded: np.ndarray, caster: np.ndarray) -> CastShadow:
    """The shadows of the objects `caster` (k,) on `shaded` (k,). One whose middle passes a sphere by shades it
    beside the terminator at most."""
    things, light = scene.objects, np.array(scene.sun.to_light)
    center = np.array([thing.center for thing in things]).reshape(-1, 3)
    radius = np.array([thing.radius if isinstance(thing, Sphere) else 0.0 for thing in things])
    off, r = center[caster] - center[shaded], radius[shaded, None]
    across = off - (off @ light)[:, None] * light
    far = np.linalg.norm(across, axis=1, keepdims=True)
    on_sphere = across + np.sqrt(np.maximum(r**2 - far**2, 0)) * light
    flat = np.array([light if isinstance(thing, Sphere) else thing.normal for thing in things])[shaded]
    flat = flat * np.where(flat @ light < 0, -1, 1)[:, None]
    on_plane = off - light * (off * flat).sum(axis=1, keepdims=True) / np.maximum((flat @ light)[:, None], 1e-9)
    is_round = r > 0
    n = np.where(is_round, on_sphere / np.maximum(r, 1e-300), flat)
    axes = half_axes(things, np.broadcast_to(light, center.shape))[caster]
    steep = n @ light
    axes = axes - light * (axes @ n[:, :, None]) / np.maximum(steep, GRAZING)[:, None, None]
    # An ellipse's larger half-axis is at most the root of the sum of their squares; a parallelogram reaches their sum.
    sides = np.linalg.norm(axes, axis=2)
    reach = np.where(radius[caster] > 0, np.hypot(*sides.T), sides.sum(axis=1))
    reach[steep < GRAZING] = np.inf
    middle = center[shaded] + np.where(is_round, on_sphere, on_plane)
    return CastShadow(((far < r) | ~is_round)[:, 0], middle, axes, reach)


def half_axes(things: Sequence[Shape], along: np.ndarray) -> np.ndarray:
    """(n, 2, 3): a rectangle's half-edges; a sphere's radius, twice, perpendicular to `along` (n, 3)."""
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    side = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-300)
    round_ = np.stack([side, np.cross(along, side)], axis=1)
    return np.array(
        [thing.radius * axes if isinstance(thing, Sphere) else (thing.half_u, thing.half_v)
         for thing, axes in zip(things, round_, strict=True)]
    ).reshape(-1, 2, 3)  # fmt: skip
