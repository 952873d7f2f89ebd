"""A scene is a camera, shapes and lights: plain frozen records. `SceneFile` is what is written, `Scene` is rendered."""

from raytwin.scene.camera import Camera
from raytwin.scene.camera_frame import to_camera_frame
from raytwin.scene.lights import Environment, Light, Sky, Sun
from raytwin.scene.material import Lambert, Material, Phong
from raytwin.scene.mitsuba_scene import MitsubaScene
from raytwin.scene.record_base import Albedo, Matrix, PixelCount, Positive, Radiance, Record, Vector
from raytwin.scene.scene import Scene
from raytwin.scene.scene_file import (
    PhotoCamera,
    Pyramid,
    SceneFile,
    Tolerance,
    WrittenMap,
    WrittenPlane,
    WrittenSky,
    WrittenSphere,
    WrittenSun,
    material_of,
)
from raytwin.scene.shapes import Rectangle, Shape, Sphere
