"""Renders that are stored: used again as they were, damaged ones never, and the oldest deleted first."""

import os

import msgspec
import numpy as np
import pytest
from scene_of import changed

from raytwin.images.image import Image, Surface
from raytwin.scene.scene_files import read_scene
from raytwin.twin import activate, render, render_cache, rendering
from raytwin.twin.render_cache import load, store

IMAGE = Image(np.full((1, 2, 3), 0.5, np.float32), samples=3, surface=Surface.empty(2, 1), batches=2)


def parts(image: Image) -> list[np.ndarray]:
    known = (image.mean, image.variance, image.third, image.samples, image.batches, *vars(image.surface).values())
    return [np.asarray(part) for part in known]


@pytest.fixture
def scene(scenes, tmp_path, monkeypatch):
    """A small scene, an empty cache, and every render worth keeping."""
    activate()
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path))
    monkeypatch.setattr(render_cache, "WORTH_KEEPING", 0.0)
    found = read_scene(scenes / "overlap")
    return found.with_camera(found.camera.resized(32, 24))


@pytest.mark.parametrize(("rung", "batches"), [("shadow", None), ("path", 2), ("path", 1)])
def test_a_second_render_comes_from_the_cache_as_it_was(scene, tmp_path, monkeypatch, rung, batches):
    monkeypatch.setattr(render_cache, "WORTH_KEEPING", 1e9)
    render(scene, rung, samples=2, batches=batches)
    assert not list(tmp_path.glob("renders/*"))  # a quick render is not stored
    monkeypatch.setattr(render_cache, "WORTH_KEEPING", 0.0)
    first = render(scene, rung, samples=2, batches=batches)
    monkeypatch.setattr(rendering, "_rendered", lambda *_: pytest.fail("rendered again"))
    for one, other in zip(parts(first), parts(render(scene, rung, samples=2, batches=batches)), strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype


def test_everything_that_moves_a_pixel_is_in_the_key(scene, monkeypatch):
    keys = []
    monkeypatch.setattr(render_cache, "cached", lambda about, use, make: keys.append(repr(about)))
    sun = msgspec.structs.replace(scene.sun, irradiance=(1.0, 1.0, 1.0))
    base = {"rung": "path", "samples": 4}
    render(scene, **base)
    for change in (
        {"seed": 1}, {"samples": 8}, {"batches": 2}, {"sampling": "area"}, {"max_depth": 3}, {"rung": "sky"},
        {"textures": {3: np.full((2, 2), 0.5)}}, {"textures": {3: np.full((2, 2), 0.6)}},
    ):  # fmt: skip
        render(scene, **base | change)
    render(changed(scene, lights=(sun, scene.sky)), **base)
    render(scene.with_camera(scene.camera.resized(32, 25)), **base)
    assert len({*keys}) == len(keys) == 11
    render(msgspec.structs.replace(scene, name="other"), **base)
    assert keys[-1] == keys[0]
    render(scene, "shadow", seed=1, samples=4)
    render(scene, "shadow", seed=2, samples=9)
    assert keys[-1] == keys[-2]


def test_a_damaged_file_is_none_stays_old_and_is_rendered_again(tmp_path):
    path = tmp_path / "a.npz"
    store(path, IMAGE)
    whole, middle = path.read_bytes(), path.read_bytes().index(b"\x00\x00\x00\x3f")  # 0.5
    altered = whole[:middle] + b"\x01" + whole[middle + 1 :]
    np.savez(path, mean=IMAGE.mean)
    for damaged in (whole[:-30], altered, b"", b"no archive", path.read_bytes()):
        path.write_bytes(damaged)
        os.utime(path, (1e9, 1e9))
        assert load(path) is None
        assert path.stat().st_mtime == 1e9
    path.unlink()
    path.mkdir()
    store(path, IMAGE)
    assert load(path) is None


def test_what_was_used_longest_ago_is_dropped_and_use_makes_a_file_young(tmp_path, monkeypatch):
    paths = {key: tmp_path / f"{key}.npz" for key in "abcde"}
    store(paths["a"], IMAGE)
    monkeypatch.setattr(render_cache, "LIMIT", 3 * paths["a"].stat().st_size)
    for age, key in enumerate("abcd"):
        store(paths[key], IMAGE)
        os.utime(paths[key], (1e9 + age, 1e9 + age))
    assert [key for key in "abcd" if paths[key].exists()] == ["b", "c", "d"]
    assert load(paths["b"]) is not None
    store(paths["e"], IMAGE)
    assert [key for key in "abcde" if paths[key].exists()] == ["b", "d", "e"]
