"""Files in and out: what is wrong with an input is said with file, field, what was expected and what was found."""

import io
import os
import re
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import hostile
import msgspec
import numpy as np
import OpenEXR
import pytest
import tomli_w
from counting import calls
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image as Pillow

from raytwin.errors import InputError
from raytwin.images.exr import read_exr, write_exr
from raytwin.images.image import Image, Surface
from raytwin.images.image_formats import read_image
from raytwin.images.photo_files import (
    list_photos,
    photo_size,
    read_grey,
    read_photo,
    readable_photos,
    write_picture,
)
from raytwin.safe_write import replacing, write_text
from raytwin.scene import Camera, Rectangle, Sphere
from raytwin.scene.scene_files import read_camera, read_scene
from raytwin.scene.toml_json import read_toml, write_json, write_toml

SCENE = """
[camera]
image_size = [64, 48]
K = [[80.0, 0.0, 31.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]]
dist = [-0.1, 0.01]
R_cam_board = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
t_cam_board = [0.0, 0.0, 0.5]

[[spheres]]
center = [0.0, 0.0, 0.05]
radius = 0.05

[[spheres]]
center = [0.1, 0.0, 0.04]
radius = 0.04
albedo = [0.8, 0.4, 0.2]

[[planes]]
center = [0.0, 0.0, 0.0]
half_u = [0.2, 0.0, 0.0]
half_v = [0.0, 0.3, 0.0]

[sun]
to_light = [0.3, 0.0, 1.0]

[sky]
radiance = [0.1, 0.1, 0.1]

[tolerance]
p999_abs = 1e-4
"""


def write_scene(folder: Path, text: str) -> Path:
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return folder


def changed(old: str, new: str) -> str:
    assert SCENE.count(old) >= 1, old
    return SCENE.replace(old, new, 1)


# ------------------------------------------------------------------------------------------------ scenes


def test_a_scene_is_read_as_it_is_written(tmp_path):
    (tmp_path / "x").mkdir()
    scene = read_scene(write_scene(tmp_path / "x", SCENE))
    assert scene.name == "x"
    assert scene.camera.image_size == (64, 48)
    assert scene.camera.coefficients == (-0.1, 0.01, 0, 0, 0)
    assert scene.objects[1] == Sphere((0.1, 0.0, 0.04), 0.04, (0.8, 0.4, 0.2))
    assert scene.objects[2:] == (Rectangle((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.3, 0.0)),)
    assert scene.tolerance.p999_abs == 1e-4
    assert read_scene(tmp_path / "x" / "scene.toml") == scene


