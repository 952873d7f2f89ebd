"""Where shadows fall is known before any pixel: no caster too few, and on a plane hardly one too many."""

import numpy as np
import pytest
from scene_of import scene_of
from scipy.spatial.transform import Rotation

from raytwin.fast import frame, trace
from raytwin.fast.fast_world import Objects
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun

SIZE = (80, 60)


def a_scene(seed: int, grazing: bool = False) -> Scene:
    """Spheres and rectangles before a camera anywhere, some large, some across its plane; odd seeds behind a lens."""
    rng = np.random.default_rng(seed)
    R, eye = Rotation.random(random_state=rng).as_matrix(), 2 * rng.normal(size=3)
    rows = tuple(map(tuple, R.tolist()))
    dist = (-0.15, 0.03, 0.001, -0.001) if seed % 2 else ()
    K = ((60.0, 0.0, 40.0), (0.0, 60.5, 30.0), (0.0, 0.0, 1.0))
    things: list[Sphere | Rectangle] = []
    for _ in range(6):
        at = tuple((eye + R.T @ (rng.normal(size=3) * (1.5, 1.5, 2) + (0, 0, 3))).tolist())
        colour = Lambert(tuple(rng.uniform(0.2, 0.9, 3).tolist()))
        if rng.random() < 0.5:
            things.append(Sphere(at, float(10 ** rng.uniform(-2, 0.3)), colour))
        else:
            turn, half = Rotation.random(random_state=rng).as_matrix(), 10 ** rng.uniform(-1.5, 0.7, 2)
            edges = (tuple((h * axis).tolist()) for h, axis in zip(half, turn, strict=False))
            things.append(Rectangle(at, *edges, colour))
    light = rng.normal(size=3)
    if grazing:
        n = np.array(next((t.normal for t in things if isinstance(t, Rectangle)), (0, 0, 1)))
        light += (10 ** rng.uniform(-5, -1) - light @ n) * n
    camera = Camera(SIZE, K, rows, tuple((-R @ eye).tolist()), dist)
    return scene_of("any", camera, tuple(things), (Sun(tuple(light.tolist())), Sky((0.1, 0.1, 0.1))))


@pytest.mark.parametrize("grazing", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_short_lists_of_casters_change_no_pixel(seed, grazing):
    scene = a_scene(seed, grazing)
    for engine in ("numpy64", "numpy32"):
        np.testing.assert_array_equal(
            trace(scene, "shadow", engine).mean, trace(scene, "shadow", engine, trim="none").mean
        )


def test_a_tables_tile_asks_only_the_spheres_whose_shadows_reach_it(monkeypatch):
    """A hundred small spheres over a table that fills the picture: each shadow touches a few of its 80 tiles."""
    at = (np.stack(np.meshgrid(np.arange(10), np.arange(10)), axis=-1).reshape(-1, 2) - 4.5) * 0.1
    balls = tuple(Sphere((x, y, 0.05), 0.01) for x, y in at.tolist())
    table = Rectangle((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    down = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
    camera = Camera((320, 256), ((300.0, 0.0, 159.5), (0.0, 300.0, 127.5), (0.0, 0.0, 1.0)), down, (0.0, 0.0, 1.0))
    scene = scene_of("table", camera, (*balls, table), (Sun((0.3, 0.2, 1.0)),))
    full, asked, towards = trace(scene, "shadow", trim="none").mean, [], Objects.towards

    def counted(self, start, d):
        found = towards(self, start, d)
        asked.append(len(found))
        return found

    monkeypatch.setattr(Objects, "towards", counted)
    monkeypatch.setattr(frame, "TILE_NUMPY", 32)
    np.testing.assert_array_equal(trace(scene, "shadow").mean, full)
    assert max(asked) <= 12
    assert sum(asked) < 4 * 100
