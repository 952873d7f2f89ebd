"""Annotated shapes are checked in the tests, and cost a user nothing."""

import subprocess
import sys

import jaxtyping
import numpy as np
import pytest

from raytwin.fast import draw
from raytwin.scene.scene_files import read_scene


@pytest.fixture
def scene(scenes):
    scene = read_scene(scenes / "single")
    return scene.with_camera(scene.camera.resized(8, 6))


@pytest.mark.parametrize("wrong", [np.zeros((6, 8, 4), np.float32), np.zeros((6, 8, 3)), np.zeros(6, np.float32)])
def test_an_array_of_another_shape_or_kind_is_caught_by_its_annotation(scene, wrong):
    with pytest.raises(jaxtyping.TypeCheckError):
        draw(scene, wrong, "lambert", "numpy64")


def test_in_use_nothing_of_it_is_imported():
    code = "import sys, raytwin.fast, raytwin.compare; print({'jaxtyping', 'beartype'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
