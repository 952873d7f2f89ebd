"""Delta debugging: what is left still fails as before, and nothing of it can be left out."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted_renderers import Planted
from program import raytwin, refused
from scene_of import changed

from raytwin.errors import InputError
from raytwin.fast import trace
from raytwin.renderers.scene_exchange import as_scene
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene.scene_files import read_scene, write_scene
from raytwin.study.compare_scene import compare_scene
from raytwin.study.shrink import minimized, parts_of, shrink

pytestmark = pytest.mark.nightly

SMALL = (80, 60)


@given(st.integers(0, 12), st.lists(st.sets(st.integers(0, 11), max_size=4), min_size=1, max_size=3))
def test_what_is_left_fails_and_no_part_of_it_can_be_left_out(n, causes):
    """Any of several sets of parts may make it fail, so that it does not depend on single parts."""
    known = [cause & set(range(n)) for cause in causes]
    asked = []

    def fails(kept):
        asked.append(len(kept))
        return any(cause <= set(kept) for cause in known)

    left = minimized(range(n), fails)
    assert fails(left)
    assert left == sorted(left)
    assert not any(fails([x for x in left if x != one]) for one in left)
    assert len(asked) <= n * n + 4 * n + 8


@pytest.mark.parametrize(
    ("fault", "kind", "left"),
    [("no shadows", "radiance", {"the sun"}), ("red and blue exchanged", "radiance", set()),
     ("crash with two spheres", "error", set())],
)  # fmt: skip
def test_a_planted_mistake_is_shown_by_two_objects_at_most(scenes, tmp_path, fault, kind, left):
    subject = Planted("shadow", fault)
    found = shrink(scenes / "overlap", subject=subject, size=SMALL)
    assert len(found.after.objects) <= 2
    assert found.failure.kind == kind
    assert found.evaluations == len(subject.calls)
    assert len(set(subject.calls)) == len(subject.calls)  # a seed of its own each time
    assert left <= set(found.kept)
    assert set(found.removed) | set(found.kept) == set(parts_of(found.before))
    written = write_scene(tmp_path / "small" / "scene.toml", found.after, "why")
    if kind == "error":
        with pytest.raises(InputError, match="IndexError"):
            compare_scene(written, subject=subject)
    else:
        assert compare_scene(written, subject=subject).verdict == "fail"


def test_the_small_scene_has_the_light_that_is_asked_for_and_a_part_left_out_is_gone(scenes, tmp_path):
    (tmp_path / "light.toml").write_text(
        "[sun]\nto_light = [0.0, 0.6, 0.8]\nirradiance = [3.0, 1.0, 0.5]\n[sky]\nradiance = [0.1, 0.2, 0.3]\n"
        "[paper]\nalbedo = 0.85\ncolor = [1.0, 1.0, 1.0]\n"
    )
    asked = {"size": (48, 36), "light": tmp_path / "light.toml"}
    found = shrink(scenes / "overlap", subject=Planted("shadow", "no shadows"), **asked)
    assert found.after.sun.irradiance == (3.0, 1.0, 0.5)
    for name in ("studio", "gloss", "distorted"):
        small = read_scene(scenes / name)
        for leave_out in parts_of(small).values():
            small = leave_out(small)
        assert not small.objects
        assert not any((*small.sun.irradiance, *small.sky.radiance, *small.camera.coefficients))  # nor a map


def test_a_bug_that_one_sphere_shows_ends_with_that_sphere(scenes):
    """What a renderer does to one sphere alone: nothing else of four objects is needed."""

    def render(told):
        scene = as_scene(told)
        green = next((s for s in scene.spheres if s.albedo[1] > 0.4), None)
        if green is None:
            return trace(scene).mean
        larger = msgspec.structs.replace(green, radius=1.2 * green.radius)
        objects = tuple(larger if thing is green else thing for thing in scene.objects)
        return trace(changed(scene, objects=objects)).mean

    found = shrink(scenes / "overlap", subject=UserRenderer("shadow", "one sphere", render), size=SMALL)
    assert len(found.after.spheres) == 1
    assert len(found.after.objects) == 1


def test_what_cannot_be_cut_down_is_refused(scenes):
    calls = []

    def moody(told):
        calls.append(told)
        if len(calls) == 1:
            raise ValueError("the first call")
        return np.zeros((told["height"], told["width"], 3))

    gamma = Planted("shadow", "gamma")
    for name, options, said in (
        ("single", {"subject": Planted("shadow", "no distortion")}, "a renderer that fails on this scene"),
        ("single", {"subject": None}, "--subject is missing"),
        ("single", {"subject": gamma, "time_limit": 0}, "--time-limit"),
        ("glass", {"subject": gamma}, r"Mitsuba file was removed in 0\.2\.0"),
        ("single", {"subject": UserRenderer("shadow", "moody", moody)}, "fails by chance: first .*the first call"),
    ):
        with pytest.raises(InputError, match=said):
            shrink(scenes / name, size=(40, 30), **options)
    assert len(calls) == 2


def test_the_command_writes_a_scene_its_story_and_the_numbers(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom raytwin.renderers.scene_exchange import as_scene\nfrom raytwin.tracer import trace\n"
        "def render(scene):\n    return 2 * trace(as_scene(scene), scene['rung']).mean\n"
    )
    asked = "--subject", "mine.py:render", "--size", "80x60", "--json", "s.json"
    done = raytwin("shrink", "overlap", *asked, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told, file = msgspec.json.decode((tmp_path / "s.json").read_bytes()), tmp_path / "out/shrink-overlap/scene.toml"
    assert told["objects"]["after"] <= 2
    assert told["kind"] == "radiance"
    first, *story = (line.removeprefix("# ") for line in file.read_text().splitlines() if line.startswith("#"))
    assert first == "overlap, reduced by raytwin shrink."
    assert f"To reproduce: {told['command']}" in story
    assert set(story) <= set(done.stdout.splitlines())
    assert read_scene(file).camera.image_size == tuple(told["image_size"]["after"])
    image = raytwin("shrink", "overlap", "--subject", Path("out/shrink-overlap"), cwd=tmp_path)
    refused(image, "an image shows one scene alone")
