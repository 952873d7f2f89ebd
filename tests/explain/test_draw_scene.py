"""Drawn scenes show every kind of mistake, and a scene that does not is found out."""

import msgspec
import numpy as np
from blind import GAP, blind_to, nearest_gap
from scene_of import changed

from raytwin.explain import draw_scene as module
from raytwin.explain.draw_scene import ARRANGEMENTS, draw_scene
from raytwin.scene import Sun
from raytwin.tracer import trace


def test_a_seed_gives_one_scene_and_another_seed_another():
    assert draw_scene(1) == draw_scene(1)
    assert draw_scene(1) != draw_scene(2)


def test_drawn_scenes_are_blind_to_nothing_and_nothing_touches(monkeypatch):
    for arrangement in ARRANGEMENTS:
        monkeypatch.setattr(module, "ARRANGEMENTS", (arrangement,))
        for seed in range(2):
            assert blind_to(draw_scene(seed, (60, 44))) == []
            assert nearest_gap(draw_scene(seed)) > GAP


def test_a_larger_scene_is_the_same_picture():
    scene, larger = draw_scene(1), draw_scene(1, scale=6.0)
    assert larger.spheres[0].radius == 6 * scene.spheres[0].radius
    assert np.abs(trace(scene, "shadow").mean - trace(larger, "shadow").mean).max() < 1e-5


def test_a_blind_scene_is_told():
    scene = draw_scene(1)
    noon = changed(scene, lights=(Sun((0.0, 0.0, 1.0), (0.5, 0.5, 0.5)), scene.sky))
    assert "clipping" in blind_to(noon)
    R = np.asarray(scene.camera.R_cam_board)
    half_turn = 2 * np.outer(a := (R[2] + [0, 0, 1]) / np.linalg.norm(R[2] + [0, 0, 1]), a) - np.eye(3)
    assert np.allclose(half_turn, half_turn.T)
    eye = np.asarray(scene.camera.eye)
    camera = msgspec.structs.replace(
        scene.camera,
        R_cam_board=tuple(map(tuple, half_turn.tolist())),
        t_cam_board=tuple((-half_turn @ eye).tolist()),
    )
    assert "a transposed R" in blind_to(msgspec.structs.replace(scene, camera=camera))
