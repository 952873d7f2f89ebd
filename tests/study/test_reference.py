"""References: whole or refused, stale when their scene moves, resumed when interrupted, replaced only when asked."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from program import raytwin, refused

from raytwin import twin
from raytwin.compare import compare
from raytwin.errors import InputError
from raytwin.fast import trace
from raytwin.renderers import references
from raytwin.scene import Tolerance
from raytwin.scene.scene_files import read_scene, scene_and_photos
from raytwin.study import make_reference

SIZE = (48, 36)
render_module = sys.modules["raytwin.twin.rendering"]


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path_factory.mktemp("cache")))
    twin.activate()


@pytest.fixture
def overlap(scenes, tmp_path) -> Path:
    """A copy of the scene that a test may change."""
    return Path(shutil.copytree(scenes / "overlap", tmp_path / "scenes" / "overlap"))


@pytest.fixture
def folder(tmp_path) -> Path:
    return tmp_path / "reference"


def make(scene: Path, rung: str, folder: Path, **options) -> make_reference.Change:
    change = make_reference.make(scene, rung, folder, **({"size": SIZE, "samples": 64} | options))
    references.save(change.new)
    return change


def edit(scene: Path, old: str, new: str) -> None:
    text = (scene / "scene.toml").read_text()
    assert old in text
    (scene / "scene.toml").write_text(text.replace(old, new))


# ------------------------------------------------------------------------------------------ files


@pytest.mark.parametrize("rung", ["surface", "shadow", "path"])
def test_a_reference_is_read_back_as_it_was_made(overlap, folder, rung):
    made = make(overlap, rung, folder).new
    read = references.load(made.path)
    assert (read.header, read.scene) == (made.header, made.scene)
    assert np.array_equal(read.image.mean, made.image.mean)
    noisy = rung == "path"
    assert (read.image.variance is not None) == noisy
    assert read.image.batches == (64 if noisy else None)
    assert (read.image.surface is not None) == (rung == "surface")
    said = {"raytwin", "mitsuba", "variant", "samples", "seed", "filter", "sampling", "scene_hash"}
    assert said <= read.header.keys()


def test_no_flipped_byte_goes_unnoticed(overlap, folder):
    made = make(overlap, "path", folder, size=(12, 9)).new
    whole = made.path.read_bytes()
    noticed = 0
    for at in np.linspace(0, len(whole) - 1, 250).astype(int):
        made.path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
        try:
            read = references.load(made.path)
        except InputError:
            noticed += 1
            continue
        # What EXR itself does not read (a table of offsets, a window on the screen) may change unnoticed.
        assert read.header == made.header
        assert np.array_equal(read.image.mean, made.image.mean)
        assert np.array_equal(read.image.variance, made.image.variance)
    assert noticed > 200


def test_what_is_no_reference_is_refused(overlap, folder):
    """A file cut short, one under another name, a name that leads out of the folder, samples that do not divide."""
    made = make(overlap, "shadow", folder).new
    moved = made.path.with_name("lambert.exr")
    shutil.copy(made.path, moved)
    with pytest.raises(InputError, match="that of overlap, shadow"):
        references.load(moved)
    whole = made.path.read_bytes()
    for part in (0, 100, len(whole) // 2, len(whole) - 1):
        made.path.write_bytes(whole[:part])
        with pytest.raises(InputError, match=r"shadow\.exr"):
            references.load(made.path)
    for name in ("", "..", "a/b", "../overlap"):
        with pytest.raises(InputError, match="scene"):
            references.path_of(folder, name, "path")
    with pytest.raises(InputError, match="multiple of 64"):
        make(overlap, "path", folder, samples=100)


@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1e-12, 1e-3, 1.0, 1e4]))
def test_a_noisy_mean_is_kept_to_a_quarter_of_its_deviation_and_its_noise_free_pixels_to_the_bit(seed, scale):
    rng = np.random.default_rng(seed)
    mean = (scale * rng.random((6, 7, 3))).astype(np.float32)
    sd = (scale * 10.0 ** rng.uniform(-5, 0, mean.shape)).astype(np.float32) * (rng.random(mean.shape) < 0.7)
    kept = references.stepped(mean, np.square(sd))
    assert np.array_equal(kept[sd == 0], mean[sd == 0])
    assert (np.abs(kept - mean) <= sd / 4 * 1.001 + np.abs(mean) * 2.0**-24).all()
    assert np.array_equal(references.stepped(kept, np.square(sd)), kept)
    assert len(np.unique(references.stepped(mean, np.full_like(sd, scale * scale)))) < 5


@given(st.lists(st.floats(0, 2.0**100, width=32), min_size=1, max_size=20))
def test_rounding_keeps_eight_bits_to_nearest(values):
    x = np.array(values, np.float32)
    short = references.rounded(x, 8)
    assert not (short.view(np.uint32) & 0xFFFF).any()
    normal = x > 1e-37
    assert (np.abs(short[normal] - x[normal]) <= x[normal] * np.float64(2.0**-8)).all()


@given(st.integers(1, 20000), st.integers(1, 20000))
def test_a_reference_keeps_its_cameras_aspect_ratio(width, height):
    w, h = make_reference.size_of((width, height))
    assert w <= width
    assert h <= height
    if (w, h) != (width, height) and min(w, h) > 10:
        assert w * h == pytest.approx(make_reference.PIXELS, rel=0.06)
        assert w / h == pytest.approx(width / height, rel=0.06)
    assert make_reference.size_of((640, 480)) == (336, 252)
    for extreme in ((100, 10**9), (10**9, 100)):  # one pixel across is the least
        assert min(make_reference.size_of(extreme)) == 1


# ------------------------------------------------------------------------------------------ scenes


def test_the_hash_is_of_what_the_scene_says_not_of_how(overlap):
    before = references.scene_hash(overlap)
    edit(overlap, "# Three spheres", "# Some spheres")
    edit(overlap, "[[760.0, 0.0,", "[[760, 0,")
    assert references.scene_hash(overlap) == before
    edit(overlap, "[-0.8, -0.1, 0.55]", "[-0.8, -0.1, 0.56]")
    assert references.scene_hash(overlap) != before


def test_the_hash_of_a_photographed_scene_is_of_its_photos_and_board(scenes, tmp_path):
    desk = Path(shutil.copytree(scenes / "desk", tmp_path / "desk"))
    before = references.scene_hash(desk)
    (desk / "notes.txt").write_text("no part of the scene")
    (desk / "board.toml").write_text("# the same board\n" + (desk / "board.toml").read_text())
    assert references.scene_hash(desk) == before
    photo = desk / "photos" / "photo_03.jpg"
    photo.write_bytes(photo.read_bytes() + b"\0")
    assert references.scene_hash(desk) != before


def test_a_camera_that_photos_gave_stays_with_its_reference_while_the_scene_is_the_same(scenes, folder):
    desk, camera = scene_and_photos(scenes / "desk")[0], read_scene(scenes / "overlap").camera
    first, moved = (desk.with_camera(camera.resized(width, 36)) for width in (48, 47))
    made = make(scenes / "desk", "shadow", folder, found=first).new
    again = make_reference.make(scenes / "desk", "shadow", folder, found=moved, again=True)
    assert (again.kind, again.new.camera) == ("same", made.camera)
    larger = make_reference.make(scenes / "desk", "shadow", folder, found=moved, size=(94, 72))
    assert larger.new.camera == moved.camera.resized(94, 72)


# ------------------------------------------------------------------------------------------ make, check


def test_making_again_renders_nothing_for_a_new_tolerance_neither(overlap, folder, monkeypatch):
    before = make(overlap, "path", folder).new.path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(twin, "render", None)
        again = make(overlap, "path", folder, samples=None, size=None)
    assert (again.kind, again.new.path.read_bytes()) == ("same", before)
    (overlap / "scene.toml").write_text((overlap / "scene.toml").read_text() + "\n[tolerance]\np999_abs = 2e-5\n")
    assert "tolerance" in make_reference.check(overlap, "path", folder).problems[0]
    monkeypatch.setattr(twin, "render", None)
    change = make(overlap, "path", folder)
    assert change.kind == "changed"
    assert references.load(change.new.path).tolerance == Tolerance(p999_abs=2e-5)


def test_an_interrupted_render_goes_on_where_it_stopped(overlap, folder, monkeypatch, tmp_path):
    uninterrupted = make(overlap, "path", folder).new.image
    monkeypatch.setenv("RAYTWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("raytwin.twin.render_cache.WORTH_KEEPING", 0.0)
    sampled, rendered = render_module._rendered, []

    def break_off(*arguments):
        if len(rendered) == 3:
            raise KeyboardInterrupt
        rendered.append(1)
        return sampled(*arguments)

    fresh = tmp_path / "fresh"
    with monkeypatch.context() as patch:
        patch.setattr(render_module, "_rendered", break_off)
        with pytest.raises(KeyboardInterrupt):
            make(overlap, "path", fresh)
        assert not list(tmp_path.glob("fresh/**/*.*"))
        rendered = [1] * -5
        patch.setattr(render_module, "_rendered", lambda *a: (rendered.append(1), sampled(*a))[1])
        resumed = make(overlap, "path", fresh).new.image
    assert len(rendered) == 8 - 3
    assert np.array_equal(resumed.mean, uninterrupted.mean)
    assert np.array_equal(resumed.variance, uninterrupted.variance)


def test_every_stint_and_every_check_has_random_numbers_of_its_own(overlap, folder, monkeypatch):
    seeds, rendered = [], twin.render
    monkeypatch.setattr(twin, "render", lambda *a, **o: (seeds.append(o["seed"]), rendered(*a, **o))[1])
    make(overlap, "path", folder)
    make_reference.check(overlap, "path", folder)
    assert len(set(seeds)) == len(seeds) > 8


@pytest.mark.parametrize("rung", ["shadow", "path"])
def test_a_reference_that_todays_mitsuba_does_not_make_fails(overlap, folder, rung):
    """Whole, fresh, signed, and 1 % too bright; as it was made it agrees."""
    made = make(overlap, rung, folder, size=(96, 72), samples=256).new
    assert make_reference.check(overlap, rung, folder).passed
    bright = replace(made.image, mean=made.image.mean * np.float32(1.01))
    references.save(references.sealed(made.path, bright, made.header, made.scene))
    problems = make_reference.check(overlap, rung, folder).problems
    assert "today's render disagrees" in problems[0]
    assert "%" in problems[1]


# ------------------------------------------------------------------------------------------ the command


def test_the_command_replaces_only_when_told_to(overlap, folder, tmp_path):
    def run(*words: str, code: int = 0) -> str:
        done = raytwin("reference", *words, cwd=tmp_path)
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr

    asked = ("make", "overlap", "--rung", "shadow")
    assert run(*asked, "--rung", "path", "--size", "48x36", "--samples", "64").count("written") == 2
    run("check", "--rung", "shadow")
    edit(overlap, "radius = 0.05\n", "radius = 0.051\n")
    before = (folder / "overlap" / "shadow.exr").read_bytes()
    stale = run("check", "--rung", "shadow", code=1)
    assert "FAIL  overlap/shadow" in stale
    assert "stale: the scene has changed since: spheres" in stale
    told = run(*asked, code=2)
    for part in ("scene_hash", "differs from the old", "ratio of the means 1.0003", "--yes"):
        assert part in told
    assert (folder / "overlap" / "shadow.exr").read_bytes() == before
    run(*asked, "--yes")
    assert (folder / "overlap" / "shadow.exr").read_bytes() != before
    run("check", "scenes/overlap", "--rung", "shadow")


def test_accept_takes_one_reference_with_the_reason_in_its_header(overlap, folder, tmp_path):
    where = "scenes/overlap/lambert"
    make(overlap, "lambert", folder, size=(160, 120), sampling="area", samples=64)
    make(overlap, "surface", folder)
    edit(overlap, "radius = 0.05", "radius = 0.045")
    done = raytwin("reference", "accept", where, "--because", "a smaller ball", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "scene: now other spheres" in done.stdout
    found = references.load(folder / "overlap" / "lambert.exr")
    kept = ["a smaller ball", "160 x 120", "area", "64"]
    assert [found.header[key] for key in ("because", "size", "sampling", "samples")] == kept
    assert references.stale(found, overlap) is None
    assert "stale" in make_reference.check(overlap, "surface", folder).problems[0]
    again = raytwin("reference", "accept", where, "--because", "once more", cwd=tmp_path)
    assert "because: once more (before: a smaller ball)" in again.stdout
    for words, said in (
        ((where,), "--because: expected the reason why"),
        (("scenes/overlap/shadwo",), "did you mean shadow?"),
        (("missing.exr",), "expected a reference, got no such file"),
    ):
        refused(raytwin("reference", "accept", *words, cwd=tmp_path), said)


def test_show_tells_a_line_of_each_reference_and_all_of_a_single_one(overlap, folder, tmp_path):
    def shown(*words: object) -> str:
        return raytwin("reference", "show", *words, cwd=tmp_path).stdout

    found = [make(overlap, rung, folder).new for rung in ("lambert", "shadow")]
    lines = shown().splitlines()
    assert [line.split()[0] for line in lines] == ["reference", "overlap/lambert", "overlap/shadow"]
    assert f"{float(found[1].image.mean.mean()):.4g}" in lines[2]
    single = shown("--rung", "shadow")
    assert found[1].header["scene_hash"] in single
    assert "mitsuba" in single
    assert shown(found[1].path.relative_to(tmp_path)) == shown(overlap / "scene.toml", "--rung", "shadow") == single
    for words, said in (
        (("check", found[1].path), "expected a scene's folder, its scene.toml or its name, got an image"),
        (("show", "overlpa"), "did you mean overlap?"),
        (("show", "--rung", "sun"), "--rung"),
        (("check", "nosuch"), "nosuch"),
    ):
        refused(raytwin("reference", *words, cwd=tmp_path), said)


def test_check_exits_with_2_on_what_it_cannot_read_once_all_others_were_checked(overlap, folder, tmp_path):
    """Missing, cut short, or no reference at all is bad input; 1 says that a comparison failed, and nothing else."""
    path = make(overlap, "lambert", folder).new.path
    make(overlap, "shadow", folder)
    asked = ("check", "overlap", "--rung", "lambert", "--rung", "shadow")
    for spoil in (lambda: path.write_bytes(path.read_bytes()[:-50]), lambda: path.write_text("no EXR"), path.unlink):
        spoil()
        done = raytwin("reference", *asked, cwd=tmp_path)
        assert done.returncode == 2, done.stdout + done.stderr
        for line in ("?     overlap/lambert", "PASS  overlap/shadow", "2 references, 0 failed, 1 could not be checked"):
            assert line in done.stdout
    edit(overlap, "radius = 0.05\n", "radius = 0.051\n")
    assert raytwin("reference", *asked, cwd=tmp_path).returncode == 1
    path.write_bytes(b"no EXR")
    for words in ((), ("nosuch.exr",)):
        assert raytwin("reference", "show", *words, cwd=tmp_path).returncode == 2


# ------------------------------------------------------------------------------------------ the shipped ones

NAMES = ["ball", "desk", "distorted", "eclipse", "gloss", "grazing", "overlap", "single", "studio", "wedge", "weekend"]
ALL = [(name, rung) for name in NAMES for rung in make_reference.RUNGS]


def test_every_shipped_scene_has_all_its_references(scenes):
    assert references.listed(references.SHIPPED) == sorted([*ALL, ("glass", "path")], key=lambda case: case[0])
    assert {f.parent.name for f in scenes.glob("*/scene.toml")} == {name for name, _ in ALL}
    assert sum(f.stat().st_size for f in references.SHIPPED.glob("*/*.exr")) < 40e6


@pytest.mark.parametrize(("name", "rung"), ALL)
def test_a_shipped_reference_is_whole_and_of_its_scene(scenes, name, rung):
    found = references.load(references.path_of(references.SHIPPED, name, rung))
    assert references.stale(found, scenes / name) is None
    assert found.image.samples >= (4096 if rung in ("sky", "path") else 1)
    if rung in ("surface", "lambert", "shadow"):  # what the tracer can do too
        made = compare(trace(found.scene, rung), found.image, tolerance=found.tolerance)
        assert made.passed, made.reasons


@pytest.mark.parametrize(("name", "rung"), [("desk", "shadow"), ("distorted", "surface"), ("overlap", "path")])
def test_todays_mitsuba_agrees_with_shipped_references(scenes, name, rung):
    done = make_reference.check(scenes / name, rung, references.SHIPPED)
    assert done.passed, done.problems


def test_in_the_scene_single_the_sky_and_the_bounces_add_what_the_closed_form_says():
    """A convex sphere alone: no part of it sees another, so `lambert` is exact at every rung.

    But for one ray in 4096, here and there, that leaves the sphere so flatly that rounding lets it hit.
    """
    images = [references.load(references.path_of(references.SHIPPED, "single", r)).image for r in ("lambert", "path")]
    np.testing.assert_allclose(images[1].mean, images[0].mean, atol=1e-4)
