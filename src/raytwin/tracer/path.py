"""The rendering equation by random walks: what a surface sends to the eye is the light that reaches it, once more.

    L(x) = ρ/π ∫ L_in(x, ω) max(0, n·ω) dω        L_in(x, ω) = L(first surface along ω), or the sky where there is none

The sun is a single direction, which no random ray finds: its part E V max(0, n·l) is added at every surface. The other
directions are drawn with density max(0, n·ω) / π, so that the cosine and the π cancel, and what is left of the integral
is the mean of ρ L_in (Kajiya, "The Rendering Equation", 1986; Pharr, Jakob and Humphreys, pbrt 4, chapters 13 and 14).
With a highlight π f(ω) stands for ρ. The light of a map is looked for in two ways, each weighed by its own density's
share of both (Veach's balance heuristic).
"""

from collections.abc import Callable
from math import pi
from typing import Any

from raytwin.arrays import Vec, cos, dot, maximum, repeat, select, sin, sqrt
from raytwin.tracer.hit import Gloss, Hit, World
from raytwin.tracer.shading import Lighting, reflectance

Draw = Callable[[Any], tuple[Any, Any]]
"""number of the bounce, from 1 -> two random numbers in [0, 1)."""


def follow(
    hit: Hit, light: Lighting, world: World, draw: Draw, depth: Any, parts: int = 1, even: Any = None
) -> list[Vec]:
    """Light (r, g, b) by the surfaces that it met: [of 1, of 2, ...], the last of `parts` and more; 0 where none is.

    `hit` is what the eye's ray met first. `depth` counts as Mitsuba's does: 2 is light, surface, eye. `even`, where
    given, is `occlusion.sky_left` of it: the sky's light at the first surface, where no chance is needed.
    """
    world, values = world.beyond(), 3 * parts
    left, known = even or (0.0, False)

    def bounce(k: Any, *state: Any) -> tuple[Any, ...]:
        """At one surface, the first for k = 0; and along a random ray to the next."""
        here, found = unpacked(state[:-values]), state[-values:]
        d = to_unit(about(here.normal, *draw(k + 1)))
        there, onto = world.onward(here, d), reflectance(here, d)
        met = there.ids >= 0
        dark = met | known & (k == 0) if even else met
        lit = zip(sunlight(here, light, world), onto, sky_along(here, light, d), strict=True)
        brought = [sun + r * select(dark, 0.0, sky) for sun, r, sky in lit]
        if light.around is not None:
            brought = [x + sky for x, sky in zip(brought, drawn_sky(here, light, world, *draw(~k)), strict=True)]
        now = [k == part for part in range(parts - 1)] + [k >= parts - 1]
        found = tuple(sofar + select(now[i // 3], brought[i % 3], 0.0) for i, sofar in enumerate(found))
        return (*packed(there, onto), *found)

    start, found = packed(hit, (1.0, 1.0, 1.0)), [0 * hit.point[0]] * values
    if even:
        found[:3] = (select(known, rho * left * sky, 0.0) for rho, sky in zip(start[8:], light.sky, strict=True))
    end = repeat(depth - 1, bounce, (*start, *found), lambda *state: state[6] >= 0)[-values:]
    return [(end[i], end[i + 1], end[i + 2]) for i in range(0, values, 3)]


def packed(hit: Hit, onto: Vec) -> tuple[Any, ...]:
    """What a walk carries from one surface to the next: its colours times `onto`, what those before sent on."""

    def times(colour: Vec) -> tuple[Any, ...]:
        return tuple(select(hit.ids >= 0, o * c, 0.0) for o, c in zip(onto, colour, strict=True))

    lambertian = (*hit.point, *hit.normal, hit.ids, hit.inside, *times(hit.albedo))
    return lambertian if hit.gloss is None else (*lambertian, *hit.d, *times(hit.gloss.specular), hit.gloss.exponent)


def unpacked(state: tuple[Any, ...]) -> Hit:
    gloss = Gloss(state[14:17], state[17]) if len(state) > 11 else None
    return Hit(0.0, state[6], state[:3], state[3:6], state[8:11], state[7], state[11:14], gloss)


def sunlight(hit: Hit, light: Lighting, world: World) -> Vec:
    """f E V max(0, n·l): what each point sends on of the sun."""
    share = world.stages.sun_visible(hit, light, world) * maximum(dot(hit.normal, light.to_sun), 0.0) * (1 / pi)
    return tuple(share * E * r for E, r in zip(light.irradiance, reflectance(hit, light.to_sun), strict=True))


def sky_along(hit: Hit, light: Lighting, d: Vec) -> Vec:
    """The sky along a direction of `about`; a map's weighed by p / (p + the density with which it is drawn)."""
    if light.around is None:
        return light.sky
    p = dot(hit.normal, d) / pi
    share = p / (p + light.around.density_at(d))
    return tuple(share * L for L in light.around.radiance(d))


def drawn_sky(hit: Hit, light: Lighting, world: World, a: Any, b: Any) -> Vec:
    """f L V n·ω / (p + max(0, n·ω) / π) for a direction drawn with density p by the map's luminance."""
    assert light.around is not None
    d, p = light.around.draw(a, b)
    cosine = maximum(dot(hit.normal, d), 0.0) * (1 / pi)
    share = select((cosine > 0) & ~world.blocked(hit, d), cosine / (p + cosine), 0.0)
    return tuple(share * r * L for r, L in zip(reflectance(hit, d), light.around.radiance(d), strict=True))


def to_unit(d: Vec) -> Vec:
    """d (3 - d·d) / 2: of nearly unit length made unit, as far as floats tell, by one of Newton's steps.

    Or the length's error, which is the normal's, would grow by t/r from sphere to sphere.
    """
    scale = 1.5 - 0.5 * dot(d, d)
    return d[0] * scale, d[1] * scale, d[2] * scale


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
