"""Scenes for tests, of objects and lights in one list each."""

from collections.abc import Iterable
from typing import Any

from raytwin.scene import Camera, Environment, Scene, Shape, Sky, Sun


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
