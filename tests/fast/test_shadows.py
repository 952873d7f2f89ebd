"""Where shadows fall is known before any pixel: no caster too few, and on a plane hardly one too many."""

import numpy as np
import pytest
from scene_of import scene_of
from test_bvh import strewn

from raytwin.fast import frame, trace
from raytwin.fast.fast_world import Objects
from raytwin.scene import Camera, Rectangle, Sphere, Sun


@pytest.mark.parametrize("seed", range(10))
def test_short_lists_of_casters_change_no_pixel(overlap, seed):
    """Odd seeds: a sun that grazes a sheet; every third one: behind a lens."""
    rng = np.random.default_rng(seed)
    camera = overlap.camera.resized(80, 60).with_(dist=() if seed % 3 else (-0.15, 0.03, 0.001, -0.001))
    scene = strewn(overlap.with_camera(camera), rng, 20, 15)
    light, n = rng.normal(size=3), np.array(scene.planes[0].normal)
    if seed % 2:
        light += (10 ** rng.uniform(-5, -1) - light @ n) * n
    scene = scene.with_(sun=Sun(tuple(light.tolist())))
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
