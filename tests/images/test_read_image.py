"""Images of other programs: every kind read beside OpenCV's reader or a file written by hand."""

import struct

import cv2
import hostile
import numpy as np
import OpenEXR
import pytest

from raytwin.errors import InputError
from raytwin.images import limits
from raytwin.images.image_formats import read_image
from raytwin.images.stored_precision import rounding_of


@pytest.fixture(scope="module")
def a() -> np.ndarray:
    return np.random.default_rng(3).random((21, 33, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def sound() -> dict[str, bytes]:
    return hostile.sound_files()


def write_exr(path, channels, **attributes):
    planes = {k: np.ascontiguousarray(v) for k, v in channels.items()}
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **attributes}, planes) as file:
        file.write(str(path))


def named(prefix, pixels, kind="RGB"):
    return {f"{prefix}{c}": pixels[..., i] for i, c in enumerate(kind)}


# ------------------------------------------------------------------------------------------ floating point


def test_a_pfms_scale_multiplies(tmp_path):
    (tmp_path / "x.pfm").write_bytes(b"Pf\n1 1\n-2.5\n" + struct.pack("<f", 3))
    assert read_image(tmp_path / "x.pfm").mean.ravel().tolist() == [7.5] * 3


# ------------------------------------------------------------------------------------------ EXR


def test_a_layer_is_chosen_by_name_and_alone_needs_none(tmp_path, a):
    path = tmp_path / "x.exr"
    layer = named("diffuse.", a)
    write_exr(path, named("", 2 * a) | layer | {"Z": a[..., 0]})
    np.testing.assert_array_equal(read_image(path).mean, 2 * a)
    np.testing.assert_array_equal(read_image(path, layer="diffuse").mean, a)
    for single in ("Z", "diffuse.R"):
        np.testing.assert_array_equal(read_image(path, layer=single).mean, np.repeat(a[..., :1], 3, -1))
    with pytest.raises(InputError, match="layer: expected one of diffuse, got specular"):
        read_image(path, layer="specular")
    write_exr(path, layer | {"Z": a[..., 0]})
    np.testing.assert_array_equal(read_image(path).mean, a)
    write_exr(path, layer | named("specular.", a))
    with pytest.raises(InputError, match="choose one of the layers diffuse, specular"):
        read_image(path)
    write_exr(path, layer | named("n.", a, "XYZ"))
    np.testing.assert_array_equal(read_image(path, layer="n").mean, a)


def test_blenders_combined_is_preferred_and_a_path_may_name_the_layer(tmp_path, a):
    path = tmp_path / "x.exr"
    planes = named("View.Combined.", a) | named("View.DiffDir.", 2 * a)
    write_exr(path, planes)
    np.testing.assert_array_equal(read_image(path).mean, a)
    np.testing.assert_array_equal(read_image(f"{path}:View.DiffDir").mean, 2 * a)
    with pytest.raises(InputError, match=r"x\.exr: layer: expected one of View[.]Combined, View[.]DiffDir, got Depth"):
        read_image(f"{path}:Depth")
    with pytest.raises(InputError, match="got no such file"):
        read_image(f"{path}.none:Depth")
    write_exr(path, planes | named("Other.Combined.", a))
    with pytest.raises(InputError, match=r"View\.DiffDir, as x[.]exr:Other[.]Combined"):
        read_image(path)
    write_exr(tmp_path / "x.exr:odd", named("", 3 * a))
    np.testing.assert_array_equal(read_image(tmp_path / "x.exr:odd").mean, 3 * a)


def test_a_part_is_chosen_by_name(tmp_path, a):
    path = tmp_path / "x.exr"
    planes = {"depth": {"Z": np.ascontiguousarray(a[..., 0])}, "beauty": {"RGB": a}, "direct": {"RGB": 2 * a}}
    planes["Z"] = planes["depth"]  # a part that is called as its channel
    planes["normal"] = {c: np.ascontiguousarray(a[..., i]) for i, c in enumerate("XYZ")}
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, channels, name) for name, channels in planes.items()]
    with OpenEXR.File(parts) as file:
        file.write(str(path))
    np.testing.assert_array_equal(read_image(path).mean, a)  # the first with colours
    np.testing.assert_array_equal(read_image(f"{path}:direct").mean, 2 * a)
    np.testing.assert_array_equal(read_image(path, layer="normal").mean, a)
    for name in ("depth", "Z"):
        np.testing.assert_array_equal(read_image(f"{path}:{name}").mean, np.repeat(a[..., :1], 3, -1))


def test_a_data_window_off_the_origin_gives_the_data(tmp_path, a):
    window = (np.array([-5, 7], np.int32), np.array([27, 27], np.int32))
    write_exr(tmp_path / "x.exr", named("", a), dataWindow=window)
    np.testing.assert_array_equal(read_image(tmp_path / "x.exr").mean, a)


