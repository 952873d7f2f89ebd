"""Where a ray meets a rectangle: t = n·(c - o) / n·d, if that point lies within both half-edges."""

from typing import Any

from raytwin.scene import Rectangle
from raytwin.tracer.arrays import INFINITY, Vec, cross, dot, select


def intersect_rectangle(origin: Vec, d: Vec, rectangle: Rectangle) -> Any:
    """Return the t > 0 with origin + t d on the rectangle: metres along the unit direction; infinity for a miss."""
    u, v = rectangle.half_u, rectangle.half_v
    n = cross(u, v)
    f = tuple(c - o for c, o in zip(rectangle.center, origin, strict=True))
    slope = dot(n, d)
    t = dot(n, f) / select(slope == 0, 1.0, slope)
    # From the centre to the point; its share of each half-edge is a projection divided by that edge's length.
    q = tuple(t * a - b for a, b in zip(d, f, strict=True))
    a, b = dot(q, u) / dot(u, u), dot(q, v) / dot(v, v)
    inside = (a >= -1) & (a <= 1) & (b >= -1) & (b <= 1)
    return select((slope != 0) & (t > 0) & inside, t, INFINITY)
