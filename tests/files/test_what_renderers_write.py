"""Variances, samples, moments and colour spaces as renderers leave them in EXRs; PNGs; rounding."""

import io

import numpy as np
import OpenEXR
import pytest

from raytwin import files
from raytwin.errors import InputError

PIXELS = np.random.default_rng(1).random((6, 8, 3)).astype(np.float32)


def write(path, channels, **attributes):
    layers = {k: np.ascontiguousarray(v, np.float32) for k, v in channels.items()}
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **attributes}, layers) as file:
        file.write(str(path))
    return path


def named(prefix, kind, pixels):
    return {f"{prefix}{c}": pixels[..., i] for i, c in enumerate(kind)}


@pytest.mark.parametrize(
    ("attributes", "samples"),
    [
        ({}, 0),
        ({"samplesPerPixel": 64}, 64),
        ({"cycles.View Layer.samples": "128"}, 128),
        ({"raytwin/samples": "16"}, 16),
    ],
)
def test_samples_are_those_that_the_renderer_tells(tmp_path, attributes, samples):
    assert files.read_image(write(tmp_path / "x.exr", named("", "RGB", PIXELS), **attributes)).samples == samples


def test_a_layer_called_variance_is_the_variance(tmp_path):
    path = write(tmp_path / "x.exr", named("", "RGB", PIXELS) | named("variance.", "RGB", PIXELS / 100))
    image = files.read_image(path)
    np.testing.assert_array_equal(image.mean, PIXELS)
    np.testing.assert_allclose(image.variance, PIXELS / 100, rtol=1e-6)


def test_second_moments_give_the_variance_of_a_sample(tmp_path):
    first, second = named("path.", "RGB", PIXELS), named("m2_path.", "RGB", np.square(PIXELS) + 0.25)
    path = write(tmp_path / "x.exr", named("", "RGB", PIXELS) | first | second)
    np.testing.assert_allclose(files.read_moments(path), 0.25, rtol=1e-5)
    assert files.read_moments(write(tmp_path / "y.exr", named("", "RGB", PIXELS) | first)) is None
    files.write_picture(tmp_path / "z.png", files.to_bytes(PIXELS))
    assert files.read_moments(tmp_path / "z.png") is None


def test_moments_in_xyz_are_exact_where_a_pixels_samples_have_one_colour(tmp_path):
    """x = colour * y: the variance of each channel is its colour's square times y's."""
    to_xyz = np.linalg.inv([[3.2404542, -1.5371385, -0.4985314], [-0.969266, 1.8760108, 0.041556],
                            [0.0556434, -0.2040259, 1.0572252]])  # fmt: skip
    y = np.random.default_rng(2).exponential(size=(500, 6, 8, 1))
    xyz = (PIXELS * y) @ to_xyz.T
    moments = named("p.", "XYZ", xyz.mean(axis=0)) | named("m2_p.", "XYZ", np.square(xyz).mean(axis=0))
    found = files.read_moments(write(tmp_path / "x.exr", named("", "RGB", PIXELS) | moments))
    np.testing.assert_allclose(found, np.square(PIXELS) * y.var(axis=0), rtol=1e-3)


def test_xyz_is_converted_and_white_is_white(tmp_path):
    white = np.broadcast_to([0.95047, 1.0, 1.08883], (4, 4, 3))
    np.testing.assert_allclose(
        files.read_image(write(tmp_path / "x.exr", named("", "XYZ", white))).mean, 1.0, atol=1e-4
    )


def test_luminance_and_chroma_are_refused(tmp_path):
    path = write(tmp_path / "x.exr", {"Y": PIXELS[..., 0], "RY": PIXELS[..., 1], "BY": PIXELS[..., 2]})
    with pytest.raises(InputError, match="luminance and chroma"):
        files.read_image(path)


def test_rounding_is_half_a_step_at_every_value(tmp_path):
    from PIL import Image as Pillow

    ramp = np.linspace(0, 1, 5000 * 3).reshape(50, 100, 3).astype(np.float32)
    codes = files.to_bytes(ramp)
    data = io.BytesIO()
    Pillow.fromarray(codes).save(data, "PNG")
    (tmp_path / "x.png").write_bytes(data.getvalue())
    mean = files.read_image(tmp_path / "x.png").mean
    found = files.rounding_of(tmp_path / "x.png", mean)
    share = np.abs(ramp - mean) / found.half
    assert found.clipped
    assert 0.99 < share.max() <= 1
    assert share[codes.max(axis=-1) < 30].max() > 0.8  # in the dark too
    half = files.half_floats(ramp).half
    error = np.abs(ramp - ramp.astype(np.float16))
    assert (error <= half).all()
    assert (error / half).max() > 0.9
