"""The records: immutable, and consistent with the conventions."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scene_of import scene_of

from raytwin.errors import InputError
from raytwin.renderers.references import scene_hash
from raytwin.scene import (
    NOWHERE,
    Camera,
    Rectangle,
    Scene,
    Sky,
    Sphere,
    Sun,
    to_camera_frame,
)
from raytwin.scene.scene_files import read_scene, scene_and_photos
from raytwin.scene.toml_json import to_record

CAMERA = Camera(
    (640, 480),
    ((800.0, 0.0, 310.0), (0.0, 790.0, 250.0), (0.0, 0.0, 1.0)),
    ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    (0.1, 0.2, 0.5),
    (-0.1, 0.02),
)


@given(st.tuples(*[st.floats(-1e9, 1e9)] * 3).filter(lambda v: any(v)))
def test_a_sun_made_again_keeps_its_last_bits(v):
    sun = Sun(v)
    assert math.hypot(*sun.to_light) == pytest.approx(1, rel=1e-15)
    assert np.dot(sun.to_light, v) == pytest.approx(math.hypot(*v), rel=1e-12)
    assert msgspec.structs.replace(sun, irradiance=(1.0, 1.0, 1.0)).to_light == sun.to_light
    assert msgspec.json.decode(msgspec.json.encode(sun), type=Sun) == sun


A, B = Sphere((0.0,) * 3, 1.0), Sphere((1.0,) * 3, 1.0)
LEAF = Rectangle((0.0,) * 3, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def test_an_objects_number_counts_spheres_and_then_planes_in_whatever_order_they_come():
    scene = Scene("x", CAMERA, (A, B), (LEAF,))
    assert (scene.objects, scene.numbers) == ((A, B, LEAF), ("sphere 0", "sphere 1", "plane 0"))
    assert Scene("x", CAMERA).with_(objects=(A, LEAF, B)) == scene
    assert scene.with_camera(CAMERA.resized(10, 10)).camera.image_size == (10, 10)
    with pytest.raises(InputError, match=r"spheres\[1\]: expected a Sphere, got Rectangle"):
        Scene("x", CAMERA, (A, LEAF), (B,))


def test_a_scene_without_lights_is_dark():
    scene = Scene("x", CAMERA)
    assert (scene.sun.irradiance, scene.sky.radiance, scene.environment) == ((0, 0, 0), (0, 0, 0), None)
    assert scene.with_(sun=Sun((0.0, 0.0, 1.0)), sky=Sky((0.1, 0.2, 0.3))).with_(sun=None, sky=None) == scene


def test_a_highlight_has_both_numbers_and_sends_back_no_more_than_comes():
    assert Sphere((0.0,) * 3, 1.0, (0.4, 0.5, 0.2), (0.1, 0.2, 0.8), 5.0).highlight
    for wrong, said in (({"exponent": 5.0}, "both"), ({"specular": (0.3, 0.1, 0.1), "exponent": 5.0}, "got 1.1")):
        with pytest.raises(InputError, match=f"specular: expected .*{said}"):
            Sphere((0.0,) * 3, 1.0, (0.8, 0.5, 0.2), **wrong)


def test_a_camera_yet_to_be_calibrated_is_refused_until_it_is_found(scenes):
    with pytest.raises(InputError, match="desk: camera: expected a calibrated camera, got photos to calibrate it from"):
        read_scene(scenes / "desk")
    scene, photos = scene_and_photos(scenes / "desk")
    assert (scene.camera, photos.board, len(scene.spheres) > 0) == (NOWHERE, "board.toml", True)


@pytest.mark.parametrize(("precision", "size"), [("float32", 1e-20), ("float64", 1e154)])
def test_a_length_whose_square_floats_cannot_hold_is_named(precision, size):
    camera = Camera((1, 1), *2 * (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),), (0.0, 0.0, 0.0))
    scene = scene_of("stars", camera, (Sphere((0.0, 0.0, 3 * size), size),))
    with pytest.raises(InputError, match=r"objects\[0\] of scene stars: expected lengths of .* for " + precision):
        to_camera_frame(scene, precision)


def upright(*things, eye=(0.1, 0.2, 0.5)) -> Scene:
    """Seen from `eye`, looking along y, a little down: turned, so that coordinates are rounded."""
    down = math.radians(20)
    R = np.array([[1, 0, 0], [0, -math.sin(down), -math.cos(down)], [0, math.cos(down), -math.sin(down)]])
    camera = Camera(
        (1, 1), ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), tuple(map(tuple, R.tolist())), tuple((-R @ eye).tolist())
    )
    return scene_of("places", camera, things)


TABLE = Rectangle((0.1, 0.05, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
OVER = Rectangle((0.5, 0.4, 0.0), (0.21, 0.21, 0.0), (0.3, -0.3, 0.0))
ACROSS = Rectangle((1.3, 0.0, 0.0), (0.25, 0.0, 0.0), (0.0, 5.0, 0.0))
BESIDE = Rectangle((1.5, 0.05, 0.0), (0.4, 0.0, 0.0), (0.0, 1.0, 0.0))
THROUGH = Rectangle((0.1, 0.05, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.5))
DIAGONAL = Rectangle((1.5, 1.95, 0.0), (0.4, 0.4, 0.0), (0.4, -0.4, 0.0))
TWICE = r"objects\[1\] of scene places: expected a surface apart from all others"
WITHIN = r"camera of scene places: expected an eye off every surface"


def raised(sheet: Rectangle, height: float) -> Rectangle:
    return msgspec.structs.replace(sheet, center=(*sheet.center[:2], height))


@pytest.mark.parametrize(
    ("things", "eye", "refused"),
    [
        ((TABLE, OVER), (0.1, 0.2, 0.5), TWICE), ((OVER, TABLE), (0.1, 0.2, 0.5), TWICE),
        ((TABLE, ACROSS), (0.1, 0.2, 0.5), TWICE), ((TABLE, raised(ACROSS, 1e-8)), (0.1, 0.2, 0.5), TWICE),
        ((TABLE, raised(OVER, 1e-4)), (0.1, 0.2, 0.5), None),
        ((TABLE, BESIDE, THROUGH, DIAGONAL), (0.1, 0.2, 0.5), None),
        ((TABLE,), (0.3, 0.4, 0.0), WITHIN), ((TABLE,), (1.3, 0.4, 0.0), None), ((TABLE,), (0.3, 0.4, 1e-4), None),
    ],
)  # fmt: skip
def test_surfaces_in_one_place_and_an_eye_within_one_are_refused_and_neighbours_are_not(things, eye, refused):
    if refused is None:
        to_camera_frame(upright(*things, eye=eye), "float32")
        return
    with pytest.raises(InputError, match=refused):
        to_camera_frame(upright(*things, eye=eye), "float32")


def test_objects_go_by_their_names_else_by_kind_and_number_and_a_name_decides_nothing(tmp_path, scenes):
    text = (scenes / "overlap" / "scene.toml").read_text(encoding="utf-8")
    for folder, written in (("named", text), ("plain", text.replace('name = "floor"\n', ""))):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "scene.toml").write_text(written, encoding="utf-8")
    named, plain = (read_scene(tmp_path / folder) for folder in ("named", "plain"))
    balls = ("sphere 0", "sphere 1", "sphere 2")
    assert named.names == (*balls, "floor")
    assert plain.names == (*balls, "plane 0")
    assert named.numbers == plain.numbers == ("sphere 0", "sphere 1", "sphere 2", "plane 0")
    assert scene_hash(tmp_path / "named") == scene_hash(tmp_path / "plain")
    assert named.differences(plain) == ["name", "planes"]
    again = to_record("scene", msgspec.json.decode(msgspec.json.encode(named)), Scene)
    assert again.names == named.names
    (tmp_path / "named" / "scene.toml").write_text(
        text.replace("radius", 'name = "floor"\nradius', 1), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"planes\[0\]\.name: expected a name that no other object has, got 'floor'"):
        read_scene(tmp_path / "named")
