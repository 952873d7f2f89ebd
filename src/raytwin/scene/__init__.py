"""A scene is a camera, shapes and lights: plain frozen records, as scene.toml says them."""

from raytwin.scene.camera import NOWHERE, Camera
from raytwin.scene.camera_frame import to_camera_frame
from raytwin.scene.lights import Environment, Sky, Sun
from raytwin.scene.mitsuba_file import MitsubaScene
from raytwin.scene.record_base import Albedo, Matrix, PixelCount, Positive, Radiance, Record, Vector
from raytwin.scene.scene import PhotoCamera, Pyramid, Scene, Tolerance
from raytwin.scene.shapes import Rectangle, Shape, Sphere
