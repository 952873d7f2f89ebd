"""The rendering equation by random walks: what a surface sends to the eye is the light that reaches it, once more.

    L(x) = ρ/π ∫ L_in(x, ω) max(0, n·ω) dω        L_in(x, ω) = L(first surface along ω), or the sky where there is none

The sun is a single direction, which no random ray finds: its part E V max(0, n·l) is added at every surface. The other
directions are drawn with density max(0, n·ω) / π, so that the cosine and the π cancel, and what is left of the integral
is the mean of ρ L_in (Kajiya, "The Rendering Equation", 1986; Pharr, Jakob and Humphreys, pbrt 4, chapters 13 and 14).
"""

from collections.abc import Callable
from math import pi
from typing import Any

from raytwin.tracer.arrays import Vec, cos, dot, maximum, repeat, select, sin, sqrt
from raytwin.tracer.hit import Hit, World
from raytwin.tracer.light import Lighting

Draw = Callable[[Any], tuple[Any, Any]]
"""number of the bounce, from 1 -> two random numbers in [0, 1)."""


def follow(hit: Hit, light: Lighting, world: World, draw: Draw, depth: int, parts: int = 1) -> list[Vec]:
    """Light (r, g, b) by the surfaces that it met: [of 1, of 2, ...], the last of `parts` and more; 0 where none is.

    `hit` is what the eye's ray met first. `depth` counts as Mitsuba's does: 2 is light, surface, eye.
    """
    world, weight = world.beyond(), tuple(select(hit.ids >= 0, rho, 0.0) for rho in hit.albedo)

    def bounce(k: Any, *state: Any) -> tuple[Any, ...]:
        """At one surface, the first for k = 0; and along a random ray to the next."""
        point, normal, (ids, inside), weight, found = state[:3], state[3:6], state[6:8], state[8:11], state[11:]
        here = Hit(0.0, ids, point, normal, weight, inside)
        sun, there = sunlight(here, light, world), world.onward(here, about(normal, *draw(k + 1)))
        met = there.ids >= 0
        brought = [w * (s + select(met, 0.0, sky)) for w, s, sky in zip(weight, sun, light.sky, strict=True)]
        now = [k == part for part in range(parts - 1)] + [k >= parts - 1]
        found = tuple(sofar + select(now[i // 3], brought[i % 3], 0.0) for i, sofar in enumerate(found))
        weight = tuple(select(met, w * rho, 0.0) for w, rho in zip(weight, there.albedo, strict=True))
        return (*there.point, *there.normal, there.ids, there.inside, *weight, *found)

    start = (*hit.point, *hit.normal, hit.ids, hit.inside, *weight, *(0 * hit.point[0],) * 3 * parts)
    found = repeat(depth - 1, bounce, start, lambda *state: state[6] >= 0)[11:]
    return [(found[i], found[i + 1], found[i + 2]) for i in range(0, 3 * parts, 3)]


def sunlight(hit: Hit, light: Lighting, world: World) -> Vec:
    """E/π V max(0, n·l): what the sun adds to each point's light, before its albedo."""
    share = world.stages.sun_visible(hit, light, world) * maximum(dot(hit.normal, light.to_sun), 0.0) * (1 / pi)
    return tuple(share * E for E in light.irradiance)


def about(normal: Vec, a: Any, b: Any) -> Vec:
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
