"""The scene that the live page is tested with."""

import pytest

from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene


@pytest.fixture(scope="session")
def base(scenes) -> Scene:
    """96 x 72 pixels of the scene `overlap`."""
    written = read_scene(scenes / "overlap")
    return written.with_camera(written.camera.resized(96, 72))
