"""What is written in a scene.toml: as its author wrote it, so that a hash of it outlives changes of the records.

`SceneFile.at(camera)` makes the Scene that is rendered.
"""

import math
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, UnsetType

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.lights import Environment, Sky, Sun
from raytwin.scene.material import Lambert, Material, Phong
from raytwin.scene.record_base import Albedo, Fraction, NonNegative, PixelCount, Positive, Radiance, Record, Vector
from raytwin.scene.scene import Scene
from raytwin.scene.shapes import Rectangle, Sphere

ObjectName = Annotated[str, msgspec.Meta(min_length=1, max_length=40)]


class PhotoCamera(Record, frozen=True):
    """A camera yet to be found: calibrate it from `photos` of `board`, and stand where `photo` was taken.

    Paths are relative to the scene's folder. `model` names the distortion model to fit.
    """

    photos: str
    board: str
    photo: str
    model: str = "auto"


class WrittenSphere(Record, frozen=True):
    """[[spheres]]: a Lambertian one, or Phong's where it has `specular` and `exponent`. `name`: what reports call it.

    What is unset is not in the scene's hash, so that a new key leaves the hashes of old scenes as they were.
    """

    center: Vector
    radius: Positive
    albedo: Albedo = (0.8, 0.8, 0.8)
    specular: Albedo | UnsetType = UNSET
    exponent: Positive | UnsetType = UNSET
    name: ObjectName | UnsetType = UNSET


class WrittenPlane(Record, frozen=True):
    """[[planes]]: a rectangle, of a material as a sphere's."""

    center: Vector
    half_u: Vector
    half_v: Vector
    albedo: Albedo = (0.8, 0.8, 0.8)
    in_photo: bool = False
    specular: Albedo | UnsetType = UNSET
    exponent: Positive | UnsetType = UNSET
    name: ObjectName | UnsetType = UNSET


def material_of(thing: WrittenSphere | WrittenPlane) -> Material:
    """Raises InputError where one of `specular` and `exponent` is missing, or more light leaves than comes."""
    specular, exponent = thing.specular, thing.exponent
    if specular is UNSET and exponent is UNSET:
        return Lambert(thing.albedo)
    if specular is UNSET or exponent is UNSET:
        raise InputError("Phong", "both specular and exponent", "one of them")
    return Phong(thing.albedo, specular, exponent)


class WrittenSun(Record, frozen=True):
    """[sun]: `to_light` of any length."""

    to_light: Vector
    irradiance: Radiance = (3.0, 3.0, 3.0)


class WrittenMap(Record, frozen=True):
    """The contents of an environment map's file: see `Environment`."""

    size: tuple[PixelCount, PixelCount]
    texels: bytes


class WrittenSky(Record, frozen=True):
    """[sky]: `radiance`, the same everywhere; or `map`, a file's name, times `scale`, turned by `rotation`.

    Degrees about the board's z axis, counterclockwise as seen from its tip. `texels`: what was read from the file.
    """

    radiance: Radiance = (0.0, 0.0, 0.0)
    map: str | UnsetType = UNSET
    scale: NonNegative | UnsetType = UNSET
    rotation: float | UnsetType = UNSET
    texels: WrittenMap | UnsetType = UNSET

    @property
    def light(self) -> Sky | Environment:
        if self.texels is UNSET:
            return Sky(self.radiance)
        turn = math.radians(0.0 if self.rotation is UNSET else self.rotation)
        c, s = math.cos(turn), math.sin(turn)
        found = Environment(self.texels.size, self.texels.texels, ((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
        return found if self.scale is UNSET else found.scaled(self.scale)


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


class SceneFile(Record, frozen=True):
    """A scene as written in its file: a camera or photos to calibrate it from, objects, lights and tolerance.

    `camera` is set if the [camera] table gives one, `photos` if it names photos.
    """

    name: str
    camera: Camera | None = None
    spheres: tuple[WrittenSphere, ...] = ()
    planes: tuple[WrittenPlane, ...] = ()
    sun: WrittenSun = WrittenSun((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    sky: WrittenSky = WrittenSky()
    tolerance: Tolerance = Tolerance()
    pyramids: tuple[Pyramid, ...] = ()
    photos: PhotoCamera | None = None
    folder: str = "."

    def at(self, camera: Camera) -> Scene:
        """Return the scene that `camera` sees: the spheres, then the planes."""
        spheres = (Sphere(s.center, s.radius, material_of(s), s.name) for s in self.spheres)
        planes = (Rectangle(p.center, p.half_u, p.half_v, material_of(p), p.in_photo, p.name) for p in self.planes)
        lights = Sun(self.sun.to_light, self.sun.irradiance), self.sky.light
        return Scene(self.name, camera, (*spheres, *planes), lights)

    @property
    def scene(self) -> Scene:
        """Return the scene of its own camera. Raises InputError if the photos have not been calibrated."""
        if self.camera is None:
            raise InputError(f"scene {self.name}: camera", "a calibrated camera", "photos to calibrate it from")
        return self.at(self.camera)

    @classmethod
    def of(cls, scene: Scene) -> "SceneFile":
        """Return the file that `scene` could have been read from. Raises InputError for a map tilted out of the level.

        Spheres come before planes, as in a file.
        """
        sky = WrittenSky() if scene.environment else WrittenSky(scene.sky.radiance)
        if (found := scene.environment) is not None:
            (c, s, _), _, (x, y, _) = found.R_map_board
            if math.hypot(x, y) > 1e-9:
                raise InputError(
                    f"scene {scene.name}: sky", "a map turned about the board's z axis alone", "a tilted one"
                )
            texels = WrittenMap(found.size, found.texels)
            sky = WrittenSky(rotation=math.degrees(math.atan2(s, c)), texels=texels)
        spheres = tuple(
            WrittenSphere(s.center, s.radius, name=s.name, **_written_material(s.material)) for s in scene.spheres
        )
        planes = tuple(
            WrittenPlane(
                p.center, p.half_u, p.half_v, in_photo=p.in_photo, name=p.name, **_written_material(p.material)
            )
            for p in scene.planes
        )
        sun = WrittenSun(scene.sun.to_light, scene.sun.irradiance)
        return cls(scene.name, scene.camera, spheres, planes, sun, sky)

    def with_camera(self, camera: Camera) -> "SceneFile":
        """Return the same scene with this camera."""
        return msgspec.structs.replace(self, camera=camera, photos=None)


def _written_material(material: Material) -> dict[str, Any]:
    """Return a material's keys in a scene.toml."""
    shine = {"specular": material.specular, "exponent": material.exponent} if isinstance(material, Phong) else {}
    return {"albedo": material.albedo} | shine
