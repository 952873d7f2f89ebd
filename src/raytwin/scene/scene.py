"""What scene.toml says, and what is rendered."""

from typing import Annotated, Any, Self

import msgspec
from msgspec import UNSET, UnsetType

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.lights import Environment, Sky, Sun
from raytwin.scene.record_base import Albedo, Fraction, Positive, Radiance, Record, Vector
from raytwin.scene.shapes import Rectangle, Shape, Sphere

NO_SUN = Sun((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


class PhotoCamera(Record, frozen=True):
    """[camera] of a scene with photos: calibrate it from `photos` of `board`, and stand where `photo` was taken.

    Paths are relative to the scene's folder. `model` names the distortion model to fit.
    """

    photos: str
    board: str
    photo: str
    model: str = "auto"


class Pyramid(Record, frozen=True):
    """A transparent pyramid, only drawn on photos: four vertices, metres; a face's linear colour and opacity."""

    vertices: tuple[Vector, Vector, Vector, Vector]
    color: Albedo = (0.1, 0.5, 0.9)
    opacity: Fraction = 0.35


class Tolerance(Record, frozen=True):
    """When two noise-free images agree: every number is a bound that the comparison tests.

    `mask_pixels`: pixels in which different objects may be seen; `p999_abs`: the 99.9 % quantile of the absolute
    error of radiance, as a share of the reference's scale (the 99 % quantile of its positive values: about 1 where
    white is 1) or of a brighter value; `outlier_fraction`: how large a share of the pixels may err by more than ten
    times that.
    """

    mask_pixels: Annotated[int, msgspec.Meta(ge=0)] = 0
    p999_abs: Positive = 1e-5
    outlier_fraction: Fraction = 1e-4


class Scene(Record, frozen=True):
    """A camera, objects, lights, and how well images of them must agree; `pyramids` are drawn into photos alone.

    An object's id is its index in `objects`, the spheres and then the planes; -1 is the background.
    """

    name: str
    camera: Camera
    spheres: tuple[Sphere, ...] = ()
    planes: tuple[Rectangle, ...] = ()
    sun: Sun = NO_SUN
    sky: Sky = Sky()
    tolerance: Tolerance = Tolerance()
    pyramids: tuple[Pyramid, ...] = ()

    def __post_init__(self) -> None:
        taken: set[str | UnsetType] = set()
        for field, kind in (("spheres", Sphere), ("planes", Rectangle)):
            for i, thing in enumerate(getattr(self, field)):
                if type(thing) is not kind:
                    raise InputError(f"{field}[{i}]", f"a {kind.__name__}", type(thing).__name__)
                if thing.name in taken and thing.name is not UNSET:
                    raise InputError(f"{field}[{i}].name", "a name that no other object has", repr(thing.name))
                taken.add(thing.name)

    @property
    def image_size(self) -> tuple[int, int]:
        """Return (width, height) of its camera's picture."""
        return self.camera.image_size

    @property
    def objects(self) -> tuple[Shape, ...]:
        return (*self.spheres, *self.planes)

    @property
    def names(self) -> tuple[str, ...]:
        """Return what people call the objects, all different: the file's names, else `sphere 1`."""
        named = zip(self.numbers, self.objects, strict=True)
        return tuple(number if thing.name is UNSET else str(thing.name) for number, thing in named)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Return sphere 0, sphere 1, plane 0, ...: what stays when an object gets another name."""
        kinds = ("sphere", self.spheres), ("plane", self.planes)
        return tuple(f"{kind} {i}" for kind, things in kinds for i in range(len(things)))

    @property
    def environment(self) -> Environment | None:
        """Return the sky map, or None for a constant sky."""
        return self.sky.environment

    @property
    def sky_radiance(self) -> Radiance:
        """Return the radiance of a sky that is the same everywhere. Raises InputError for a map."""
        if self.sky.texels is not UNSET:
            raise InputError(f"scene {self.name}: sky", "the same radiance everywhere, for this", "an environment map")
        return self.sky.radiance

    @property
    def glossy(self) -> bool:
        """Return whether any object has a highlight."""
        return any(thing.highlight for thing in self.objects)

    def check_lambertian(self, who: str) -> None:
        """Raise InputError if an object has a highlight, which `who` does not support."""
        if self.glossy:
            raise InputError(f"scene {self.name}", f"Lambertian objects alone, for {who}", "a Phong highlight")

    def with_(self, *, size: tuple[int, int] | None = None, **changes: Any) -> Self:
        """Return the scene with other values of some fields; `objects` takes spheres and planes in one list.

        `size` is the picture's (width, height), in pixels. `sun` and `sky` take None for no light of that kind.

        >>> from raytwin.scene import Camera, Scene, Sky, Sphere
        >>> board = ((1, 0, 0), (0, -1, 0), (0, 0, -1))
        >>> scene = Scene("ball", Camera((64, 48), ((80, 0, 31.5), (0, 80, 23.5), (0, 0, 1)), board, (0, 0, 1)))
        >>> scene = scene.with_(spheres=[Sphere((0, 0, 0.1), 0.1)], sky=Sky((1.0, 1.0, 1.0)), size=(32, 24))
        >>> scene.camera.image_size, len(scene.objects), scene.sky.radiance
        ((32, 24), 1, (1.0, 1.0, 1.0))
        """
        if "objects" in changes:
            changes |= {"spheres": [], "planes": []}
            for thing in changes.pop("objects"):
                changes[f"{thing.kind}s"].append(thing)
        if isinstance(sky := changes.get("sky"), Environment):
            changes["sky"] = Sky(texels=sky)
        none = {"sun": NO_SUN, "sky": Sky()}
        made = super().with_(**{k: none[k] if v is None and k in none else v for k, v in changes.items()})
        return made if size is None else made.with_(camera=made.camera.resized(*size).with_())

    def with_camera(self, camera: Camera) -> "Scene":
        return msgspec.structs.replace(self, camera=camera)

    def differences(self, other: "Scene") -> list[str]:
        """Return the fields in which two scenes differ."""
        return [field for field in self.__struct_fields__ if getattr(self, field) != getattr(other, field)]
