"""What a surface point sends back: Lambert's law, the sun's visibility, and the rungs of light transport."""

from collections.abc import Callable
from math import pi
from typing import Any

from raytwin.scene import Scene
from raytwin.tracer.arrays import Vec, dot, maximum, select, unit
from raytwin.tracer.camera import to_board
from raytwin.tracer.hit import Hit, intersect
from raytwin.tracer.objects import Listed, Walked
from raytwin.tracer.sphere import INFINITY


def lambert(albedo: Any, normal: Vec, to_light: Vec, irradiance: Any, visible: Any, sky: Any) -> Any:
    """L = albedo/π E V max(0, n·l) + albedo Lₛ: one colour channel of a Lambertian surface under sun and open sky.

    `normal` n, `to_light` l: unit. `irradiance` E: what a surface that faces the sun receives; `visible` V: 1 where the
    sun is seen; `sky` Lₛ: the sky's radiance. A sky of constant radiance gives irradiance π Lₛ, and albedo/π times that
    is albedo Lₛ.
    """
    return albedo / pi * irradiance * visible * maximum(dot(normal, to_light), 0.0) + albedo * sky


def sun_visible(hit: Hit, scene: Scene, casters: Listed | Walked, solver: str = "robust") -> Any:
    """1 where the way from each hit point to the sun is free of `casters`, else 0.

    No offset along the normal is needed: a convex object never shades a point of itself that faces the sun from
    outside, so each object is left out of its own test; seen from inside, a sphere shades itself always.
    """
    to_light = unit(scene.sun.to_light)

    def block(state, index, thing):
        t = intersect(hit.point, to_light, thing, solver)
        return (state[0] | ((hit.ids != index) & (t < INFINITY)),)

    (blocked,) = casters.fold((hit.inside,), block)
    return select(blocked, 0.0, 0 * hit.point[0] + 1)


def surface_colour(hit: Hit, scene: Scene, casters: Listed | Walked, solver: str) -> Vec:
    """(n + 1) / 2: the board frame's normal as a colour, so that the rung without light can be looked at too."""
    return tuple((n + 1) / 2 for n in to_board(hit.normal, scene.camera))


def lambert_radiance(hit: Hit, scene: Scene, casters: Listed | Walked, solver: str) -> Vec:
    """Sun without shadows and sky without occlusion: the paper's model."""
    return _direct(hit, scene, 1.0)


def shadow_radiance(hit: Hit, scene: Scene, casters: Listed | Walked, solver: str) -> Vec:
    """The same, with shadows cast by the sun."""
    return _direct(hit, scene, sun_visible(hit, scene, casters, solver))


def _direct(hit: Hit, scene: Scene, visible: Any) -> Vec:
    to_light = unit(scene.sun.to_light)
    lights = zip(hit.albedo, scene.sun.irradiance, scene.sky.radiance, strict=True)
    return tuple(lambert(rho, hit.normal, to_light, E, visible, sky) for rho, E, sky in lights)


RUNGS: dict[str, Callable[[Hit, Scene, Listed | Walked, str], Vec]] = {
    "surface": surface_colour,
    "lambert": lambert_radiance,
    "shadow": shadow_radiance,
}
"""name -> (hit, scene, casters, solver) -> radiance (r, g, b); hit and sun are in the camera's frame.

To add a rung, write its function and add its row.
"""