WRONG = {
    "a negative radius": ("radius = 0.04", "radius = -0.4", "spheres[1].radius: expected metres > 0, got -0.4"),
    "a radius that is text": ("radius = 0.04", 'radius = "4 cm"', "spheres[1].radius: expected metres, got '4 cm'"),
    "a radius that is NaN": ("radius = 0.04", "radius = nan", "spheres[1].radius: expected metres, got 'nan'"),
    "an infinite radius": ("radius = 0.04", "radius = inf", "spheres[1].radius: expected metres, got 'inf'"),
    "no radius": ("radius = 0.04\n", "", "spheres[1].radius is missing."),
    "a huge whole number": ("radius = 0.04", f"radius = {10**400}", "spheres[1].radius: expected metres that 64 bits hold"),  # noqa: E501
    "an unknown key": ("radius = 0.04", "radus = 0.04", "spheres[1].radus is no known key. Did you mean radius?"),
    "an unknown table": ("[sky]", "[skyy]", "skyy is no known key. Did you mean sky?"),
    "a key of the camera's": ("dist = ", "distortion = ", "camera.distortion is no known key."),
    "a key of a table on one line": ("[tolerance]\n", "[tolerance]\nx = { y = 1 }\n", "tolerance.x is no known key."),
    "no camera": ("[camera]", "[tolerance2]", "tolerance2 is no known key."),
    "NaN in a vector": ("[0.1, 0.0, 0.04]", "[0.1, nan, 0.04]", "spheres[1].center[1]: expected a number, got 'nan'"),
    "an albedo over 1": ("[0.8, 0.4, 0.2]", "[0.8, 1.4, 0.2]", "spheres[1].albedo[1]: expected a number <= 1, got 1.4"),
    "a negative sky": ("radiance = [0.1", "radiance = [-0.1", "sky.radiance[0]: expected a number >= 0, got -0.1"),
    "a sun without direction": ("[0.3, 0.0, 1.0]", "[0, 0, 0]", "sun.to_light: expected a direction, got the zero vector"),  # noqa: E501
    "a turned sky": ("radiance = [0.1", "rotation = 90.0\nradiance = [0.1", "sky.rotation is no known key"),
    "texels by hand": ("radiance = [0.1", "texels = 3\nradiance = [0.1", "sky.texels is no known key."),
    "half-edges that lean": ("[0.0, 0.3, 0.0]", "[0.3, 0.3, 0.0]", "planes[0].half_v: expected a vector perpendicular to half_u, got 45 degrees"),  # noqa: E501
    "a half-edge of no length": ("[0.0, 0.3, 0.0]", "[0, 0, 0]", "planes[0].half_u: expected half_u and half_v longer than 0 m"),  # noqa: E501
    "a mirrored R": ("[[1, 0, 0], [0, -1, 0]", "[[1, 0, 0], [0, 1, 0]", "camera.R_cam_board: expected a rotation matrix, got a mirroring (determinant -1): negate an axis"),  # noqa: E501
    "a stretched R": ("[[1, 0, 0]", "[[1.01, 0, 0]", "camera.R_cam_board: expected a rotation matrix, got one that is off by 0.01. The nearest is [[1.0, 0.0, 0.0], "),  # noqa: E501
    "a sheared R": ("[[1, 0, 0]", "[[0.99, 0.14, 0]", "camera.R_cam_board: expected a rotation matrix, got one that is off by 0.07"),  # noqa: E501
    "a negative focal length": ("[[80.0", "[[-80.0", "camera.K: expected focal lengths > 0 px, got -80 and 80"),
    "a skewed K": ("[[80.0, 0.0", "[[80.0, 2.0", "camera.K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] (cameras here have no skew), got ((80.0, 2.0, "),  # noqa: E501
    "a K times two": ("[0.0, 0.0, 1.0]]\ndist", "[0.0, 0.0, 2.0]]\ndist", "camera.K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] (cameras here have no skew), got ((80.0, "),  # noqa: E501
    "six coefficients": ("[-0.1, 0.01]", "[0.1, 0, 0, 0, 0, 6]", "camera.dist: expected k1, k2, p1, p2, k3, and 0 for any further term, got [0.1, 0"),  # noqa: E501
    "ten thousand megapixels": ("[64, 48]", "[100000, 100000]", "camera.image_size: expected at most 400 megapixels, got 100000 x 100000"),  # noqa: E501
    "not TOML": ("[camera]", "[camera", "scene.toml: expected TOML, got Expected ']'"),
    "a number too long": ("[camera]", f"x = {'9' * 5000}\n[camera]", "scene.toml: expected TOML, got Exceeds the limit"),  # noqa: E501
}  # fmt: skip


def test_a_wrong_scene_is_named_by_file_and_field(tmp_path, subtests):
    for what, (old, new, message) in WRONG.items():
        with subtests.test(what):
            with pytest.raises(InputError) as caught:
                read_scene(write_scene(tmp_path, changed(old, new)))
            assert str(caught.value).startswith(str(tmp_path / "scene.toml: "))
            assert message in str(caught.value)
            assert len(str(caught.value)) < 400
            assert "\n" not in str(caught.value)


def test_opencvs_longer_lenses_are_read_where_their_further_terms_are_0(tmp_path):
    dist = [-0.1, 0.01, 0.001, 0.002, 0.003]
    for count in (5, 8, 12, 14):
        found = read_scene(write_scene(tmp_path, changed("[-0.1, 0.01]", str(dist + [0] * (count - 5)))))
        assert found.camera.dist == tuple(dist)


@pytest.mark.parametrize("digits", [3, 4, 6])
def test_a_rounded_rotation_is_refused_with_the_nearest_one_which_is_then_taken(tmp_path, digits):
    """As Blender prints it, with four decimals: a turn by 0.3 about x, then by 0.7 about z."""
    (c, s), (d, t) = ((np.cos(a), np.sin(a)) for a in (0.3, 0.7))
    true = np.array([[d, -t, 0], [c * t, c * d, -s], [s * t, s * d, c]])
    old = re.search(r"R_cam_board = (.*)", SCENE)[1]
    with pytest.raises(InputError, match="got one that is off by") as caught:
        read_scene(write_scene(tmp_path, changed(old, str(np.round(true, digits).tolist()))))
    nearest = str(caught.value).partition("The nearest is ")[2]
    found = read_scene(write_scene(tmp_path, changed(old, nearest))).camera
    np.testing.assert_allclose(found.R_cam_board, true, atol=1.5 * 10.0**-digits)
    assert "\n" not in str(caught.value)


