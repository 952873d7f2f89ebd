"""Images of other programs: every kind read beside OpenImageIO or a file written by hand; what is refused; rounding."""

import itertools
import struct

import cv2
import hostile
import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from PIL import Image as Pillow

from raytwin.errors import InputError
from raytwin.images import limits
from raytwin.images.image_formats import read_image
from raytwin.images.photo_files import to_bytes
from raytwin.images.stored_precision import half_floats, rounding_of


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


@pytest.mark.parametrize("name", sorted(n for n in hostile.sound_files() if not n.startswith(("layers", "parts"))))
def test_openimageio_reads_the_same_pixels_from_a_file_of_any_name(tmp_path, sound, name):
    """It turns a PFM upside down, and takes a JPEG that ends early for a whole one."""
    path = tmp_path / name
    path.write_bytes(sound[name])
    (tmp_path / "x.dat").write_bytes(sound[name])
    ours, opened = read_image(tmp_path / "x.dat").mean, oiio.ImageInput.open(str(path))
    theirs = opened.read_image(oiio.FLOAT)[..., :3]
    opened.close()
    if path.suffix == ".pfm":
        theirs = theirs[::-1]
    elif path.suffix != ".exr":
        theirs = np.where(theirs <= 0.04045, theirs / 12.92, ((theirs + 0.055) / 1.055) ** 2.4)
    assert (ours.dtype, ours.shape) == (np.float32, (21, 33, 3))
    assert np.abs(ours - theirs).max() <= (0 if path.suffix in (".exr", ".pfm") else 1e-6)


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


def test_what_is_no_image_is_named(tmp_path, sound):
    gray = sound["big_endian_grey.pfm"]
    wrong = {
        b"": "expected an image: EXR, PFM, PNG, JPEG, PPM, TIFF, BMP or WebP, got a file of another kind",
        gray[:-1]: "expected 2772 bytes of pixels for 33 x 21, got 2771",
        gray + b"0": "expected 2772 bytes of pixels for 33 x 21, got 2773",
        gray.replace(b"\n1.0", b"\n2.5"): "expected a PFM of scale 1 or -1, which tells the byte order, got 2.5",
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


def test_radiance_hdr_and_pictures_of_more_than_8_bits_are_refused_with_the_command_that_converts_them(tmp_path, a):
    cv2.imwrite(str(tmp_path / "x.hdr"), a)
    with pytest.raises(InputError, match=r"expected an EXR, got a Radiance HDR \(convert it: oiiotool a.hdr -o a.exr"):
        read_image(tmp_path / "x.hdr")
    for i, head in enumerate(
        (b"P6\n2 1\n65535\n", b"P6\n2 1\n300\n", b"P5\n2 1\n65535\n", b"P3\n2 1\n1023\n1 2 3 4 5 6 ")
    ):
        (tmp_path / f"{i}.ppm").write_bytes(head + bytes(12))
    for kind, channels in itertools.product(("png", "tif"), (1, 3, 4)):
        cv2.imwrite(str(tmp_path / f"{channels}.{kind}"), np.full((9, 11, channels), 256, np.uint16))
    for path in sorted(tmp_path.glob("[0-9].*")):
        with pytest.raises(
            InputError, match=rf"expected a [A-Z]+ of 8 bits per channel, got more .*oiiotool a{path.suffix}"
        ):
            read_image(path)


def test_samples_are_those_that_the_renderer_tells(tmp_path, a):
    for attributes, samples in (
        ({}, 0),
        ({"samplesPerPixel": 64}, 64),
        ({"samplesPerPixel": "many"}, 0),
        ({"raytwin/samples": "16"}, 16),
    ):
        write_exr(tmp_path / "x.exr", named("", a), **attributes)
        assert read_image(tmp_path / "x.exr").samples == samples


def test_a_layer_called_variance_is_the_variance(tmp_path, a):
    write_exr(tmp_path / "x.exr", named("", a) | named("variance.", a / 100))
    image = read_image(tmp_path / "x.exr")
    np.testing.assert_array_equal(image.mean, a)
    np.testing.assert_allclose(image.variance, a / 100, rtol=1e-6)


def test_xyz_and_luminance_and_chroma_are_refused(tmp_path, a):
    for kind, channels in (("XYZ", "X, Y, Z"), (("Y", "RY", "BY"), "BY, RY, Y")):
        write_exr(tmp_path / "x.exr", named("", a, kind))
        with pytest.raises(InputError, match=f"expected channels R, G, B, got {channels}"):
            read_image(tmp_path / "x.exr")


def test_rounding_is_half_a_step_at_every_value(tmp_path):
    ramp = np.linspace(0, 1, 5000 * 3).reshape(50, 100, 3).astype(np.float32)
    codes = to_bytes(ramp)
    Pillow.fromarray(codes).save(tmp_path / "x.png")
    image = read_image(tmp_path / "x.png")
    found = rounding_of(image)
    share = np.abs(ramp - image.mean) / found.half
    assert found.clipped
    assert 0.99 < share.max() <= 1
    assert share[codes.max(axis=-1) < 30].max() > 0.8  # in the dark too
    half = half_floats(ramp).half
    error = np.abs(ramp - ramp.astype(np.float16))
    assert (error <= half).all()
    assert (error / half).max() > 0.9
