"""The whole light between runs: nothing is made twice, nothing is stale, nothing damaged is believed; and its split."""

import math
import os
from math import pi

import msgspec
import numpy as np
import pytest

from raytwin import files, speed, twin
from raytwin.analysis import light_parts
from raytwin.analysis.ledger import make_ledger
from raytwin.analysis.light_parts import WholeLight, sampled_parts
from raytwin.diagnose.light_decomposition import split
from raytwin.diagnose.pixel_sample import SubmittedImage, look
from raytwin.scene import Sky


@pytest.fixture(scope="module")
def fast() -> str:
    twin.activate()
    return "drjit32"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path))
    return tmp_path / "light"


def small(scene, width=48, height=36):
    return scene.with_camera(scene.camera.resized(width, height))


def test_what_is_kept_is_not_made_again_and_gives_the_same_ledger(overlap, fast, folder, monkeypatch):
    scene = small(overlap)
    shown = speed.trace(scene, "shadow", fast)
    fresh = make_ledger(scene, shown, "shadow", fast)
    assert not folder.exists()
    first = make_ledger(scene, shown, "shadow", fast, keep=True)
    assert len(list(folder.iterdir())) == 3  # the halves, what objects have to do with each other, the exact rung

    def refuse(*args, **options):
        raise AssertionError("made again")

    for name in ("light_parts", "trace", "walk"):
        monkeypatch.setattr(light_parts, name, refuse)
    again = make_ledger(scene, shown, "shadow", fast, keep=True)
    np.testing.assert_array_equal(again.error, fresh.error)
    for name, picture in fresh.pictures.items():
        np.testing.assert_array_equal(again.pictures[name], picture)
    assert again.parts == first.parts
    untimed = [[msgspec.structs.replace(part, seconds=None) for part in made.parts] for made in (again, fresh)]
    assert untimed[0] == untimed[1]


def test_another_scene_depth_or_source_finds_nothing_of_the_old(overlap, fast, folder, monkeypatch):
    scene = small(overlap)
    WholeLight(scene, fast, keep=True)
    other = msgspec.structs.replace(scene, lights=(scene.sun, Sky((0.3, 0.3, 0.3))))
    assert not np.array_equal(
        WholeLight(other, fast, keep=True).halves[0]["open"], WholeLight(scene, fast).halves[0]["open"]
    )
    WholeLight(scene, fast, 3, keep=True)
    assert len(list(folder.iterdir())) == 3
    monkeypatch.setattr(files, "made_by", lambda *_: "another tracer")
    WholeLight(scene, fast, keep=True)
    assert len(list(folder.iterdir())) == 4


def damaged(way: str, path) -> None:
    with np.load(path) as kept:
        arrays = {name: kept[name] for name in kept.files}
    first = next(iter(arrays))
    whole = path.read_bytes()
    path.unlink()
    match way:
        case "cut":
            path.write_bytes(whole[: len(whole) // 2])
        case "flipped":
            path.write_bytes(whole[:-9000] + bytes([whole[-9000] ^ 1]) + whole[-8999:])
        case "pipe":
            os.mkfifo(path)
        case "NaN":
            arrays[first] = np.full_like(arrays[first], np.nan)
        case "shape":
            arrays[first] = arrays[first][:-1]
        case "kind":
            arrays[first] = arrays[first].astype(float)
        case "altered":
            arrays[first] = arrays[first] + 1
        case "one less":
            del arrays[first]
        case "one more":
            arrays["more"] = arrays[first]
    if not path.exists():
        np.savez(path, **arrays)


@pytest.mark.parametrize("way", ["cut", "flipped", "pipe", "NaN", "shape", "kind", "altered", "one less", "one more"])
def test_a_damaged_or_crafted_file_is_made_anew(overlap, fast, folder, way):
    scene = small(overlap, 24, 18)
    before = WholeLight(scene, fast, keep=True).halves
    (path,) = folder.iterdir()
    damaged(way, path)
    after = WholeLight(scene, fast, keep=True).halves
    for one, other in zip(before, after, strict=True):
        for part, picture in one.items():
            np.testing.assert_array_equal(other[part], picture)
    if way != "pipe":  # which is nobody's to remove
        assert light_parts.CACHE.load_arrays(path.stem) is not None


def test_a_folder_that_cannot_be_written_is_no_error(overlap, fast, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path / "file"))
    assert WholeLight(small(overlap, 24, 18), fast, keep=True).halves


# ------------------------------------------------------------------------------------------------ factors of the light


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"bounce 1": 0.5}, "the first bounce is too dark by a factor of 2."),
        ({"bounce 2": 0, "bounce 3+": 0}, "what all bounces but the first bring is missing"),
        ({"occlusion": 0.5}, "what hides the sky is 0."),
        ({"sun": pi}, "the sun's part is 3.1"),
        ({}, ""),
    ],
)
def test_of_light_that_chance_finds_the_fewest_factors_are_told(scenes, fast, factors, words):
    """64 samples a pixel; a part's factor may err by 4 of its standard errors, some per cent."""
    overlap = files.read_scene(scenes / "overlap").scene
    scene = small(overlap, 120, 90)
    dark = msgspec.structs.replace(scene, lights=(scene.sun,))
    parts = speed.light_parts(scene, fast, samples=64, seed=5)
    sun = speed.light_parts(dark, fast, samples=64, seed=5)
    shown = sum(np.float32(factors.get(name, 1)) * image.mean for name, image in parts.items())
    shown = shown + np.float32(factors.get("sun", 1) - 1) * (sun["open"].mean + sun["shadow"].mean)
    right = speed.walk(scene, "path", fast, samples=64, seed=7)
    half = 3 * np.sqrt(2 * right.variance)
    found = split(
        look(
            SubmittedImage(
                scene, shown, right.mean, "path", half=half, sampled=sampled_parts(scene, "path", fast, "area")
            )
        )
    )
    assert found.words.startswith(words) if words else found.words == ""
    assert found.explained > 0.9 or not words
    told = {part: f for part, f in factors.items() if part != "bounce 3+"}
    assert len(found.shares) == len(told)
    for share in found.shares:
        assert share.factor == pytest.approx(next(iter(told.values())), abs=4 * share.error)
        assert share.error < 0.05


@pytest.mark.parametrize(("count", "most"), [(60, 1 << 18), (640, 1 << 15), (100_000, 1 << 12)])
def test_the_more_objects_a_scene_has_the_fewer_pixels_the_ledger_takes(single, monkeypatch, count, most):
    none = {f"{half} {part}": np.zeros(3) for half in (0, 1) for part in speed.PARTS}
    monkeypatch.setattr(WholeLight, "_sampled", lambda _: none | {"seconds": np.zeros(len(speed.PARTS) - 1)})
    crowd = msgspec.structs.replace(single, objects=(single.spheres[0],) * count)
    pixels = math.prod(WholeLight(crowd, "drjit32").shape[:2])
    assert most / 4 < pixels <= most
