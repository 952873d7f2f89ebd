"""Where a ray meets a sphere: |f + t d|² = r², with f from the sphere's centre to the ray's origin and d a unit vector.

Expanded, t² + 2 (f·d) t + (f·f - r²) = 0. Four ways to solve it stand side by side, because how they fail is a subject
of its own: compare them with a far sphere in float32. To add one, write the function and add its row to SOLVERS.
"""

from collections.abc import Callable
from typing import Any

from raytwin.scene import Sphere
from raytwin.tracer.arrays import Vec, dot, maximum, select, sqrt

INFINITY = float("inf")


def textbook(f: Vec, d: Vec, r: Any) -> tuple[Any, Any, Any]:
    """t = (-b ± √(b² - 4c)) / 2. Subtracts nearly equal numbers twice: in the discriminant, and in -b + √..."""
    b, _, disc, root = _quadratic(f, d, r)
    return disc >= 0, (-b - root) / 2, (-b + root) / 2


def paper(f: Vec, d: Vec, r: Any) -> tuple[Any, Any, Any]:
    """q = -(b + sign(b) √disc) / 2, t = q and c / q, with sign(0) = 0: at b = 0 it finds q = 0, which is no root."""
    b, c, disc, root = _quadratic(f, d, r)
    q = -(b + select(b > 0, root, select(b < 0, -root, 0 * root))) / 2
    return disc >= 0, *_roots_of_q(b, c, q)


def stable(f: Vec, d: Vec, r: Any) -> tuple[Any, Any, Any]:
    """The same q with sign(0) = 1: no cancellation in -b ± √disc, but the discriminant still loses its digits."""
    b, c, disc, root = _quadratic(f, d, r)
    q = -(b + select(b >= 0, root, -root)) / 2
    return disc >= 0, *_roots_of_q(b, c, q)


def _quadratic(f: Vec, d: Vec, r: Any) -> tuple[Any, Any, Any, Any]:
    b, c = 2 * dot(f, d), dot(f, f) - r * r
    disc = b * b - 4 * c
    return b, c, disc, sqrt(maximum(disc, 0.0))


def _roots_of_q(b: Any, c: Any, q: Any) -> tuple[Any, Any]:
    other = c / select(q == 0, 1.0, q)
    return select(b > 0, q, other), select(b > 0, other, q)


def robust(f: Vec, d: Vec, r: Any) -> tuple[Any, Any, Any]:
    """disc = r² - |f - (f·d) d|², c = (|f| - r)(|f| + r): from lengths, not from differences of large squares.

    Haines, Günther and Akenine-Möller, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, ch. 7.
    """
    b = -dot(f, d)
    along = (f[0] + b * d[0], f[1] + b * d[1], f[2] + b * d[2])
    disc = r * r - dot(along, along)
    length = sqrt(dot(f, f))
    c = (length - r) * (length + r)
    root = sqrt(maximum(disc, 0.0))
    q = b + select(b >= 0, root, -root)
    other = c / select(q == 0, 1.0, q)
    return disc >= 0, select(b >= 0, other, q), select(b >= 0, q, other)


SOLVERS: dict[str, Callable[[Vec, Vec, Any], tuple[Any, Any, Any]]] = {
    "textbook": textbook,
    "paper": paper,
    "stable": stable,
    "robust": robust,
}
"""name -> (f, d, r) -> (is there a root, nearer t, farther t)."""


def intersect_sphere(origin: Vec, d: Vec, sphere: Sphere, solver: str = "robust") -> Any:
    """The least t > 0 with |origin + t d - centre| = radius: metres along the unit direction; infinity for a miss."""
    cx, cy, cz = sphere.center
    f = (origin[0] - cx, origin[1] - cy, origin[2] - cz)
    hit, near, far = SOLVERS[solver](f, d, sphere.radius)
    t = select(near > 0, near, far)
    return select(hit & (t > 0), t, INFINITY)


def sphere_normal(p: Vec, sphere: Sphere) -> Vec:
    """(p - centre) / radius: unit, outwards."""
    cx, cy, cz = sphere.center
    r = sphere.radius
    return ((p[0] - cx) / r, (p[1] - cy) / r, (p[2] - cz) / r)
