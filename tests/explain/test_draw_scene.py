"""Drawn scenes show every fault of the catalogue, and nothing in them touches."""

import numpy as np
import pytest

from raytwin.explain import draw_scene as module
from raytwin.explain.catalogue import FAULTS
from raytwin.explain.draw_scene import ARRANGEMENTS, draw_scene
from raytwin.explain.predict import predictor
from raytwin.scene import Scene
from raytwin.tracer import trace

GAP = 0.001
"""Metres between any two things: no less than what shadow rays start off their surface."""
ELSEWHERE = {"sign-of-zero", "t-of-other-rays", "no-clamp", "shadows-always"}
"""Faults that a function alone shows, or a picture without shadows."""
BY_CHANCE = {"last-plane-wins", "last-sphere-wins", "own-number", "one-casts-not"}
"""Faults that some arrangements alone show."""


def test_a_seed_gives_one_scene_and_another_seed_another():
    assert draw_scene(1) == draw_scene(1)
    assert draw_scene(1) != draw_scene(2)


def test_nothing_touches_in_a_drawn_scene(monkeypatch):
    for arrangement in ARRANGEMENTS:
        monkeypatch.setattr(module, "ARRANGEMENTS", (arrangement,))
        assert min(nearest_gap(draw_scene(seed)) for seed in range(4)) > GAP


@pytest.mark.nightly
def test_every_arrangement_shows_every_fault(monkeypatch):
    shown = set()
    for number, arrangement in enumerate(ARRANGEMENTS):
        monkeypatch.setattr(module, "ARRANGEMENTS", (arrangement,))
        thin = predictor(draw_scene(0), every=5)
        correct = thin.radiance()
        seen = {
            f.name for f in FAULTS
            if any((~(np.abs(thin.picture(way) - correct) <= 1e-4)).mean() > 1e-3 for way in f.ways[:2])
        }  # fmt: skip
        assert {f.name for f in FAULTS if f.ways} - seen <= ELSEWHERE | BY_CHANCE, number
        shown |= seen
    assert shown >= BY_CHANCE


def test_a_larger_scene_is_the_same_picture():
    scene, larger = draw_scene(1), draw_scene(1, scale=6.0)
    assert larger.spheres[0].radius == 6 * scene.spheres[0].radius
    assert np.abs(trace(scene, "shadow").mean - trace(larger, "shadow").mean).max() < 1e-5


def nearest_gap(scene: Scene) -> float:
    """Metres between the two things that come nearest: spheres, panels and the floor."""
    spheres, floor = scene.spheres, next(x for x in scene.planes if x.half_u[2] == x.half_v[2] == 0)
    gaps = [
        np.linalg.norm(np.subtract(a.center, b.center)) - a.radius - b.radius
        for i, a in enumerate(spheres)
        for b in spheres[:i]
    ]
    for panel in scene.planes:
        if panel is not floor:
            gaps.append(panel.center[2] - abs(panel.half_u[2]) - abs(panel.half_v[2]) - floor.center[2])
        for s in spheres:
            away, near = np.subtract(s.center, panel.center), np.zeros(3)
            for half in np.array([panel.half_u, panel.half_v]):
                near = near + np.clip(away @ half / (half @ half), -1, 1) * half
            gaps.append(np.linalg.norm(away - near) - s.radius)
    return float(min(gaps))
