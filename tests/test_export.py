"""raytwin scenes export: what other renderers are told is the scene."""

import json

import numpy as np
import pytest
from program import raytwin, refused

from raytwin.renderers.scene_exchange import as_arrays


def test_json_says_the_scene_to_the_last_bit_and_a_look_at_camera_too(tmp_path, overlap):
    run = raytwin("scenes", "export", "overlap", "-o", tmp_path / "overlap.json")
    assert (run.returncode, run.stdout) == (0, "")
    told = json.loads((tmp_path / "overlap.json").read_text())
    expected = as_arrays(overlap)
    assert list(told) == [*expected, "camera"]
    for name in ("K", "dist", "R_cam_board", "t_cam_board"):
        np.testing.assert_array_equal(told[name], expected[name])
    np.testing.assert_array_equal(told["planes"][0]["half_v"], expected["planes"][0]["half_v"])
    # A point of the board seen by the look-at camera is where K, R and t put it.
    look, R, t = told["camera"], expected["R_cam_board"], expected["t_cam_board"]
    p = np.array([0.02, 0.03, 0.05])
    x, y, z = (np.dot(look[axis], p - look["eye"]) for axis in ("right", "up", "forward"))
    np.testing.assert_allclose([x, -y, z], R @ p + t, atol=1e-15)
    np.testing.assert_allclose(np.subtract(look["look_at"], look["eye"]), look["forward"], atol=1e-15)
    assert look["fov_x"] == pytest.approx(np.degrees(2 * np.arctan(320 / expected["K"][0, 0])))


def test_what_is_asked_wrongly_is_told():
    for words, said in (
        ("overlap --rung shadw", "did you mean shadow?"),
        ("studio", "the same radiance everywhere, for this, got an environment map"),
        ("gloss", "Lambertian objects alone, for a renderer of one's own, got a Phong highlight"),
        ("nowhere", "nowhere"),
    ):
        refused(raytwin("scenes", "export", *words.split()), said)