def test_what_is_not_there_or_not_text_is_named(tmp_path):
    for path, message in (
        (tmp_path / "nowhere", "nowhere: expected a scene's folder, its scene.toml or its name, got no such scene"),
        (tmp_path, "expected a scene's folder, holding scene.toml or scene.xml, got none"),
        (tmp_path / "nowhere.toml", "nowhere.toml: expected a TOML file, got no such file"),
    ):
        with pytest.raises(InputError) as caught:
            read_scene(path)
        assert message in str(caught.value)
    (tmp_path / "latin.toml").write_bytes(b"x = '\xe9'")
    with pytest.raises(InputError, match=r"latin\.toml: expected UTF-8 text, got byte 0xe9 at 5"):
        read_toml(tmp_path / "latin.toml")
    with pytest.raises(InputError, match="expected a TOML file, got a folder"):
        read_toml(tmp_path)


def under_a_map(folder: Path, pixels: np.ndarray | None) -> Path:
    if pixels is not None:
        write_exr(folder / "x.exr", Image(pixels.astype(np.float32), samples=0))
    return write_scene(folder, re.sub(r"\nradiance = .*", '\nmap = "x.exr"', SCENE))


def test_a_map_is_read_and_part_of_the_scenes_hash(tmp_path):
    from raytwin.renderers.references import scene_hash

    pixels = np.zeros((4, 8, 3), np.float32)
    pixels[:, 4] = 0.5
    np.testing.assert_array_equal(read_scene(under_a_map(tmp_path, pixels)).environment.radiance, pixels)
    before = scene_hash(tmp_path)
    assert scene_hash(under_a_map(tmp_path, pixels + 1)) != before


def test_a_wrong_map_is_one_line(tmp_path):
    good = np.full((4, 8, 3), 10.0)
    for pixels, message in (
        (None, "expected an image file, got no such file"),
        (np.ones((4, 9, 3)), "twice as wide as high, of 4 to 4096 columns, got 9 x 4 pixels"),
        (np.ones((1, 2, 3)), "of 4 to 4096 columns, got 2 x 1 pixels"),
        (-good, "x.exr: expected radiance of 0 or more everywhere, got -10"),
        (good * np.nan, "x.exr: expected radiance of 0 or more everywhere, got NaN or infinity"),
    ):
        with pytest.raises(InputError, match=re.escape(message)):
            read_scene(under_a_map(tmp_path, pixels))


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=8,
)
FIELDS = st.sampled_from(["camera", "spheres", "planes", "sun", "sky", "tolerance", "x", "name", "photos"])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    field=FIELDS,
    inner=st.sampled_from(["", "center", "radius", "K", "R_cam_board", "half_u", "to_light", "dist"]),
    junk=JUNK,
)
def test_any_junk_in_a_scene_is_an_input_error_or_a_scene(tmp_path, field, inner, junk):
    data = tomllib.loads(SCENE)
    if inner:
        target = data.setdefault(field, {})
        (target[0] if isinstance(target, list) else target)[inner] = junk
    else:
        data[field] = junk
    try:
        text = tomli_w.dumps(data)
    except TypeError:  # None is not TOML
        return
    try:
        scene = read_scene(write_scene(tmp_path, text))
    except InputError:
        return
    assert all(s.radius > 0 for s in scene.spheres)


# ------------------------------------------------------------------------------------------------ cameras


def test_a_camera_survives_its_file_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(7)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    K = ((812.34567890123, 0.0, 1 / 3), (0.0, np.pi * 250, 240.1), (0.0, 0.0, 1.0))
    camera = Camera((640, 480), K, tuple(map(tuple, R.tolist())), tuple(rng.normal(size=3).tolist()), (-0.1, 1e-17))
    write_toml(tmp_path / "camera.toml", camera.to_dict(), "Found by hand.\nTwice.")
    assert read_camera(tmp_path / "camera.toml") == camera
    assert (tmp_path / "camera.toml").read_text().startswith("# Found by hand.\n# Twice.\n")


