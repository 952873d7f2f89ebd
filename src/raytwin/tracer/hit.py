"""What a ray meets, point by point; and the tracer's steps as data."""

from collections.abc import Callable
from typing import Any, NamedTuple

from raytwin.arrays import Vec
from raytwin.scene import Phong, Shape, Sphere


class Stages(NamedTuple):
    """The tracer's steps as data: `STAGES._replace(lambert=...)` swaps one for a student's, or for a fault."""

    undistort: Callable[[Any, Any, Any], Any]
    back_project: Callable[..., Any]
    intersect_sphere: Callable[[Any, Any, Any], Any]
    intersect_rectangle: Callable[[Any, Any, Any], Any]
    nearer: Callable[[Any, Any], Any]
    normal: Callable[[Any, Any], Any]
    lambert: Callable[..., Any]
    sun_visible: Callable[..., Any]


class Specular(NamedTuple):
    """The highlight of `scene.Phong`: the `share` of the light that it reflects, per channel, and its exponent."""

    share: Vec
    exponent: Any


class Hit(NamedTuple):
    """What each ray meets: `t` metres (infinity: nothing), `ids` (-1: nothing), and the surface there.

    `normal`: unit, on the eye's side; `inside`: within a sphere; `d`: the ray's unit direction; `specular`: None where
    no object of the scene has a highlight.
    """

    t: Any
    ids: Any
    point: Vec
    normal: Vec
    albedo: Vec
    inside: Any
    d: Vec
    specular: Specular | None = None


class Facts(NamedTuple):
    """What an object says of its surface: its normal at p is flat + curvature (p - center), its curvature 1/r or 0."""

    center: Vec
    flat: Vec
    curvature: Any
    albedo: Vec
    specular: Specular | None = None


NO_SPECULAR = Specular((0.0, 0.0, 0.0), 1.0)
"""The highlight of a Lambertian object in a scene where others have one."""


def facts_of(thing: Shape) -> Facts:
    rho, specular = thing.material.albedo, specular_of(thing)
    if isinstance(thing, Sphere):
        return Facts(thing.center, (0.0, 0.0, 0.0), 1 / thing.radius, rho, specular)
    return Facts(thing.center, thing.normal, 0.0, rho, specular)


def specular_of(thing: Shape) -> Specular | None:
    material = thing.material
    return Specular(material.specular, material.exponent) if isinstance(material, Phong) else None


def normal(point: Vec, facts: Facts) -> Vec:
    """flat + curvature (p - center): unit, outwards."""
    return tuple(n + facts.curvature * (p - c) for n, p, c in zip(facts.flat, point, facts.center, strict=True))


def nearer(t: Any, best: Any) -> Any:
    """t < best: this object hides what was met so far."""
    return t < best
