"""Where a finding is."""

import numpy as np

from raytwin.compare import compare
from raytwin.compare.finding import Finding, Place
from raytwin.images.image import Image
from raytwin.show.locations import linked


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