# ------------------------------------------------------------------------------------------ what is refused


def test_the_kind_is_told_by_the_content_and_not_by_the_name(tmp_path, sound):
    for name, data in sound.items():
        (tmp_path / "x.dat").write_bytes(data)
        assert read_image(tmp_path / "x.dat").shape == (21, 33, 3), name


def test_what_is_no_image_is_named(tmp_path, sound):
    gray = sound["big_endian_grey.pfm"]
    wrong = {
        b"": "expected an image: EXR, PFM, PNG, JPEG, PPM, TIFF, BMP or WebP, got a file of another kind",
        gray[:-1]: "expected 2772 bytes of pixels for 33 x 21, got 2771",
        gray + b"0": "expected 2772 bytes of pixels for 33 x 21, got 2773",
        gray.replace(b"\n1.0", b"\n0.0"): "expected a PFM's scale other than 0",
        sound["lines_ZIP.exr"][:-1]: "got a damaged one (without its part x)",
    }
    for data, message in wrong.items():
        (tmp_path / "x").write_bytes(data)
        with pytest.raises(InputError) as caught:
            read_image(tmp_path / "x")
        assert message in str(caught.value)
    with pytest.raises(InputError, match="got no such file"):
        read_image(tmp_path / "none")
    with pytest.raises(InputError, match="got a folder"):
        read_image(tmp_path)
    (tmp_path / "x").write_bytes(gray)
    with pytest.raises(InputError, match="expected an EXR, which has layers, got PFM"):
        read_image(tmp_path / "x", layer="diffuse")


def test_a_size_over_the_limit_is_refused(tmp_path, monkeypatch, sound):
    monkeypatch.setattr(limits, "MAX_PIXELS", 600)
    for name in ("parts.exr", "colour.pfm", "rgb.png", "base.jpg", "text.ppm"):
        (tmp_path / name).write_bytes(sound[name])
        with pytest.raises(InputError, match="megapixels, got 33 x 21"):
            read_image(tmp_path / name)


def test_subsampled_and_deep_exrs_are_refused_in_words(tmp_path):
    even = {c: np.ones((20, 32), np.float16) for c in "RGB"}
    with OpenEXR.File({"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}, even) as file:
        file.write(str(tmp_path / "x.exr"))
    data = bytearray((tmp_path / "x.exr").read_bytes())
    at = data.find(b"channels\0chlist\0") + 20 + 2 + 8
    data[at : at + 8] = struct.pack("<2i", 2, 2)
    (tmp_path / "x.exr").write_bytes(data)
    with pytest.raises(InputError, match="expected channels with a value for every pixel, got B with fewer"):
        read_image(tmp_path / "x.exr")
    deep = np.empty((4, 5), object)
    for at in np.ndindex(deep.shape):
        deep[at] = np.ones(2, np.float32)
    with OpenEXR.File({"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}, {"Z": deep}) as file:
        file.write(str(tmp_path / "x.exr"))
    with pytest.raises(InputError, match="deep pixels, which have no single value"):
        read_image(tmp_path / "x.exr")


def test_a_picture_of_8_bits_is_held_to_its_codes_and_a_float_image_is_not(tmp_path, sound):
    for name in ("rgb.png", "rgb.ppm", "base.jpg", "colour.pfm", "lines_ZIP.exr"):
        (tmp_path / name).write_bytes(sound[name])
        assert rounding_of(read_image(tmp_path / name)).clipped == (not name.endswith(("pfm", "exr")))


def test_a_ppm_of_more_than_8_bits_is_refused(tmp_path):
    for head in (b"P6\n2 1\n65535\n", b"P6\n2 1\n300\n", b"P5\n2 1\n65535\n", b"P3\n2 1\n1023\n1 2 3 4 5 6 "):
        (tmp_path / "x.ppm").write_bytes(head + bytes(12))
        with pytest.raises(InputError, match=r"expected a PPM of 8 bits per channel, got more .*oiiotool a.ppm"):
            read_image(tmp_path / "x.ppm")


def test_radiance_hdr_and_pictures_of_16_bits_are_refused_with_the_command_that_converts_them(tmp_path, a):
    cv2.imwrite(str(tmp_path / "x.hdr"), a)
    with pytest.raises(InputError, match=r"expected an EXR, got a Radiance HDR \(convert it: oiiotool a.hdr -o a.exr"):
        read_image(tmp_path / "x.hdr")
    for channels in (1, 3, 4):
        for kind, name in (("png", "PNG"), ("tif", "TIFF")):
            cv2.imwrite(str(tmp_path / f"x.{kind}"), np.full((9, 11, channels), 256, np.uint16))
            expected = rf"expected a {name} of 8 bits per channel, got more .*oiiotool a.{kind}"
            with pytest.raises(InputError, match=expected):
                read_image(tmp_path / f"x.{kind}")
