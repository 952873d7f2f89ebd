"""Augmented photos beside true ones; and noise: pages whose single errors mean little."""

from dataclasses import replace

import numpy as np
import pytest
from test_html import assert_true_digits

from raytwin import files
from raytwin.compare import Report, compare
from raytwin.image import Image
from raytwin.report.compare_page import write_report
from raytwin.report.regression_page import Against
from raytwin.report.view import PairView, view_of

RNG = np.random.default_rng(3)


def test_each_photo_has_a_page_that_shows_its_errors_and_all_share_one_script(tmp_path, browse):
    truth = RNG.integers(0, 256, (30, 40, 3), np.uint8)
    drawn = truth.copy()
    drawn[10:20, 5:9] //= 2
    pages = Against(tmp_path)
    numbers = {"mean": -0.01, "rms": 0.02, "p95": 0.03, "codes": 1.5}
    regions = [numbers | {"region": name, "share": share} for name, share in (("spheres", 0.5), ("shadows", 0.0))]
    pages.add({"photo": "b.png", "pose_rms_px": 0.1, "regions": regions}, drawn, truth)
    index = pages.finish()
    assert {p.name for p in tmp_path.iterdir()} == {"against.html", "against-viewer.js", "against-b.png.html"}
    text = index.read_text(encoding="utf-8")
    assert 'href="against-b.png.html"' in text
    assert "shadows" not in text  # there are none
    script = """
      viewer.keep(6, 12);
      result.read = ["test", "reference"].map((row) => texts(row));
      result.map = [viewer.panes.get("map").head.textContent, viewer.scale().log];
      result.tile = document.querySelector(".tiles dd").textContent;"""
    read, console = browse(tmp_path / "against-b.png.html", "", script)
    assert console == []
    for row, photo in zip(read["read"], (drawn, truth), strict=True):
        for shown, value in zip(row, files.from_bytes(photo)[12, 6], strict=True):
            assert float(shown) == pytest.approx(float(value), rel=0.02, abs=5e-5)
    assert read["map"] == ["Difference", False]
    assert read["tile"] == "0.0200 rms"


def test_noise_is_shown_in_sigmas_and_as_means_where_not_every_pixel_fits(make_result, tmp_path, browse, monkeypatch):
    from raytwin import viewer
    from raytwin.viewer.packing import binned

    monkeypatch.setattr(
        "raytwin.report.compare_page.viewer.pack", lambda *a, **k: viewer.packing.pack(*a, **k, most_pixels=5000)
    )
    result = make_result()
    variance = np.full_like(result.twin.mean, 1e-4)
    mean = (result.twin.mean + 0.01 * RNG.normal(size=variance.shape)).astype(np.float32)
    mean[40:48, 60:68] += 0.03
    test, reference = Image(mean, variance, 64), Image(result.twin.mean, 0 * variance, 1 << 20)
    pair = replace(result, test=test, reference=reference, report=Report("s", "", compare(test, reference)))
    shown = PairView(pair, "s", view_of(result).names, None)
    write_report(shown, tmp_path / "page.html")
    script = """
      viewer.keep(62, 44);
      for (const row of ["test", "error", "further"]) result[row] = texts(row);
      result.said = status();
      result.map = [viewer.state.map, viewer.panes.get("map").head.textContent];
      // zoomed out to blocks of 4 x 4 kept means: the wrong corner, which is 2 x 2 of them, stands out
      const z = viewer.reduced(2), at = 11 * 40 + 15;
      result.z = [z[at], Math.sqrt(z.reduce((sum, x) => sum + x * x, 0) / z.length)];
      // a live page: no planes, pixels are pushed, a picture of 8 bits between them
      const place = document.createElement("div");
      document.body.append(place);
      const panes = [{ key: "test", kind: "radiance", title: "Live", alt: "" }];
      const live = raytwin.mount(place, { width: 4, height: 3, names: { test: "live" }, panes });
      const colour = () => {
        live.drawn();
        const c = live.panes.get("test").canvas;
        return [...read(c, 0.28 * c.width | 0, 0.36 * c.height | 0, 1, 1)].slice(0, 3);
      };
      live.key(new KeyboardEvent("keydown", { key: "w" }));  // there is nothing to wipe to
      result.alone = [live.state.mode, ...[...place.querySelectorAll(".rt-bar button")].map((b) => b.textContent)];
      live.update("test", new Uint16Array(36).fill(0x3800));  // 0.5 as a half float
      live.inspect(2, 1); live.at = null;
      result.live = [[...place.querySelectorAll(".rt-test td")].map((cell) => cell.textContent), colour()];
      await live.ready;
      const red = new OffscreenCanvas(4, 3), g = red.getContext("2d");
      g.fillStyle = "#f00"; g.fillRect(0, 0, 4, 3);
      live.update("test", red); result.live.push(colour());
      live.update("test", new Float32Array(36).fill(1)); live.key(new KeyboardEvent("keydown", { key: "f" }));
      result.live.push(colour());"""
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
    assert read["alone"] == ["grid", "Live", "−", "+", "Whole", "Reset"]
    assert read["live"] == [["0.500", "0.500", "0.500"], [188] * 3, [255, 0, 0], [255] * 3]