def test_a_wrong_camera_file_is_named_by_its_own_fields(tmp_path):
    camera = re.search(r"\[camera\]\n(.*?)\n\n", SCENE, re.S)[1]
    (tmp_path / "camera.toml").write_text(camera.replace("[[80.0", "[[-80.0"))
    with pytest.raises(InputError, match=r"camera\.toml: K: expected focal lengths > 0 px"):
        read_camera(tmp_path / "camera.toml")
    (tmp_path / "camera.toml").write_text(camera.replace("[64, 48]", "[64]"))
    with pytest.raises(InputError, match=r"camera\.toml: image_size: expected a list of length 2, got \[64\]"):
        read_camera(tmp_path / "camera.toml")


# ------------------------------------------------------------------------------------------------ writing


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_an_interrupted_write_keeps_the_old_file_and_leaves_nothing_else(tmp_path, stop):
    target = tmp_path / "result.json"
    target.write_text("old")

    def interrupted() -> None:
        with replacing(target) as temporary:
            temporary.write_text("half")
            raise stop

    seen = "expected a writable path, got No space" if isinstance(stop, OSError) else None
    with pytest.raises((KeyboardInterrupt, InputError), match=seen):
        interrupted()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("mode", [None, 0o600, 0o755])
def test_a_file_appears_whole_with_its_folder_and_the_users_permissions_or_those_it_had(tmp_path, mode):
    target = tmp_path / "new" / "folder" / "x.txt"
    if mode:
        write_text(target, "old")
        target.chmod(mode)
    mask = os.umask(0o027)
    try:
        write_text(target, "Ångström")
    finally:
        os.umask(mask)
    assert target.read_text(encoding="utf-8") == "Ångström"
    assert target.stat().st_mode & 0o777 == (mode or 0o640)
    assert list(target.parent.iterdir()) == [target]


def test_a_write_that_fails_keeps_the_old_file_and_names_the_place(tmp_path):
    for name, write in (
        ("a.png", lambda p: write_picture(p, np.zeros((4, 4, 7), np.uint8))),
        ("a.toml", lambda p: write_toml(p, {"x": None})),
        ("a.json", lambda p: write_json(p, {"x": object()})),
        ("a.exr", lambda p: write_exr(p, Image(np.zeros((4, 6, 3)), np.zeros((4, 5, 3))))),
    ):
        (tmp_path / name).write_text("old")
        with pytest.raises((TypeError, InputError)):
            write(tmp_path / name)
        assert (tmp_path / name).read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.exr", "a.json", "a.png", "a.toml"]
    for path in (tmp_path, tmp_path / "a.png" / "below"):
        with pytest.raises(InputError, match=re.escape(str(path))):
            write_text(path, "y")


def test_a_planted_link_is_replaced_and_what_it_leads_to_is_left_alone(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "real").chmod(0o600)
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "dangling").symlink_to("made by nobody")
    for name in ("link", "dangling"):
        write_text(tmp_path / name, "new")
        assert not (tmp_path / name).is_symlink()
        assert (tmp_path / name).read_text() == "new"
    assert (tmp_path / "real").read_text() == "old"
    assert not (tmp_path / "made by nobody").exists()


def test_standard_output_redirected_to_a_file_is_written_into(tmp_path):
    code = "from raytwin.safe_write import write_text; write_text('/dev/stdout', 'through')"
    with (tmp_path / "out").open("w") as out:
        subprocess.run([sys.executable, "-c", code], stdout=out, check=True)
    assert (tmp_path / "out").read_text() == "through"
    assert Path("/dev/stdout").is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are a POSIX thing")
