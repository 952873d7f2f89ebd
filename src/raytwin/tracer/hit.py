"""The records of the tracer: its steps, what a ray meets, and the two questions that a ray can ask of a scene."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

from raytwin.tracer.arrays import Vec


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
    """Phong's highlight: the `share` of the light that it reflects, per channel, and its exponent (`scene.shapes`)."""

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


@runtime_checkable
class World(Protocol):
    """What rays are tested against. `PlainWorld` tests every object; `raytwin.fast` gives the same answers, fast."""

    @property
    def stages(self) -> Stages: ...

    def closest_hit(self, origin: Vec, d: Vec, start: Hit | None = None) -> tuple[Any, Any]:
        """(t, id) of the nearest object along d from `origin`; infinity and -1 where there is none.

        `start`: the surface that the ray leaves; None for the eye.
        """

    def blocked(self, start: Hit, d: Vec) -> Any:
        """True where an object lies on the way along d from the surface `start`."""

    def facts(self, ids: Any) -> Facts:
        """What the objects `ids` say of their surfaces; anything for -1."""
