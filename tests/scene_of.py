"""Scenes for tests, of objects and lights in one list each; and cameras drawn by hypothesis."""

from collections.abc import Iterable
from typing import Any

from hypothesis import assume
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from raytwin import scene_folders
from raytwin.scene import Camera, Environment, Scene, Shape, Sky, Sun
from raytwin.scene.lens import undone
from raytwin.scene.scene_files import read_scene
from raytwin.scene_folders import find_scene


def scene_of(
    name: str, camera: Camera, objects: Iterable[Shape] = (), lights: Iterable[Sun | Sky | Environment] = ()
) -> Scene:
    return changed(Scene(name, camera), objects=objects, lights=lights)


def changed(scene: Scene, lights: Iterable[Sun | Sky | Environment] | None = None, **others: Any) -> Scene:
    """`lights` take the place of all that the scene has."""
    if lights is not None:
        lights = list(lights)
        others["sun"] = next((light for light in lights if isinstance(light, Sun)), None)
        others["sky"] = next((light for light in lights if not isinstance(light, Sun)), None)
    return scene.with_(**others)


def small(name: str, size: tuple[int, int]) -> Scene:
    """A shipped scene as a smaller picture."""
    scene = read_scene(find_scene(scene_folders.SCENES / name))
    return scene.with_camera(scene.camera.resized(*size))


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


def vectors(low: float, high: float) -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(*[reals(low, high)] * 3)


@st.composite
def cameras(draw, distorted: bool = True) -> Camera:
    """Small images, wide and narrow lenses, any place and turn; every pixel has a ray."""
    w, h = draw(st.sampled_from([(64, 48), (97, 31), (40, 90)]))
    f, aspect = draw(reals(0.3, 3)) * w, draw(reals(0.8, 1.25))
    cx, cy = draw(reals(0.3, 0.7)) * w, draw(reals(0.3, 0.7)) * h
    K = ((f, 0.0, cx), (0.0, f * aspect, cy), (0.0, 0.0, 1.0))
    R = tuple(map(tuple, Rotation.from_rotvec(draw(vectors(-3, 3))).as_matrix().tolist()))
    dist = tuple(draw(reals(-b, b)) for b in (0.35, 0.1, 0.02, 0.02, 0.05)) if distorted else ()
    camera = Camera((w, h), K, R, draw(vectors(-1, 1)), dist)
    assume(not undone(camera.K, camera.dist, camera.image_size).fault)
    return camera
