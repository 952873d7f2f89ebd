"""Variances, samples and colour spaces as renderers leave them in EXRs; rounding."""

import numpy as np
import OpenEXR
import pytest
from PIL import Image as Pillow

from raytwin.errors import InputError
from raytwin.images.image_formats import read_image
from raytwin.images.photo_files import to_bytes
from raytwin.images.stored_precision import half_floats, rounding_of

PIXELS = np.random.default_rng(1).random((6, 8, 3)).astype(np.float32)


def write(path, channels, **attributes):
    layers = {k: np.ascontiguousarray(v, np.float32) for k, v in channels.items()}
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **attributes}, layers) as file:
        file.write(str(path))
    return path


def named(prefix, kind, pixels):
    return {f"{prefix}{c}": pixels[..., i] for i, c in enumerate(kind)}


def test_samples_are_those_that_the_renderer_tells(tmp_path):
    for attributes, samples in (
        ({}, 0),
        ({"samplesPerPixel": 64}, 64),
        ({"samplesPerPixel": "many"}, 0),
        ({"raytwin/samples": "16"}, 16),
    ):
        assert read_image(write(tmp_path / "x.exr", named("", "RGB", PIXELS), **attributes)).samples == samples


def test_a_layer_called_variance_is_the_variance(tmp_path):
    image = read_image(write(tmp_path / "x.exr", named("", "RGB", PIXELS) | named("variance.", "RGB", PIXELS / 100)))
    np.testing.assert_array_equal(image.mean, PIXELS)
    np.testing.assert_allclose(image.variance, PIXELS / 100, rtol=1e-6)


def test_xyz_and_luminance_and_chroma_are_refused(tmp_path):
    with pytest.raises(InputError, match="expected channels R, G, B, got CIE X, Y, Z"):
        read_image(write(tmp_path / "x.exr", named("", "XYZ", PIXELS)))
    with pytest.raises(InputError, match="luminance and chroma"):
        read_image(write(tmp_path / "x.exr", named("", ("Y", "RY", "BY"), PIXELS)))


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