def test_devices_and_pipes_are_refused_as_input_and_written_into_as_output(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero")):
        for read in (read_image, read_photo, read_exr, read_toml, photo_size):
            with pytest.raises(InputError, match="got a device or a pipe"):
                read(path)
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    write_text(pipe, "through")
    reader.join(10)
    assert got == ["through"]
    assert pipe.is_fifo()


def test_json_holds_records_arrays_and_no_nan(tmp_path):
    value = {"a": np.array([[1.5, np.nan]]), "b": Sphere((0.0, 1.0, 2.0), 3.0), "c": np.float32(0.5), "d": Path("x/y")}
    write_json(tmp_path / "x.json", value | {"e": float("inf")})
    assert msgspec.json.decode((tmp_path / "x.json").read_bytes()) == {
        "a": [[1.5, None]],
        "b": {"center": [0.0, 1.0, 2.0], "radius": 3.0, "albedo": [0.8, 0.8, 0.8]},
        "c": 0.5,
        "d": "x/y",
        "e": None,
    }


# ------------------------------------------------------------------------------------------------ photos


def photo(rng: np.random.Generator, h: int = 40, w: int = 60) -> np.ndarray:
    return rng.integers(0, 256, (h, w, 3), dtype=np.uint8)


def test_photos_of_all_kinds_are_read_with_every_code_and_a_jpeg_nearly(tmp_path):
    pixels = photo(np.random.default_rng(1))
    write_picture(tmp_path / "a.png", pixels)
    for name, options in (("a.TIFF", {}), ("a.bmp", {}), ("a.tif", {}), ("a.webp", {"lossless": True})):
        Pillow.fromarray(pixels).save(tmp_path / name, **options)
    for path in list_photos(tmp_path):
        np.testing.assert_array_equal(read_photo(path), pixels)
    smooth = np.broadcast_to(np.linspace(20, 230, 60).astype(np.uint8)[None, :, None], (40, 60, 3))
    write_picture(tmp_path / "a.JPG", smooth, quality=98)
    assert np.abs(read_photo(tmp_path / "a.JPG").astype(int) - smooth).max() <= 3
    write_picture(tmp_path / "grey.png", pixels[..., 0])
    np.testing.assert_array_equal(read_photo(tmp_path / "grey.png"), np.repeat(pixels[..., :1], 3, axis=-1))
    (tmp_path / "notes.txt").touch()
    names = ["a.JPG", "a.TIFF", "a.bmp", "a.png", "a.tif", "a.webp", "grey.png"]
    assert [p.name for p in list_photos(tmp_path)] == names
    with pytest.raises(InputError, match=r"expected a name that ends in \.png, \.jpg or \.jpeg, got \.tiff"):
        write_picture(tmp_path / "a.tiff", pixels)


def test_a_photo_read_as_grey_is_the_luma_of_its_colours(tmp_path):
    y, x = np.mgrid[0:40, 0:60]
    pixels = np.stack([4 * x, 6 * y, 255 - 2 * x - 2 * y], axis=-1).astype(np.uint8)
    for name in ("a.png", "a.jpg"):
        write_picture(tmp_path / name, pixels, quality=95)
        grey = read_grey(tmp_path / name)
        assert grey.dtype == np.uint8
        assert np.abs(grey - read_photo(tmp_path / name) @ np.array([0.299, 0.587, 0.114])).max() <= 2


def test_a_photo_of_more_than_8_bits_or_from_a_phone_is_refused_by_name(tmp_path):
    for values in (np.ones((4, 4), np.float32), np.full((4, 4), 4000, np.uint16)):
        Pillow.fromarray(values).save(tmp_path / "a.tif")
        for read in (read_grey, read_photo):
            with pytest.raises(InputError, match=r"a\.tif: expected a photo of 8 bits per channel, got more: save it"):
                read(tmp_path / "a.tif")
    (tmp_path / "b.HEIC").write_bytes(b"heic")
    with pytest.raises(InputError, match=r"b\.HEIC: expected a photo .*, got HEIC: save it as JPEG or PNG"):
        photo_size(tmp_path / "b.HEIC")
    kept, wrong = readable_photos(list_photos(tmp_path))
    assert ([p.name for p in kept], [p.name for p in wrong]) == (["a.tif"], ["b.HEIC"])


def test_an_exif_orientation_is_not_applied(tmp_path):
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:20, :30] = 255
    exif = Pillow.Exif()
    exif[0x0112] = 6
    Pillow.fromarray(pixels).save(tmp_path / "turned.jpg", exif=exif, quality=95)
    found = read_photo(tmp_path / "turned.jpg")
    assert found.shape == (40, 60, 3)
    assert (found[5, 5, 0] > 250, found[35, 55, 0] < 5) == (True, True)
    assert photo_size(tmp_path / "turned.jpg") == (60, 40)


