"""The rendering equation by path tracing: a surface sends to the eye a part of all light that reaches it.

    L(x) = ρ/π ∫ L_in(x, ω) max(0, n·ω) dω        L_in(x, ω) = L(first surface along ω), or the sky where there is none

The sun is a single direction, which no random ray finds: its part E V max(0, n·l) is added at every surface. The other
directions have density max(0, n·ω) / π, which cancels the cosine and the π: the integral is the mean of ρ L_in (Kajiya,
"The Rendering Equation", 1986; Pharr, Jakob and Humphreys, pbrt 4, chapters 13 and 14). A highlight puts π f(ω) in the
place of ρ. An environment map is sampled in two ways, by the cosine and by its own luminance, each weighted by its
density's share of both (Veach's balance heuristic).
"""

from collections.abc import Callable
from math import pi
from typing import Any

from raytwin.tracer.arrays import Vec, cos, cosine, dot, plus, repeat, select, sin, sqrt, unit_again
from raytwin.tracer.hit import Hit, Specular, World
from raytwin.tracer.lights import Lighting
from raytwin.tracer.shading import reflectance
from raytwin.tracer.world import next_hit

Draw = Callable[[Any], tuple[Any, Any]]
"""Number -> two random numbers in [0, 1): 0 places the ray in its pixel, k > 0 aims the k-th bounce, ~k a sky ray."""


def radiance_along_path(hit: Hit, light: Lighting, world: World, draw: Draw, depth: Any) -> Vec:
    """L of what the eye's ray meets first, `hit`; 0 where that is nothing.

    `depth` counts as Mitsuba's does: 2 is light, surface, eye.
    """
    zero = 0 * hit.point[0]
    r, g, b = sum_along_path(hit, light, world, draw, depth, (zero, zero, zero), lambda k, total, L: plus(total, L))
    return r, g, b


def sum_along_path(
    hit: Hit, light: Lighting, world: World, draw: Draw, depth: Any, total: Any, add: Callable[[Any, Any, Vec], Any]
) -> Any:
    """total = add(k, total, the direct light that the k-th surface after `hit` sends on to the eye)."""

    def step(k: Any, *state: Any) -> tuple[Any, ...]:
        here, total = carried(state[:-1]), state[-1]
        direct, there, onto = bounce(k, here, light, world, draw)
        return *carry(there, onto), add(k, total, direct)

    return repeat(depth - 1, step, (*carry(hit, (1.0, 1.0, 1.0)), total), lambda ids, *_: ids >= 0)[-1]


def bounce(k: Any, here: Hit, light: Lighting, world: World, draw: Draw) -> tuple[Vec, Hit, Vec]:
    """At one surface, the first for k = 0: what it sends on of the direct light, what a random ray from it meets next,
    and the share of that surface's light that it sends on."""
    d = unit_again(sample_cosine_hemisphere(here.normal, *draw(k + 1)))
    there, onto = next_hit(world, here, d), reflectance(here, d)
    parts = zip(sunlight(here, light, world), onto, sky_along(here, light, d), strict=True)
    direct = tuple(sun + r * select(there.ids >= 0, 0.0, sky) for sun, r, sky in parts)
    if light.sky.sampled:
        sampled = sample_environment(here, light, world, *draw(~k))
        direct = tuple(L + sky for L, sky in zip(direct, sampled, strict=True))
    return direct, there, onto


def carry(hit: Hit, onto: Vec) -> tuple[Any, ...]:
    """What a path takes along from a surface: its colours times `onto`, what the surfaces before send on."""

    def times(colour: Vec) -> tuple[Any, ...]:
        return tuple(select(hit.ids >= 0, o * c, 0.0) for o, c in zip(onto, colour, strict=True))

    highlight = () if hit.specular is None else (times(hit.specular.share), hit.specular.exponent)
    return hit.ids, hit.point, hit.normal, times(hit.albedo), hit.inside, hit.d, *highlight


def carried(state: tuple[Any, ...]) -> Hit:
    """The surface that `carry` took along."""
    ids, point, normal, albedo, inside, d, *highlight = state
    return Hit(0.0, ids, point, normal, albedo, inside, d, Specular(*highlight) if highlight else None)


def sunlight(hit: Hit, light: Lighting, world: World) -> Vec:
    """π f E V max(0, n·l) / π: what each point sends on of the sun."""
    share = world.stages.sun_visible(hit, light, world) * cosine(hit.normal, light.to_sun) * (1 / pi)
    return tuple(share * E * r for E, r in zip(light.irradiance, reflectance(hit, light.to_sun), strict=True))


def sky_along(hit: Hit, light: Lighting, d: Vec) -> Vec:
    """The sky's radiance along a cosine-weighted direction; a sampled sky's weighted by p / (p + its own density)."""
    if not light.sky.sampled:
        return light.sky.radiance(d)
    p = dot(hit.normal, d) / pi
    share = p / (p + light.sky.density(d))
    return tuple(share * L for L in light.sky.radiance(d))


def sample_environment(hit: Hit, light: Lighting, world: World, a: Any, b: Any) -> Vec:
    """π f L V n·ω/π / (p + max(0, n·ω) / π) for a direction that the sky itself samples with density p."""
    d, p = light.sky.sample(a, b)
    own = cosine(hit.normal, d) * (1 / pi)
    share = select((own > 0) & ~world.blocked(hit, d), own / (p + own), 0.0)
    return tuple(share * r * L for r, L in zip(reflectance(hit, d), light.sky.radiance(d), strict=True))


def sample_cosine_hemisphere(normal: Vec, a: Any, b: Any) -> Vec:
    """A unit direction about the unit `normal`, with density max(0, n·ω) / π, from two numbers in [0, 1).

    A point of the unit disk, raised to the hemisphere (Malley), in a frame without branches (Duff et al., "Building an
    Orthonormal Basis, Revisited", JCGT 6(1), 2017).
    """
    nx, ny, nz = normal
    x, y, z = sqrt(a) * cos(2 * pi * b), sqrt(a) * sin(2 * pi * b), sqrt(1 - a)
    sign = select(nz >= 0, 1.0, -1.0)
    s = -1 / (sign + nz)
    t = nx * ny * s
    return (
        x * (1 + sign * nx * nx * s) + y * t + z * nx,
        x * sign * t + y * (sign + ny * ny * s) + z * ny,
        -x * sign * nx - y * ny + z * nz,
    )
