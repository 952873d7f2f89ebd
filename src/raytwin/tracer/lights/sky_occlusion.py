"""The share of a constant sky that other spheres leave to a surface, where there is a closed form.

A sphere of radius r at the distance d fills, weighed by the cosine with the normal, the share of the hemisphere

    F = 1/π { [c atan2(w, -c q) - w q] / h² + atan2(w, q) }        h = d/r, q = √(h² - 1), w = √max(0, 1 - h² c²)

where c is the cosine between the normal and the direction to its centre: c/h² where it stands wholly above the horizon,
0 where it lies below, and the part above where the horizon cuts it (Howell, "A Catalog of Radiation Heat Transfer
Configuration Factors", section B; there with arc cosines, and case by case). Spheres that do not overlap, as seen from
the point, add up. A rectangle above the horizon, or two spheres that overlap, have no such form: random rays must do.
A point inside a sphere, h < 1, sees no sky, whatever else there is.
"""

from collections.abc import Sequence
from math import pi
from typing import Any, Protocol, runtime_checkable

from raytwin.scene import Rectangle, Shape, Sphere
from raytwin.tracer.arrays import Vec, dot, maximum, select, sqrt
from raytwin.tracer.lights.lookup import arctan2

ROUNDING_MARGIN = 1e-5
"""More than float32's rounding: the sine of the angle above the horizon from which a rectangle's corner counts, and
the part of a distance that a point must lie within a sphere to count as inside.
"""


@runtime_checkable
class Place(Protocol):
    """A surface point of each ray, such as `tracer.Hit`: of the object `ids`, or of a sphere's `inside`."""

    @property
    def ids(self) -> Any: ...
    @property
    def point(self) -> Vec: ...
    @property
    def normal(self) -> Vec: ...
    @property
    def inside(self) -> Any: ...


def sphere_share(h: Any, c: Any) -> Any:
    """F of a sphere whose centre is h radii away, c: see above."""
    q, w = sqrt(maximum((h - 1) * (h + 1), 0.0)), sqrt(maximum((1 - h * c) * (1 + h * c), 0.0))
    return ((c * arctan2(w, -c * q) - w * q) / (h * h) + arctan2(w, q)) / pi


def sky_visibility(hit: Place, objects: Sequence[Shape]) -> tuple[Any, Any]:
    """Return the share of a constant sky that the other objects leave to each point, and where that is known."""
    left, known, enclosed = 0 * hit.point[0] + 1, hit.ids >= 0, hit.inside
    for index, thing in enumerate(objects):
        other = hit.ids != index
        if isinstance(thing, Rectangle):
            known = known & ~(other & _rises(thing, hit))
            continue
        toward, sine, cosine = _seen(thing, hit)
        hides = other & (cosine + sine > 0)
        for second, that in enumerate(objects[index + 1 :], index + 1):
            if isinstance(that, Rectangle):
                continue
            to, wide, level = _seen(that, hit)
            # the angle between them is at least the sum of both half angles, a and b: cos(a + b) from their sines
            both = sqrt(maximum((1 - sine * sine) * (1 - wide * wide), 0.0)) - sine * wide
            apart = (level + wide <= 0) | (hit.ids == second) | (dot(toward, to) <= both)
            known = known & (~hides | apart)
        left = left - select(hides, sphere_share(1 / sine, cosine), 0.0)
        enclosed = enclosed | (other & (sine > 1 + ROUNDING_MARGIN))
    return select(enclosed, 0.0, maximum(left, 0.0)), known | enclosed


def _seen(thing: Sphere, hit: Place) -> tuple[Vec, Any, Any]:
    """The unit direction to the centre, its radius over its distance, the direction's cosine with the normal.

    Seen from outside, the second is the sine of half the angle that the sphere fills; from inside it is above 1.
    """
    f = tuple(c - p for c, p in zip(thing.center, hit.point, strict=True))
    far = sqrt(dot(f, f))
    x, y, z = (a / far for a in f)
    return (x, y, z), thing.radius / far, dot((x, y, z), hit.normal)


def _rises(thing: Rectangle, hit: Place) -> Any:
    """True where any corner is above the horizon."""
    above = hit.ids < -1
    for a in (-1, 1):
        for b in (-1, 1):
            corners = zip(thing.center, thing.half_u, thing.half_v, hit.point, strict=True)
            x, y, z = (c + a * u + b * v - p for c, u, v, p in corners)
            above = above | (dot((x, y, z), hit.normal) > ROUNDING_MARGIN * sqrt(x * x + y * y + z * z))
    return above
