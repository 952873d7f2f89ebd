"""raytwin scenes export: what other renderers are told is the scene, and they render the same picture from it."""

import json
import os

import numpy as np
import pytest
from program import raytwin, refused
from scene_of import scene_of
from truths import view_of

from raytwin import twin
from raytwin.compare import compare
from raytwin.images import image_input
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Rectangle, Scene, Shape, Sky, Sphere, Sun
from raytwin.scene.scene_files import read_scene
from raytwin.twin.mitsuba_xml import mitsuba_xml


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


EYE = np.array((0.5, -0.7, 0.6))


def from_afar(far: float, *objects: Shape) -> Scene:
    """The objects about the origin, seen from `far` metres away."""
    camera = view_of((0, 0, 0), EYE * far, 0.5 * far, 48)
    return scene_of("far", camera, objects, (Sun((0.4, 0.5, 0.8)), Sky((0.5, 0.7, 1.0))))


def sheet(half: float) -> Rectangle:
    return Rectangle((0, 0, 0), (half, 0, 0), (0, half, 0))


BUILT = {
    "eight kilometres": from_afar(13e3, Sphere((0, 0, 900.0), 900.0), sheet(8e3)),
    "half a millimetre": from_afar(12e-3, *(Sphere((x * 1e-3, 0, 5e-4), 5e-4) for x in (-1, 0, 1)), sheet(0.01)),
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "rung", "samples"),
    [("overlap", "path", 64), ("wedge", "sky", 64), ("weekend", "sky", 64), ("eight kilometres", "path", 64),
     ("half a millimetre", "sky", 256)],
)  # fmt: skip
def test_mitsuba_renders_the_same_picture_from_the_file(scenes, tmp_path, name, rung, samples):
    """`overlap`: three spheres and a sheet; `wedge`: two planes of one albedo, which Mitsuba would merge and leak;
    `weekend`: a ground of 1 km; beyond 10 km and below 1 mm a file in metres clips and shifts.
    """
    twin.activate()
    import mitsuba as mi

    scene = BUILT.get(name) or read_scene(scenes / name)
    w, h = scene.camera.image_size
    scene = scene.with_camera(scene.camera.resized(64, round(64 * h / w)))
    (tmp_path / "scene.xml").write_text(mitsuba_xml(scene, rung))
    loaded = mi.load_file(str(tmp_path / "scene.xml"))
    renders = [np.array(mi.render(loaded, spp=samples, seed=seed)) for seed in range(8)]
    reference = twin.render(scene, rung, sampling="area", samples=8 * samples, seed=99)
    found = compare(image_input.as_image(renders).image, reference)
    assert found.verdict == "pass", found.reasons
    wrong = compare(image_input.as_image([0.98 * np.float32(r) for r in renders]).image, reference)
    assert wrong.verdict == "fail"  # so much it would have seen


def test_what_a_file_of_mitsubas_cannot_say_is_told_in_one_line():
    for name, said in (
        ("weekend", "Mitsuba's float32 may shade them falsely: object-0"),
        ("distorted", "no lens distortion and one focal length"),
    ):
        run = raytwin("scenes", "export", name, "--mitsuba-xml", "-o", os.devnull)
        assert (run.returncode, run.stderr.count("\n")) == (0, 1)
        assert said in run.stderr


def test_what_is_asked_wrongly_is_told():
    for words, said in (
        ("studio --mitsuba-xml", "the same radiance everywhere, for this, got an environment map"),
        ("gloss --mitsuba-xml", "Lambertian objects alone, for a file of Mitsuba's, got a Phong highlight"),
        ("overlap --mitsuba-xml --rung shadow", "--rung: expected a light level that Mitsuba's integrators have"),
        ("overlap --rung shadw", "did you mean shadow?"),
        ("nowhere", "nowhere"),
    ):
        refused(raytwin("scenes", "export", *words.split()), said)
