"""The pictures of the report: exposure, the signed error's colours, silhouettes, and which pixels are pointed at."""

import base64
import io

import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin.image import Image, Surface
from raytwin.report import data_urls


def grey(values) -> Image:
    return Image(np.repeat(np.asarray(values, np.float32)[..., None], 3, axis=-1))


def surface(ids) -> Surface:
    ids = np.asarray(ids, np.int32)
    return Surface(ids, np.zeros(ids.shape, np.float32), np.zeros((*ids.shape, 3), np.float32))


def loaded(url: str) -> Pillow.Image:
    return Pillow.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))


def test_the_exposure_maps_the_995_permille_quantile_to_white():
    ramp = grey(np.linspace(0, 8, 1000).reshape(10, 100))
    assert 1 / data_urls.exposure(ramp) == pytest.approx(0.995 * 8, rel=1e-3)


def test_a_black_or_invalid_image_is_shown_as_it_is():
    assert data_urls.exposure(grey(np.zeros((3, 3)))) == 1
    assert data_urls.exposure(grey(np.full((3, 3), np.nan))) == 1


def test_the_error_scale_reaches_from_below_the_tolerance_to_the_worst_error():
    error = np.array([[0, 3e-4, -2e-6]], np.float32)
    scale = data_urls.choose_scale(grey(error), grey(0 * error), error, 1e-5)
    assert scale.low == pytest.approx(1e-7)
    assert scale.high == pytest.approx(1e-3)
    np.testing.assert_allclose(scale.position(np.float32([1e-3, -1e-3, 1e-5, -1e-5])), [1, -1, 0.5, -0.5], atol=1e-6)
    assert scale.position(np.float32(9e-8)) == 0


def test_noise_gets_equal_steps():
    noise = Image(np.zeros((2, 2, 3), np.float32), np.ones((2, 2, 3), np.float32))
    error = np.full((2, 2), 0.03, np.float32)
    scale = data_urls.choose_scale(noise, grey(-error), error, 1e-5)
    assert not scale.logarithmic
    assert scale.position(np.float32(scale.high / 4)) == pytest.approx(0.25)


def test_error_indices_are_symmetric_and_mark_what_is_missing():
    scale = data_urls.Scale(1e-6, 1e-2, True)
    indices = data_urls.error_indices(np.array([[1, -1, 0, np.nan, 1e-5, -1e-5]], np.float32), scale)
    assert indices.tolist() == [[254, 0, 127, 255, 159, 95]]


def test_the_palette_is_blue_then_white_then_red():
    colours = data_urls.palette().astype(int)
    assert colours[0, 2] > colours[0, 0]
    assert colours[127].tolist() == [255, 255, 255]
    assert colours[254, 0] > colours[254, 2]
    assert colours.shape == (256, 3)


def test_mismatches_are_listed_from_the_top():
    test, twin = surface([[-1, 0, -1, 1, 2]]), surface([[-1, -1, 0, 2, 2]])
    assert data_urls.mismatches(test, twin) == [(1, 0), (2, 0), (3, 0)]


def test_what_changed_is_found_on_the_jpegs_grid():
    before = np.zeros((50, 70, 3), np.uint8)
    after = before.copy()
    assert data_urls.changed(before, after) == (0, 0, 16, 16)
    after[20, 35] = after[33, 69] = 1
    assert data_urls.changed(before, after) == (32, 16, 38, 32)


def test_worst_pixels_come_worst_first_and_one_from_a_tile():
    error = np.zeros((70, 100), np.float32)
    error[5, 6], error[5, 7], error[40, 90], error[69, 0] = -3, 2.9, 1, np.nan
    assert data_urls.worst_pixels(error, 10) == [(0, 69), (6, 5), (90, 40)]
    assert data_urls.worst_pixels(error, 1) == [(0, 69)]


def test_equal_images_have_no_worst_pixel():
    assert data_urls.worst_pixels(np.zeros((70, 100), np.float32), 10) == []


def test_a_png_keeps_every_byte_and_a_noisy_picture_becomes_a_jpeg():
    rng = np.random.default_rng(0)
    smooth = np.broadcast_to(np.arange(200, dtype=np.uint8)[None, :, None], (150, 200, 3))
    url, lossless = data_urls.picture_url(smooth)
    assert lossless
    np.testing.assert_array_equal(np.asarray(loaded(url)), smooth)
    noisy = rng.integers(0, 256, (600, 800, 3), np.uint8)
    url, lossless = data_urls.picture_url(noisy)
    assert not lossless
    assert loaded(url).size == (800, 600)


def test_indices_become_the_palette_s_colours():
    indices = np.arange(256, dtype=np.uint8).reshape(16, 16)
    picture = loaded(data_urls.png_url(indices, data_urls.palette()))
    np.testing.assert_array_equal(np.asarray(picture.convert("RGB")), data_urls.palette()[indices])


def test_of_each_block_the_error_farthest_from_zero_is_kept():
    error = np.zeros((7, 9), np.float32)
    error[1, 1], error[2, 0], error[4, 5], error[6, 8] = 2, -3, -1, 9  # the last is in no whole block
    assert data_urls.worst_of_blocks(error, 3).tolist() == [[-3, 0, 0], [0, -1, 0]]
    error[0, 8] = np.nan
    assert np.isnan(data_urls.worst_of_blocks(error, 3)[0, 2])
