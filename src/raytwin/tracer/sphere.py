"""Where a ray meets a sphere: |f + t d|² = r², with f from the sphere's centre to the ray's origin and d a unit vector.

Expanded, t² + 2 (f·d) t + (f·f - r²) = 0. Four ways to solve it stand side by side, because how they fail is a subject
of its own: compare them with a far sphere in float32. To add one, write the function and add its row to SOLVERS.

Each returns the discriminant, whose sign says whether the ray meets the sphere, and a function that finds the roots
(near, far) where it does: most rays miss, and Dr.Jit then leaves the rest out (computing the roots of every ray, in
straight-line code, cost it 6 to 13 %).
"""

from collections.abc import Callable
from typing import Any

from raytwin.scene import Sphere
from raytwin.tracer.arrays import INFINITY, Vec, dot, length, maximum, select, sqrt, where_any

Solved = tuple[Any, Callable[[], tuple[Any, Any]]]
"""The discriminant, and the function that finds (near, far)."""


def textbook(f: Vec, d: Vec, r: Any) -> Solved:
    """t = (-b ± √(b² - 4c)) / 2. Subtracts nearly equal numbers twice: in the discriminant, and in -b + √..."""
    b, _, disc = _quadratic(f, d, r)
    return disc, lambda: ((-b - _root(disc)) / 2, (-b + _root(disc)) / 2)


def paper(f: Vec, d: Vec, r: Any) -> Solved:
    """q = -(b + sign(b) √disc) / 2, t = q and c / q, with sign(0) = 0: at b = 0 it finds q = 0, which is no root."""
    b, c, disc = _quadratic(f, d, r)
    return disc, lambda: _by_q(b / 2, c, select(b == 0, 0.0, _root(disc)) / 2, b > 0)


def stable(f: Vec, d: Vec, r: Any) -> Solved:
    """The same q with sign(0) = 1: no cancellation in -b ± √disc, but the discriminant still loses its digits."""
    b, c, disc = _quadratic(f, d, r)
    return disc, lambda: _by_q(b / 2, c, _root(disc) / 2, b >= 0)


def robust(f: Vec, d: Vec, r: Any) -> Solved:
    """disc = r² - |f - (f·d) d|², c = (|f| - r)(|f| + r): from lengths, not from differences of large squares.

    Haines, Günther and Akenine-Möller, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, ch. 7.
    """
    h = dot(f, d)
    along = (f[0] - h * d[0], f[1] - h * d[1], f[2] - h * d[2])
    disc = r * r - dot(along, along)

    def roots() -> tuple[Any, Any]:
        far = length(f)
        return _by_q(h, (far - r) * (far + r), _root(disc), h > 0)

    return disc, roots


def _quadratic(f: Vec, d: Vec, r: Any) -> tuple[Any, Any, Any]:
    b, c = 2 * dot(f, d), dot(f, f) - r * r
    return b, c, b * b - 4 * c


def _root(disc: Any) -> Any:
    return sqrt(maximum(disc, 0.0))


def _by_q(h: Any, c: Any, root: Any, added: Any) -> tuple[Any, Any]:
    """t² + 2 h t + c = 0 by q = -(h ± root), with root = √(h² - c), `added` or not: q and c / q, the nearer first."""
    q = -(h + select(added, root, -root))
    other = c / select(q == 0, 1.0, q)
    near, far = select(h > 0, (q, other), (other, q))
    return near, far


SOLVERS: dict[str, Callable[..., Solved]] = {"textbook": textbook, "paper": paper, "stable": stable, "robust": robust}
"""name -> (f, d, r) -> (discriminant, () -> (nearer t, farther t))."""


def intersect_sphere(origin: Vec, d: Vec, sphere: Sphere, solver: str = "robust") -> Any:
    """Return the least t > 0 with |origin + t d - centre| = radius: metres along the unit d; infinity for a miss."""
    cx, cy, cz = sphere.center
    f = (origin[0] - cx, origin[1] - cy, origin[2] - cz)
    disc, roots = SOLVERS[solver](f, d, sphere.radius)

    def distance() -> Any:
        near, far = roots()
        t = select(near > 0, near, far)
        return select(t > 0, t, INFINITY)

    return where_any(disc >= 0, distance, disc, INFINITY)