def test_a_wrong_photo_is_named(tmp_path):
    whole = io.BytesIO()
    Pillow.fromarray(photo(np.random.default_rng(2), 200, 300)).save(whole, "JPEG")
    gif = io.BytesIO()
    Pillow.new("P", (8, 8)).save(gif, "GIF")
    kind = "expected a photo (JPEG, PNG, WebP, TIFF or BMP), got"
    wrong = {
        "truncated.jpg": (whole.getvalue()[: len(whole.getvalue()) // 2], f"{kind} a damaged one"),
        "text.png": (b"not a picture", f"{kind} a file of another kind, or a damaged header"),
        "empty.jpg": (b"", "got a file of another kind"),
        "moving.jpg": (gif.getvalue(), "got a file of another kind"),
        "bomb.png": (hostile.png(60_000, 60_000, bytes(64)), "expected a photo of a size that a camera makes"),
        "short.png": (hostile.png(600, 600, bytes(64)), f"{kind} a damaged one"),
    }
    for name, (data, message) in wrong.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError) as caught:
            read_photo(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert message in str(caught.value), name
    for path, message in ((tmp_path / "none.jpg", "got no such file"), (tmp_path, "got a folder")):
        with pytest.raises(InputError, match=message):
            photo_size(path)


# ------------------------------------------------------------------------------------------------ EXR


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), h=st.integers(1, 9), w=st.integers(1, 9), has_variance=st.booleans(), has_surface=st.booleans())
def test_an_image_survives_an_exr_to_the_last_bit(tmp_path, data, h, w, has_variance, has_surface):
    def layer(*shape):
        return data.draw(arrays(np.float32, shape, elements=st.floats(width=32, allow_nan=True, allow_infinity=True)))

    ids = data.draw(arrays(np.int32, (h, w), elements=st.integers(-1, 2**31 - 2)))
    surface = Surface(ids, layer(h, w), layer(h, w, 3)) if has_surface else None
    batches = data.draw(st.none() | st.integers(2, 64))
    image = Image(
        layer(h, w, 3), layer(h, w, 3) if has_variance else None, data.draw(st.integers(1, 10**9)), surface, batches
    )
    write_exr(tmp_path / "x.exr", image, {"seed": "7", "samples": "wrong", "batches": "wrong"})
    found, header = read_exr(tmp_path / "x.exr")
    assert (found.samples, found.batches, header["seed"]) == (image.samples, image.batches, "7")
    assert same_bits(found.mean, image.mean)
    assert found.variance is image.variance is None or same_bits(found.variance, image.variance)
    assert (found.surface is None) == (surface is None)
    for name in ("ids", "depth", "normal") if surface else ():
        assert same_bits(getattr(found.surface, name), getattr(surface, name)), name


def test_a_wrong_exr_is_named(tmp_path):
    grey, window = np.zeros((4, 4), np.float32), (np.zeros(2, np.int32), np.array([5, 3], np.int32))

    def made(channels, name, **more):
        return OpenEXR.Part({"type": OpenEXR.scanlineimage, **more}, channels, name)

    def colours(width, name):
        return made({"RGB": np.zeros((4, width, 3), np.float32)}, name, displayWindow=window)

    for parts, message in (
        ([made({"Z": grey}, "x")], "expected channels R, G, B (or Y), got Z"),
        ([made({"Y": grey}, "x", **{"raytwin/samples": "many"})], "expected an EXR file, got a damaged one"),
        ([colours(6, "mean"), colours(5, "variance")], "expected parts of one size, got 6 x 4, 5 x 4"),
    ):
        with OpenEXR.File(parts) as file:
            file.write(str(tmp_path / "x.exr"))
        with pytest.raises(InputError, match=re.escape(f"x.exr: {message}")):
            read_exr(tmp_path / "x.exr")
    rng = np.random.default_rng(6)
    write_exr(tmp_path / "x.exr", Image(*rng.random((2, 20, 30, 3), np.float32)))
    data = (tmp_path / "x.exr").read_bytes()
    for share in (0, 0.1, 0.9, 0.9999):  # at the end only the variance is lost
        (tmp_path / "x.exr").write_bytes(data[: int(share * len(data))])
        with pytest.raises(InputError, match="got a damaged one"):
            read_exr(tmp_path / "x.exr")


# ------------------------------------------------------------------------------------------------ many objects


def test_four_times_the_spheres_take_four_times_the_calls_to_read(tmp_path):
    counts = []
    for count in (100, 400):
        ball = "[[spheres]]\ncenter = [0.0, 0.0, 0.05]\nradius = 0.05\nname = 'ball {0}'\n"
        write_scene(tmp_path, SCENE + "".join(ball.format(i) for i in range(count)))
        read_scene(tmp_path)  # what is done once is done
        counts.append(calls(lambda: read_scene(tmp_path).names))
    assert 3 < counts[1] / counts[0] < 4.1
