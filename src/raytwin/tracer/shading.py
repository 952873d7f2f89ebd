"""What a surface point sends back: Lambert's law, the highlight, the sun's visibility, and the rungs of the ladder."""

from collections.abc import Callable
from math import pi
from typing import Any

from raytwin.scene import Camera
from raytwin.tracer.arrays import Vec, cosine, dot, maximum, power, select
from raytwin.tracer.hit import Hit, World
from raytwin.tracer.lights import Lighting
from raytwin.tracer.pixel_to_ray import to_board


def lambert(albedo: Any, normal: Vec, to_light: Vec, irradiance: Any, visible: Any, sky: Any) -> Any:
    """L = albedo/π E V max(0, n·l) + albedo Lₛ: one colour channel of a Lambertian surface under sun and open sky.

    `normal` n, `to_light` l: unit. `irradiance` E: what a surface that faces the sun receives; `visible` V: 1 where the
    sun is seen; `sky` Lₛ: the sky's radiance. A sky of constant radiance gives irradiance π Lₛ, and albedo/π times that
    is albedo Lₛ.
    """
    return albedo / pi * irradiance * visible * cosine(normal, to_light) + albedo * sky


def highlight(hit: Hit, to_light: Vec) -> Vec:
    """share (n + 2)/2 max(0, r·v)ⁿ: π times Phong's highlight, with r = 2 (n·l) n - l and v = -d.

    The power would multiply r·v's rounding by n. So r·v = 1 - x with x = |r - v|²/2, which is small and exact, and what
    rounding 1 - x loses is added back: (a + b)ⁿ = aⁿ (1 + n b) for a near 1 and a tiny b.
    """
    assert hit.specular is not None
    share, exponent = hit.specular
    twice = 2 * dot(hit.normal, to_light)
    apart = tuple(twice * n - to + d for n, to, d in zip(hit.normal, to_light, hit.d, strict=True))
    x = dot(apart, apart) / 2
    along = maximum(1 - x, 0.0)
    lobe = (exponent + 2) / 2 * power(along, exponent) * (1 + exponent * ((1 - along) - x))
    return share[0] * lobe, share[1] * lobe, share[2] * lobe


def reflectance(hit: Hit, to_light: Vec) -> Vec:
    """π f: the albedo, plus the highlight where there is one."""
    if hit.specular is None:
        return hit.albedo
    r, g, b = (rho + h for rho, h in zip(hit.albedo, highlight(hit, to_light), strict=True))
    return r, g, b


def sun_visible(hit: Hit, light: Lighting, world: World) -> Any:
    """V: 1 where nothing blocks the way from the hit point to the sun, else 0."""
    return select(world.blocked(hit, light.to_sun), 0.0, 0 * hit.point[0] + 1)


def surface_colour(hit: Hit, light: Lighting, world: World, camera: Camera) -> Vec:
    """(n + 1) / 2: the board frame's normal as a colour, which makes the rung without light a picture too."""
    return tuple((n + 1) / 2 for n in to_board(hit.normal, camera))


def lambert_radiance(hit: Hit, light: Lighting, world: World, camera: Camera) -> Vec:
    """Sun without shadows and sky without occlusion: the paper's model."""
    return _direct(hit, light, world, 1.0)


def shadow_radiance(hit: Hit, light: Lighting, world: World, camera: Camera) -> Vec:
    """The same, with shadows cast by the sun."""
    return _direct(hit, light, world, world.stages.sun_visible(hit, light, world))


def _direct(hit: Hit, light: Lighting, world: World, visible: Any) -> Vec:
    """Lambert's law under the sun and an open sky, and the highlight, which reflects its share of the open sky."""
    sky = light.sky.diffuse_irradiance(hit.normal)
    channels = zip(hit.albedo, light.irradiance, sky, strict=True)
    L = tuple(world.stages.lambert(rho, hit.normal, light.to_sun, E, visible, Ls) for rho, E, Ls in channels)
    if hit.specular is None:
        return L
    lit = visible * cosine(hit.normal, light.to_sun) / pi
    terms = zip(L, highlight(hit, light.to_sun), light.irradiance, hit.specular.share, sky, strict=True)
    return tuple(x + h * E * lit + k * Ls for x, h, E, k, Ls in terms)


Radiance = Callable[[Hit, Lighting, World, Camera], Vec]
RADIANCE: dict[str, Radiance] = {"surface": surface_colour, "lambert": lambert_radiance, "shadow": shadow_radiance}
"""Name of a rung -> (hit, light, world, camera) -> radiance (r, g, b); hit and light are in the camera's frame.

To add a rung, write its function, and add its row here and in `raytwin.rungs`.
"""
