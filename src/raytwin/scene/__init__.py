"""A scene is a camera, shapes and lights: plain frozen records. `SceneFile` is what is written, `Scene` is rendered."""

from raytwin.scene.camera import Camera
from raytwin.scene.lights import Light, Sky, Sun
from raytwin.scene.material import Lambert, Material
from raytwin.scene.moved import seen_from_eye
from raytwin.scene.record import Albedo, Matrix, PixelCount, Positive, Radiance, Record, Vector
from raytwin.scene.scene import Scene
from raytwin.scene.scene_file import (
    PhotoCamera,
    Pyramid,
    SceneFile,
    Tolerance,
    WrittenPlane,
    WrittenSky,
    WrittenSphere,
    WrittenSun,
)
from raytwin.scene.shapes import Rectangle, Shape, Sphere

__all__ = [
    "Albedo",
    "Camera",
    "Lambert",
    "Light",
    "Material",
    "Matrix",
    "PhotoCamera",
    "PixelCount",
    "Positive",
    "Pyramid",
    "Radiance",
    "Record",
    "Rectangle",
    "Scene",
    "SceneFile",
    "Shape",
    "Sky",
    "Sphere",
    "Sun",
    "Tolerance",
    "Vector",
    "WrittenPlane",
    "WrittenSky",
    "WrittenSphere",
    "WrittenSun",
    "seen_from_eye",
]
