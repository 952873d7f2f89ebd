"""What is rendered."""

from typing import TypeVar

import msgspec

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.lights import Light, Sky, Sun
from raytwin.scene.record import Record
from raytwin.scene.shapes import Rectangle, Shape, Sphere

L = TypeVar("L", Sun, Sky)

NO_SUN = Sun((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
NO_SKY = Sky()


class Scene(Record, frozen=True):
    """A camera, shapes and lights. An object's id is its index in `objects`, and -1 is the background."""

    name: str
    camera: Camera
    objects: tuple[Shape, ...] = ()
    lights: tuple[Light, ...] = ()

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        return tuple(thing for thing in self.objects if isinstance(thing, Sphere))

    @property
    def rectangles(self) -> tuple[Rectangle, ...]:
        return tuple(thing for thing in self.objects if isinstance(thing, Rectangle))

    @property
    def names(self) -> tuple[str, ...]:
        """What people call the objects: sphere 0, sphere 1, plane 0."""
        kinds = ["sphere" if isinstance(thing, Sphere) else "plane" for thing in self.objects]
        return tuple(f"{kind} {kinds[:i].count(kind)}" for i, kind in enumerate(kinds))

    @property
    def sun(self) -> Sun:
        """The sun, or one that is dark. Raises InputError where there are two: nothing here sums over suns yet."""
        return self._only(Sun, NO_SUN)

    @property
    def sky(self) -> Sky:
        """The sky, or one that is dark. Raises InputError where there are two."""
        return self._only(Sky, NO_SKY)

    def _only(self, kind: type[L], none: L) -> L:
        found = [light for light in self.lights if isinstance(light, kind)]
        if len(found) > 1:
            raise InputError(f"scene {self.name}: lights", f"one {kind.__name__} at most", len(found))
        return found[0] if found else none

    def with_camera(self, camera: Camera) -> "Scene":
        return msgspec.structs.replace(self, camera=camera)
