"""Pages of noisy images, whose single errors mean little."""

from dataclasses import replace

import numpy as np
import pytest
from test_html import assert_true_digits

from raytwin.compare import Report, compare
from raytwin.images.image import Image
from raytwin.show.compare_page import write_report
from raytwin.show.view import PairView, view_of

RNG = np.random.default_rng(3)


@pytest.mark.nightly
def test_noise_is_shown_in_sigmas_and_as_means_where_not_every_pixel_fits(make_result, tmp_path, browse, monkeypatch):
    from raytwin.images import packing
    from raytwin.images.packing import binned

    monkeypatch.setattr(
        "raytwin.show.compare_page.viewer.pack", lambda *a, **k: packing.pack(*a, **k, most_pixels=5000)
    )
    result = make_result()
    variance = np.full_like(result.twin.mean, 1e-4)
    mean = (result.twin.mean + 0.01 * RNG.normal(size=variance.shape)).astype(np.float32)
    mean[40:48, 60:68] += 0.03
    test, reference = Image(mean, variance, 64), Image(result.twin.mean, 0 * variance, 1 << 20)
    pair = replace(result, test=test, reference=reference, report=Report("s", "", compare(test, reference)))
    shown = PairView(pair, "s", view_of(result).names, result.tolerance)
    write_report(shown, tmp_path / "page.html")
    script = """
      viewer.keep(62, 44);
      for (const row of ["test", "error", "further"]) result[row] = texts(row);
      result.said = status();
      result.map = [viewer.state.map, viewer.panes.get("map").head.textContent];
      // zoomed out to blocks of 4 x 4 kept means: the wrong corner, which is 2 x 2 of them, stands out
      const z = viewer.reduced(2), at = 11 * 40 + 15;
      result.z = [z[at], Math.sqrt(z.reduce((sum, x) => sum + x * x, 0) / z.length)];"""
    read, console = browse(tmp_path / "page.html", "", script)
    assert console == []
    assert read["said"] == "means of 2 × 2 pixels"
    assert read["map"] == ["sigmas", "Difference in σ"]
    a, b = binned(test, 2), binned(reference, 2)
    error, sigma = (a.mean - b.mean)[22, 31], np.sqrt(a.variance)[22, 31]
    for text, value in zip(read["test"][:3], a.mean[22, 31], strict=True):
        assert_true_digits(text, float(value))
    for row, values in (("error", error), ("further", error / sigma)):
        for text, value in zip(read[row][:3], values, strict=True):
            assert_true_digits(text.lstrip("+"), float(value))
    z = (mean - result.twin.mean)[44:48, 60:64].mean(axis=(0, 1)) / (0.01 / 4)
    assert read["z"][0] == pytest.approx(z[np.abs(z).argmax()], rel=0.05)
    assert read["z"][1] < 3
