"""Where a ray meets a rectangle: t = n·(c - o) / n·d, kept if the point lies within both half-edges."""

from typing import Any

from raytwin.scene import Rectangle
from raytwin.tracer.arrays import Vec, dot, select
from raytwin.tracer.sphere import INFINITY


def intersect_plane(origin: Vec, d: Vec, plane: Rectangle) -> Any:
    """The t > 0 at which origin + t d lies on the rectangle, metres along the unit direction; infinity for a miss."""
    u, v = plane.half_u, plane.half_v
    n = cross(u, v)
    f = tuple(c - o for c, o in zip(plane.center, origin, strict=True))
    slope = dot(n, d)
    t = dot(n, f) / select(slope == 0, 1.0, slope)
    # From the centre to the point; its share of each half-edge is a projection divided by that edge's length.
    q = tuple(t * a - b for a, b in zip(d, f, strict=True))
    a, b = dot(q, u) / dot(u, u), dot(q, v) / dot(v, v)
    inside = (a >= -1) & (a <= 1) & (b >= -1) & (b <= 1)
    return select((slope != 0) & (t > 0) & inside, t, INFINITY)


def cross(a: Vec, b: Vec) -> Vec:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
