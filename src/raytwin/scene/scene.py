"""What is rendered."""

from typing import Any, Self, TypeVar

import msgspec

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.lights import Environment, Light, Sky, Sun
from raytwin.scene.material import Phong
from raytwin.scene.object_names import called, numbered
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
    def image_size(self) -> tuple[int, int]:
        """Return (width, height) of its camera's picture."""
        return self.camera.image_size

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        return tuple(thing for thing in self.objects if isinstance(thing, Sphere))

    @property
    def rectangles(self) -> tuple[Rectangle, ...]:
        return tuple(thing for thing in self.objects if isinstance(thing, Rectangle))

    @property
    def planes(self) -> tuple[Rectangle, ...]:
        """Return the rectangles, as `[[planes]]` of a scene.toml has them."""
        return self.rectangles

    @property
    def names(self) -> tuple[str, ...]:
        """Return what people call the objects, all different: the file's names, else `sphere 1 (red)`."""
        things = self.objects
        return called(self.numbers, [thing.name for thing in things], [thing.material.albedo for thing in things])

    @property
    def numbers(self) -> tuple[str, ...]:
        """Return sphere 0, sphere 1, plane 0, ...: what stays when an object gets another name or colour."""
        return numbered(thing.kind for thing in self.objects)

    @property
    def sun(self) -> Sun:
        """Return the sun, or a dark one if there is none. Raises InputError for two."""
        return self._only(Sun) or NO_SUN

    @property
    def sky(self) -> Sky:
        """Return the sky, or a dark one if there is none. Raises InputError for two, or for a sky map."""
        if self.environment:
            raise InputError(f"scene {self.name}: sky", "the same radiance everywhere, for this", "an environment map")
        return self._only(Sky) or NO_SKY

    @property
    def environment(self) -> Environment | None:
        """Return the sky map, or None for a constant sky."""
        return self._only(Environment)

    @property
    def glossy(self) -> bool:
        """Return whether any object has a highlight."""
        return any(isinstance(thing.material, Phong) for thing in self.objects)

    def check_lambertian(self, who: str) -> None:
        """Raise InputError if an object has a highlight, which `who` does not support."""
        if self.glossy:
            raise InputError(f"scene {self.name}", f"Lambertian objects alone, for {who}", "a Phong highlight")

    def _only(self, kind: type[L]) -> L | None:
        found = [light for light in self.lights if isinstance(light, kind)]
        if len(found) > 1:
            raise InputError(f"scene {self.name}: lights", f"one {kind.__name__} at most", len(found))
        return found[0] if found else None

    def with_(self, *, size: tuple[int, int] | None = None, **changes: Any) -> Self:
        """Return the scene with something changed: `camera`, `objects`, `spheres`, `planes`, `lights`, `sun`, `sky`.

        `size` is the picture's (width, height), in pixels. `sun` and `sky` take None for no light of that kind.

        >>> from raytwin.scene import Camera, Scene, Sky, Sphere
        >>> board = ((1, 0, 0), (0, -1, 0), (0, 0, -1))
        >>> scene = Scene("ball", Camera((64, 48), ((80, 0, 31.5), (0, 80, 23.5), (0, 0, 1)), board, (0, 0, 1)))
        >>> scene = scene.with_(spheres=[Sphere((0, 0, 0.1), 0.1)], sky=Sky((1.0, 1.0, 1.0)), size=(32, 24))
        >>> scene.camera.image_size, len(scene.objects), scene.sky.radiance
        ((32, 24), 1, (1.0, 1.0, 1.0))
        """
        if "spheres" in changes or "planes" in changes:
            kinds = [changes.pop(name, getattr(self, name)) for name in ("spheres", "planes")]
            changes["objects"] = tuple(thing for part in kinds for thing in part)
        for name, kind in (("sun", Sun), ("sky", Sky | Environment)):
            if name in changes:
                new = changes.pop(name)
                others = tuple(light for light in changes.get("lights", self.lights) if not isinstance(light, kind))
                changes["lights"] = (*others, *([] if new is None else [new]))
        made = super().with_(**changes)
        return made if size is None else made.with_(camera=made.camera.resized(*size).with_())

    def with_camera(self, camera: Camera) -> "Scene":
        return msgspec.structs.replace(self, camera=camera)
