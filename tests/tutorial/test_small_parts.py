"""Parts of the walk, each alone: functions put into its source, and what a picture beside its twin is said to be."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from raytwin.tutorial import with_functions
from raytwin.tutorial.desk import Desk
from raytwin.tutorial.show import show


def test_a_function_takes_the_place_of_the_one_of_its_name_and_of_nothing_else():
    text = "a = 1\n\ndef one():\n    ...\n\n\ndef two(x):\n    return x\n\nb = 2\n"
    made = with_functions(text, {"two": "def two(y):\n    return 2 * y\n", "one": "def one():\n    return 1"})
    assert made == "a = 1\n\ndef one():\n    return 1\n\n\ndef two(y):\n    return 2 * y\n\nb = 2\n"


def test_a_picture_beside_its_twin_is_said_to_be_as_far_from_it_as_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys.modules[show.__module__], "FOLDER", tmp_path)
    yours = np.full((4, 6, 3), 0.5, np.float32)
    show("sphere", yours, yours + np.float32(0.25))
    assert "sphere: RMSE 0.25 beside the twin" in capsys.readouterr().out


def test_corners_are_counted_from_the_pixels_corner_as_the_tag_library_does():
    seen = SimpleNamespace(_found={"photo": [SimpleNamespace(corners=np.zeros((4, 2)))]}, _name="photo")
    assert Desk.corners.fget(seen) == pytest.approx(np.full((1, 4, 2), 0.5))
