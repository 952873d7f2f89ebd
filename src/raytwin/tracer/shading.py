"""What a surface point sends back: Lambert's law, the sun's visibility, and the rungs of light transport."""

from collections.abc import Callable
from math import pi
from typing import Any, NamedTuple

from raytwin.arrays import Vec, dot, maximum, select
from raytwin.lights.environment_map import Around, around
from raytwin.scene import Camera, Scene
from raytwin.tracer.hit import Hit, World
from raytwin.tracer.pixel_to_ray import to_board


class Lighting(NamedTuple):
    """`to_sun`: unit, in the rays' frame; `irradiance` E of the sun on a surface that faces it; `sky`: its radiance.

    `around`: the map in the place of an even sky, where there is one.
    """

    to_sun: Vec
    irradiance: Vec
    sky: Vec
    around: Around | None = None

    def toward(self, d: Vec) -> Vec:
        """The sky's radiance along d."""
        return self.sky if self.around is None else self.around.radiance(d)

    def even(self, normal: Vec) -> Vec:
        """The radiance of an even sky that would light a surface as much, where nothing hides this one."""
        return self.sky if self.around is None else self.around.even(normal)


def lighting(scene: Scene) -> Lighting:
    if (found := scene.environment) is None:
        return Lighting(scene.sun.to_light, scene.sun.irradiance, scene.sky.radiance)
    return Lighting(scene.sun.to_light, scene.sun.irradiance, (0.0, 0.0, 0.0), around(found))


def lambert(albedo: Any, normal: Vec, to_light: Vec, irradiance: Any, visible: Any, sky: Any) -> Any:
    """L = albedo/π E V max(0, n·l) + albedo Lₛ: one colour channel of a Lambertian surface under sun and open sky.

    `normal` n, `to_light` l: unit. `irradiance` E: what a surface that faces the sun receives; `visible` V: 1 where the
    sun is seen; `sky` Lₛ: the sky's radiance. A sky of constant radiance gives irradiance π Lₛ, and albedo/π times that
    is albedo Lₛ.
    """
    return albedo / pi * irradiance * visible * maximum(dot(normal, to_light), 0.0) + albedo * sky


def highlight(hit: Hit, to_light: Vec) -> Vec:
    """specular (n + 2)/2 max(0, r·v)ⁿ: π times Phong's highlight, with r = 2 (n·l) n - l and v = -d.

    The power would make n times as much of r·v's rounding. So r·v = 1 - x by x = |r - v|²/2, which is small and exact,
    and what rounding 1 - x loses is given back: (a + b)ⁿ = aⁿ (1 + n b) for a near 1 and a tiny b.
    """
    assert hit.gloss is not None
    specular, exponent = hit.gloss
    twice = 2 * dot(hit.normal, to_light)
    apart = tuple(twice * n - to + d for n, to, d in zip(hit.normal, to_light, hit.d, strict=True))
    x = dot(apart, apart) / 2
    along = maximum(1 - x, 0.0)
    lobe = (exponent + 2) / 2 * along**exponent * (1 + exponent * ((1 - along) - x))
    return specular[0] * lobe, specular[1] * lobe, specular[2] * lobe


def reflectance(hit: Hit, to_light: Vec) -> Vec:
    """π f: albedo, and the highlight of what has one."""
    if hit.gloss is None:
        return hit.albedo
    r, g, b = (rho + h for rho, h in zip(hit.albedo, highlight(hit, to_light), strict=True))
    return r, g, b


def sun_visible(hit: Hit, light: Lighting, world: World) -> Any:
    """V: 1 where the way from each hit point to the sun is free, else 0."""
    return select(world.blocked(hit, light.to_sun), 0.0, 0 * hit.point[0] + 1)


def surface_colour(hit: Hit, light: Lighting, world: World, camera: Camera) -> Vec:
    """(n + 1) / 2: the board frame's normal as a colour, so that the rung without light can be looked at too."""
    return tuple((n + 1) / 2 for n in to_board(hit.normal, camera))


def lambert_radiance(hit: Hit, light: Lighting, world: World, camera: Camera) -> Vec:
    """Sun without shadows and sky without occlusion: the paper's model."""
    return _direct(hit, light, world, 1.0)


def shadow_radiance(hit: Hit, light: Lighting, world: World, camera: Camera) -> Vec:
    """The same, with shadows cast by the sun."""
    return _direct(hit, light, world, world.stages.sun_visible(hit, light, world))


def _direct(hit: Hit, light: Lighting, world: World, visible: Any) -> Vec:
    """Lambert's law under the sun and an open sky; of which, by the highlight too, `specular` is sent on."""
    even = light.even(hit.normal)
    channels = zip(hit.albedo, light.irradiance, even, strict=True)
    L = tuple(world.stages.lambert(rho, hit.normal, light.to_sun, E, visible, sky) for rho, E, sky in channels)
    if hit.gloss is None:
        return L
    share = visible * maximum(dot(hit.normal, light.to_sun), 0.0) / pi
    shine = zip(L, highlight(hit, light.to_sun), light.irradiance, hit.gloss.specular, even, strict=True)
    return tuple(x + h * E * share + k * sky for x, h, E, k, sky in shine)


Radiance = Callable[[Hit, Lighting, World, Camera], Vec]
RADIANCE: dict[str, Radiance] = {"surface": surface_colour, "lambert": lambert_radiance, "shadow": shadow_radiance}
"""Name of a rung -> (hit, light, world, camera) -> radiance (r, g, b); hit and light are in the camera's frame.

To add a rung, write its function, and add its row here and in `raytwin.rungs`.
"""
