"""The pictures of the report: exposure, the signed error's colours, silhouettes, and the places that links lead to."""

import base64
import io

import numpy as np
import pytest
from PIL import Image as Pillow

from raytwin.compare import compare
from raytwin.compare.finding import Finding, Place
from raytwin.images.image import Image, Surface
from raytwin.show import data_urls
from raytwin.show.compare_page import linked


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
    for nothing in (0.0, np.nan):  # shown as it is
        assert data_urls.exposure(grey(np.full((3, 3), nothing))) == 1


def test_a_small_difference_is_pale_where_it_is_allowed_and_red_where_it_is_too_bright():
    reference = grey(np.full((60, 90), 0.5))
    for error, least_red in ((1e-6, 250), (0.1, 150)):
        test = grey(reference.mean[..., 0] + error)
        picture = data_urls.small_pictures(test, reference, 1e-5, 30)[2].astype(int)
        assert picture.shape == (20, 30, 3)
        assert (picture[..., 1] > 200).all() == (least_red == 250)
        assert (picture[..., 0] >= picture[..., 2]).all()


def test_mismatches_are_listed_from_the_top():
    test, twin = surface([[-1, 0, -1, 1, 2]]), surface([[-1, -1, 0, 2, 2]])
    assert data_urls.mismatches(test, twin) == [(1, 0), (2, 0), (3, 0)]


def test_worst_pixels_come_worst_first_and_one_from_a_tile():
    error = np.zeros((70, 100), np.float32)
    error[5, 6], error[5, 7], error[40, 90], error[69, 0] = -3, 2.9, 1, np.nan
    assert data_urls.worst_pixels(error, 10) == [(0, 69), (6, 5), (90, 40)]
    assert data_urls.worst_pixels(error, 1) == [(0, 69)]
    assert data_urls.worst_pixels(0 * error[:60], 10) == []  # equal images have none


def test_a_photo_of_many_pixels_is_made_smaller_and_says_so():
    pixels = np.zeros((3000, 4000, 3), np.uint8)
    url, note = data_urls.small_jpeg(pixels)
    assert loaded(url).size == (2000, 1500)
    assert "1/2" in note
    assert data_urls.small_jpeg(pixels[:320])[1] == "JPEG"


def test_every_place_that_a_comparison_names_is_found():
    """A wrong corner and a wrong pixel in noise: each reason's coordinates become a place that holds the fault."""
    rng = np.random.default_rng(1)
    variance = np.full((96, 128, 3), 1e-4, np.float32)
    reference = Image(np.full(variance.shape, 0.5, np.float32), 0 * variance, 1 << 20)
    mean = (0.5 + 0.01 * rng.normal(size=variance.shape)).astype(np.float32)
    mean[32:48, 64:80] += 0.02
    mean[5, 7] += 0.3
    made = compare(Image(mean, variance, 64), reference)
    found, places = linked(made.findings, mean.shape)
    assert tuple(text for text, _ in found) == made.reasons
    assert all(address for text, address in found if "(x=" in text or text.startswith("the whole image"))
    tile = next(p for p in places if p["width"] > 1)
    assert abs(tile["x"] + tile["width"] / 2 - 72) <= 8
    assert abs(tile["y"] + tile["height"] / 2 - 40) <= 8
    assert {"x": 7, "y": 5, "width": 1, "height": 1} in places
    middle = f"#pixel={tile['x'] + tile['width'] // 2},{tile['y'] + tile['height'] // 2},"
    assert any(address and address.startswith(middle) for _, address in found)


def test_a_place_outside_the_picture_is_no_link():
    told = Finding("value", "first", Place(9, 0)), Finding("note", "equal"), Finding("image", "2 % too dark")
    found, places = linked(told, (5, 9, 3))
    assert [address for _, address in found] == [None, None, "#whole"]
    assert places == []
