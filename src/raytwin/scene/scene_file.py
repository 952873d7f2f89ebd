"""What is written in a scene.toml: as its author wrote it, so that a hash of it outlives changes of the records.

`SceneFile.at(camera)` makes the Scene that is rendered.
"""

from typing import Annotated

import msgspec

from raytwin.errors import InputError
from raytwin.scene.camera import Camera
from raytwin.scene.lights import Sky, Sun
from raytwin.scene.material import Lambert
from raytwin.scene.record import Albedo, Fraction, Positive, Radiance, Record, Vector
from raytwin.scene.scene import Scene
from raytwin.scene.shapes import Rectangle, Sphere


class PhotoCamera(Record, frozen=True):
    """A camera yet to be found: calibrate it from `photos` of `board`, and stand where `photo` was taken.

    Paths are relative to the scene's folder. `model` names the distortion model to fit.
    """

    photos: str
    board: str
    photo: str
    model: str = "auto"


class WrittenSphere(Record, frozen=True):
    """[[spheres]]: a Lambertian one."""

    center: Vector
    radius: Positive
    albedo: Albedo = (0.8, 0.8, 0.8)


class WrittenPlane(Record, frozen=True):
    """[[planes]]: a Lambertian rectangle."""

    center: Vector
    half_u: Vector
    half_v: Vector
    albedo: Albedo = (0.8, 0.8, 0.8)
    in_photo: bool = False


class WrittenSun(Record, frozen=True):
    """[sun]: `to_light` of any length."""

    to_light: Vector
    irradiance: Radiance = (3.0, 3.0, 3.0)


class WrittenSky(Record, frozen=True):
    """[sky]"""

    radiance: Radiance = (0.0, 0.0, 0.0)


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
    """A scene as written, `camera` or `photos` to find it from, and how closely two renderings must agree.

    The [camera] table is one of the two: `camera` where it is given, `photos` where it names photos.
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
        """What `camera` sees: the spheres, then the planes."""
        spheres = (Sphere(s.center, s.radius, Lambert(s.albedo)) for s in self.spheres)
        planes = (Rectangle(p.center, p.half_u, p.half_v, Lambert(p.albedo), p.in_photo) for p in self.planes)
        lights = Sun(self.sun.to_light, self.sun.irradiance), Sky(self.sky.radiance)
        return Scene(self.name, camera, (*spheres, *planes), lights)

    @property
    def scene(self) -> Scene:
        """What its own camera sees. Raises InputError where that is yet to be found."""
        if self.camera is None:
            raise InputError(f"scene {self.name}: camera", "a calibrated camera", "photos to calibrate it from")
        return self.at(self.camera)

    def with_camera(self, camera: Camera) -> "SceneFile":
        """The same, its camera found."""
        return msgspec.structs.replace(self, camera=camera, photos=None)
