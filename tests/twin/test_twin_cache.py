import zipfile

import msgspec
import numpy as np
import pytest
from scene_of import changed

from raytwin.scene.scene_files import read_scene
from raytwin.twin import activate, provenance, render

render_module = __import__("sys").modules["raytwin.twin.rendering"]


@pytest.fixture
def scene(scenes, tmp_path, monkeypatch):
    """A small scene, an empty cache, and every render worth keeping."""
    activate()
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path))
    monkeypatch.setattr("raytwin.twin.render_cache.WORTH_KEEPING", 0.0)
    found = read_scene(scenes / "overlap")
    return found.with_camera(found.camera.resized(32, 24))


def same(a, b) -> bool:
    arrays = [(a.mean, b.mean), (a.surface.ids, b.surface.ids), (a.surface.depth, b.surface.depth)]
    arrays += [(a.surface.normal, b.surface.normal)] + ([(a.variance, b.variance)] if a.variance is not None else [])
    return all((x == y).all() and x.dtype == y.dtype for x, y in arrays) and a.samples == b.samples


@pytest.mark.parametrize(("rung", "batches"), [("shadow", None), ("path", 2), ("path", 1)])
def test_a_second_render_comes_from_the_cache(scene, monkeypatch, rung, batches):
    first = render(scene, rung, samples=2, batches=batches)
    monkeypatch.setattr(render_module, "_rendered", lambda *_: pytest.fail("rendered again"))
    again = render(scene, rung, samples=2, batches=batches)
    assert same(first, again)
    assert (again.variance is None) == (batches != 2)


def test_a_crafted_file_is_rendered_again(scene, tmp_path):
    """Sound archives whose arrays no render of this scene has."""
    first = render(scene, "path", samples=2)
    (file,) = tmp_path.glob("renders/*.npz")
    with np.load(file) as kept:
        sound = {name: kept[name] for name in kept.files}
    nan, wide = sound["mean"].copy(), np.zeros((24, 33, 3), np.float32)
    nan[3, 4, 1] = np.nan
    for crafted in (
        {"mean": 2 * sound["mean"]}, {"samples": np.int64(3)},
        {"mean": nan}, {"mean": wide}, {"mean": sound["mean"].astype(np.float64)}, {"variance": sound["mean"][:3]},
        {"ids": sound["ids"][0]}, {"ids": sound["ids"] + 0.5}, {"depth": np.float32(1)}, {"samples": np.array([1, 2])},
        {"samples": np.int64(-4)}, {"normal": np.full_like(sound["normal"], np.inf)}, {"batches": np.array("x")},
    ):  # fmt: skip
        np.savez(file, **(sound | crafted))
        assert same(first, render(scene, "path", samples=2)), crafted
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000, 1000000, 3), }"
    npy = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("mean.npy", npy)
    assert same(first, render(scene, "path", samples=2))


def test_the_file_of_another_render_is_not_taken_for_this_ones(scene, tmp_path):
    """Of the same size and kind, and sound."""
    first = render(scene, "path", samples=2)
    (file,) = tmp_path.glob("renders/*.npz")
    render(scene, "path", samples=2, seed=1)
    (other,) = set(tmp_path.glob("renders/*.npz")) - {file}
    file.write_bytes(other.read_bytes())
    assert same(first, render(scene, "path", samples=2))


def test_everything_that_moves_a_pixel_is_in_the_key(scene):
    base = dict(rung="path", samples=4)  # noqa: C408
    sun = msgspec.structs.replace(scene.sun, irradiance=(1.0, 1.0, 1.0))
    others = [
        (scene, base | {"seed": 1}),
        (scene, base | {"samples": 8}),
        (scene, base | {"batches": 2}),
        (scene, base | {"sampling": "area"}),
        (scene, base | {"max_depth": 3}),
        (scene, base | {"rung": "sky"}),
        (scene, base | {"textures": {3: np.full((2, 2), 0.5)}}),
        (scene, base | {"textures": {3: np.full((2, 2), 0.6)}}),
        (changed(scene, lights=(sun, scene.sky)), base),
        (scene.with_camera(scene.camera.resized(32, 25)), base),
    ]
    found = [provenance(scene, **base), *(provenance(s, **options) for s, options in others)]
    assert len({repr(f) for f in found}) == len(found)
    elsewhere = msgspec.structs.replace(scene, name="other")
    assert provenance(elsewhere, **base) == found[0]
    assert provenance(scene, "shadow", seed=1, samples=4) == provenance(scene, "shadow", seed=2, samples=9)


def test_a_quick_render_is_not_stored(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("raytwin.twin.render_cache.WORTH_KEEPING", 1e9)
    render(scene, "shadow")
    assert not list(tmp_path.glob("renders/*"))
