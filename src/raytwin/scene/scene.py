"""What is rendered."""

from typing import TypeVar

import msgspec

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.lights import Environment, Light, Sky, Sun
from raytwin.scene.material import Phong
from raytwin.scene.record_base import Record
from raytwin.scene.shapes import Rectangle, Shape, Sphere

L = TypeVar("L", Sun, Sky, Environment)

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
        return self._only(Sun) or NO_SUN

    @property
    def sky(self) -> Sky:
        """The sky, or one that is dark. Raises InputError where there are two, or an environment in its place."""
        if self.environment:
            raise InputError(f"scene {self.name}: sky", "the same radiance everywhere, for this", "an environment map")
        return self._only(Sky) or NO_SKY

    @property
    def environment(self) -> Environment | None:
        """The map in the place of a constant sky, where there is one."""
        return self._only(Environment)

    @property
    def glossy(self) -> bool:
        """Some object has a highlight."""
        return any(isinstance(thing.material, Phong) for thing in self.objects)

    def check_lambertian(self, who: str) -> None:
        """InputError where an object has a highlight, which `who` cannot do."""
        if self.glossy:
            raise InputError(f"scene {self.name}", f"Lambertian objects alone, for {who}", "a Phong highlight")

    def _only(self, kind: type[L]) -> L | None:
        found = [light for light in self.lights if isinstance(light, kind)]
        if len(found) > 1:
            raise InputError(f"scene {self.name}: lights", f"one {kind.__name__} at most", len(found))
        return found[0] if found else None

    def with_camera(self, camera: Camera) -> "Scene":
        return msgspec.structs.replace(self, camera=camera)
