"""The page itself: complete, offline, right with photos and without, and alive in a browser."""

import json
import re
from dataclasses import replace
from functools import partial
from html import unescape

import numpy as np
import pytest
from browser import opened

from raytwin.images import packing
from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.show.compare_page import write_report
from raytwin.show.data_urls import exposed, exposure
from raytwin.show.live.progressive import to_screen
from raytwin.show.live.view_state import Look
from raytwin.show.view import view_of
from raytwin.study.diff_files import compare as diff


@pytest.fixture(scope="module")
def plain(make_result, tmp_path_factory):
    """(result, page) of a scene without photos."""
    result = make_result()
    page = tmp_path_factory.mktemp("plain") / "report.html"
    write_report(result, page)
    return result, page


@pytest.fixture(scope="module")
def spoiled(make_result, tmp_path_factory):
    """(result, page) with photos, where the tracer errs: a bright block, three pixels of another object, one NaN."""

    def spoil(image: Image) -> Image:
        image.mean[60:64, 20:30] *= 1.5
        image.surface.ids[70, 40:43] = -1
        image.mean[10, 11] = np.nan
        return image

    result = make_result(photos=True, spoil=spoil)
    page = tmp_path_factory.mktemp("spoiled") / "report.html"
    write_report(result, page)
    return result, page


def text_of(page) -> str:
    """What a reader reads: without scripts, styles and tags."""
    source = re.sub(r"<(script|style)\b.*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", source)).split())


def data_of(page) -> dict:
    """What the page gives to the viewer."""
    found = re.search(r'id="viewer-data">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)
    return json.loads(found[1])


def titles(page) -> list[str]:
    return [pane["title"] for pane in data_of(page)["panes"]]


# ------------------------------------------------------------------------------------------ what it says


def test_a_page_says_what_there_is_and_leaves_out_what_means_nothing(plain):
    result, page = plain
    text = text_of(page)
    assert titles(page) == ["Tracer's image", "Twin's image", "Difference", "Silhouettes"]
    worth = f"p99.9 error {result.comparison.radiance.p999_abs:.2g}"
    for said in ("✓ Pass", "Silhouette mismatch", "sphere solver robust", "numpy 2.4.6", "412 ms", worth):
        assert said in text
    assert not [word for word in ("Calibration", "Whole image", "Worst tile", "FLIP") if word in text]


def test_a_failed_page_has_every_reason_with_its_place_the_photo_the_calibration_and_the_truth(spoiled):
    result, page = spoiled
    text = text_of(page)
    assert titles(page)[-2:] == ["Augmented photo", "Photo"]
    photos = [view.photo for view in result.calibration.views]
    for said in ("✗ Fail", "few_views", *photos):
        assert said in text
    found = re.findall(r'<(?:li|span)><a href="(#[^"]+)">(.*?)</a></(?:li|span)>', page.read_text(encoding="utf-8"))
    assert [unescape(text) for _, text in found] == list(result.comparison.reasons)
    assert "#pixel=11,10,48" in [address for address, _ in found]
    assert {"x": 40, "y": 70, "width": 1, "height": 1} in data_of(page)["places"]


def test_noise_is_not_measured_against_the_tolerance_of_exact_images(make_result, tmp_path):
    """And an image without a surface has no silhouettes."""
    result = make_result()
    noisy = replace(result.twin, variance=np.full_like(result.twin.mean, 1e-4), samples=64)
    write_report(replace(result, test=Image(result.subject.mean), reference=noisy), tmp_path / "report.html")
    text = text_of(tmp_path / "report.html")
    assert "noise included" in text
    assert "64 samples per pixel" in text
    assert not data_of(tmp_path / "report.html")["bound"]["held"]
    assert "Silhouettes" not in titles(tmp_path / "report.html")


# ------------------------------------------------------------------------------------------ in a browser


def assert_true_digits(text: str, value: float) -> None:
    """The last digit that is shown is correct: within half of it, or, next to a tie, of the value that was stored."""
    whole, _, exponent = text.replace("−", "-").partition("e")
    last = 10.0 ** (int(exponent or 0) - len(whole.partition(".")[2]))
    assert abs(float(text.replace("−", "-")) - value) <= 0.76 * last, (text, value)


POINTS = [(0, 0), (159, 119), (80, 60), (25, 61), (41, 70), (97, 41), (60, 30)]

LOOK = """
  result.read = [];
  for (const [x, y] of POINTS) {
    viewer.keep(x, y);
    result.read.push(Object.fromEntries(["test", "reference", "error", "further"].map((row) => [row, texts(row)])));
  }
  viewer.keep(11, 10);
  result.lost = ["test", "reference", "error"].map(texts);
  location.hash = "#pixel=160,0";
  await new Promise((done) => setTimeout(done, 50));
  result.beyond = status();

  // pictures at their pixels: 4 across, each towards two of its corners
  viewer.state.outlines = false;
  viewer.kept = viewer.at = null;
  const [px, py] = PIXEL;
  viewer.look(px, py, 4);
  await drawn();
  result.colours = {};
  for (const key of ["test", "reference", "map", "photo", "augmented"]) {
    const c = canvas(key), s = c.width / viewer.view.span, all = pixels(key);
    result.colours[key] = [[-1, 0], [0, 0], [1, 0], [1, 1]].flatMap(([dx, dy]) => [-0.3, 0.3].map((off) => {
      const [u, v] = [c.width / 2 + (dx + off) * s, c.height / 2 + (dy + off) * s].map(Math.floor);
      return [...all.slice(4 * (v * c.width + u))].slice(0, 3);
    }));
  }
  viewer.set({ exposure: viewer.state.exposure + 1 });
  await drawn();
  const b = canvas("reference"), aside = 0.4 * b.width / 4;  // beside the numbers that are written into the pixel
  const middle = () => [...pixels("reference", b.width / 2 - aside | 0, b.height / 2 - aside | 0, 1, 1)].slice(0, 3);
  result.brighter = middle();
  viewer.set({ tone: "filmic" });
  await drawn();
  result.filmic = middle();
  viewer.set({ tone: "sRGB" });
  viewer.reset();
  await drawn();
  result.sizes = [...viewer.panes.values()].map((pane) => [pane.canvas.clientWidth, pane.canvas.clientHeight]);
  result.wide = [document.documentElement.scrollWidth, innerWidth];
"""

PLAY = """
  const c = canvas("reference"), box = c.getBoundingClientRect();
  const at = (x, y) => ({
    clientX: box.left + ((x + 0.5) / 160) * box.width, clientY: box.top + ((y + 0.5) / 120) * box.height,
    bubbles: true, pointerId: 1, isPrimary: true, button: 0, pointerType: "mouse" });
  const send = (type, x, y, more) => c.dispatchEvent(new PointerEvent(type, { ...at(x, y), ...more }));
  const where = () => [viewer.x.valueAsNumber, viewer.y.valueAsNumber];
  send("pointermove", 100, 50);
  result.hovered = where(); result.object = texts("reference")[3];
  send("pointerdown", 90, 45, { buttons: 1 }); send("pointerup", 90, 45);
  result.clicked = where(); result.address = location.hash;
  const key = (name, shiftKey = false) => c.dispatchEvent(new KeyboardEvent("keydown", { key: name, shiftKey }));
  key("ArrowRight"); key("ArrowDown", true);
  result.moved = where();
  const before = [viewer.view.x, viewer.view.y];
  key("+"); await drawn(); result.zoomed = viewer.view.span;
  // the kept pixel stays where it is
  result.still = [0, 1].map((k) => (where()[k] - [viewer.view.x, viewer.view.y][k]) * 1.5 - (where()[k] - before[k]));
  for (let i = 0; i < 40; i++)
    for (const [type, x, y] of [["down", 10, 10], ["move", 150, 110], ["up", 150, 110]]) send(`pointer${type}`, x, y);
  await drawn(); result.corner = [viewer.view.x, viewer.view.y, viewer.view.span];
  key("0"); await drawn(); result.whole = viewer.view.span;
  document.querySelector('a[href^="#pixel="]').click();
  await drawn(); result.followed = location.hash; result.close = viewer.view.span;
  key("f"); key("f"); await drawn();
  result.flipped = [viewer.state.mode, viewer.state.solo, viewer.shown().length];
  key("w"); await drawn(); key("0"); viewer.set({ outlines: false }); viewer.at = null; viewer.show(); await drawn();
  const wide = canvas("test").width, row = pixels("test", 0, 4, wide, 1);
  result.wiped = [0.25, 0.75].map((t) => [...row.slice(4 * Math.floor(t * wide))].slice(0, 3));
  key("a"); key("n"); await drawn();
  result.place = where(); result.count = viewer.count.textContent;
  key("m"); await drawn(); result.map = viewer.panes.get("map").head.textContent;
  result.ticks = [...viewer.panes.get("map").ticks.children].map((tick) => tick.textContent);
  result.scrolls = [viewer.view.span];
  c.dispatchEvent(new WheelEvent("wheel", { deltaY: 100, bubbles: true, cancelable: true }));
  result.scrolls.push(viewer.view.span);
  c.dispatchEvent(new WheelEvent("wheel", { deltaY: -100, shiftKey: true, cancelable: true }));
  result.stops = viewer.state.exposure - viewer.data.exposure;
"""


@pytest.fixture(scope="module")
def looked(spoiled, browse):
    """(result, a contrasty pixel, what the browser found in one visit)."""
    result, page = spoiled
    shades = exposed(result.twin, exposure(result.twin)).astype(int)
    contrast = np.abs(shades[1:-1, 1:-1] - shades[2:, 2:]) + np.abs(shades[1:-1, 1:-1] - shades[1:-1, :-2])
    contrast[:20] = 0
    y, x = (int(i) + 1 for i in np.unravel_index(contrast.sum(axis=-1).argmax(), contrast.shape[:2]))
    script = f"const POINTS = {json.dumps(POINTS)}, PIXEL = [{x}, {y}];" + LOOK + PLAY
    found, console = browse(page, "#pixel=25,61", script)
    assert console == []
    return result, (x, y), found


def test_the_inspector_shows_the_values_of_the_exr_to_the_digits_shown(looked):
    result, _, found = looked
    a, b = result.subject, result.twin
    names = ["sphere 0 (red)", "sphere 1 (green)", "sphere 2 (blue)", "floor", "background"]
    for (x, y), read in zip(POINTS, found["read"], strict=True):
        for row, image in (("test", a), ("reference", b)):
            assert read[row][3] == names[image.surface.ids[y, x]]
            for text, value in zip(read[row][:3], image.mean[y, x], strict=True):
                assert_true_digits(text, float(value))
                assert text == "0" or len(text.replace(".", "").lstrip("0").partition("e")[0]) >= 2
            assert_true_digits(read[row][4], float(image.surface.depth[y, x]))
        error = a.mean[y, x].astype(float) - b.mean[y, x]
        for text, value in zip(read["error"][:3], error, strict=True):
            assert_true_digits(text.lstrip("+"), value)
        for text, value in zip(read["further"][:3], error / (np.abs(b.mean[y, x]) + 0.01), strict=True):
            assert_true_digits(text.lstrip("+"), value)


def test_a_pixel_that_is_not_finite_is_shown_as_such_and_one_that_is_not_there_is_answered(looked):
    test, reference, error = looked[2]["lost"]
    assert test[:3] == error[:3] == ["NaN"] * 3
    assert "NaN" not in reference
    assert looked[2]["beyond"] == "there is no pixel 160, 0"


def test_pictures_are_drawn_at_their_pixels_and_stay_sharp_when_magnified(looked):
    """At a zoom of 4 pixels, what the canvas shows towards a pixel's corners is the pixel's own colour."""
    result, (x, y), found = looked
    gain, corners = exposure(result.twin), ((-1, 0), (0, 0), (1, 0), (1, 1))
    # The page's exposure has two digits; its table of tones 9 bits: a code either way.
    for key, image in (("test", result.subject), ("reference", result.twin)):
        shown = exposed(image, gain).astype(int)
        expected = [shown[y + dy, x + dx] for dx, dy in corners for _ in range(2)]
        assert np.abs(np.array(found["colours"][key]) - expected).max() <= 2
    for key in ("photo", "augmented"):
        near = np.abs(np.array(found["colours"][key][2], int) - getattr(result, key)[y, x])
        assert near.max() < 40  # a JPEG
    twice = exposed(result.twin, 2 * gain)[y, x].astype(int)
    assert np.abs(np.array(found["brighter"]) - twice).max() <= 2
    filmic = to_screen(2 * np.float32(gain) * result.twin.mean, Look(tone="filmic"))[y, x].astype(int)
    assert np.abs(np.array(found["filmic"]) - filmic).max() <= 2
    for width, height in found["sizes"]:
        assert width > 350
        assert width / height == pytest.approx(160 / 120, rel=0.02)
    assert found["wide"][0] <= found["wide"][1]


def test_the_pointer_reads_a_pixel_a_click_keeps_it_and_keys_go_on_from_there(looked):
    result, _, read = looked
    assert read["hovered"] == [100, 50]
    seen = result.twin.surface.ids[50, 100]
    assert read["object"] == ["sphere 0 (red)", "sphere 1 (green)", "sphere 2 (blue)", "floor", "background"][seen]
    assert (read["clicked"], read["address"]) == ([90, 45], "#pixel=90,45")
    assert read["moved"] == [91, 55]
    assert read["zoomed"] == pytest.approx(160 / 1.5, rel=1e-3)
    assert read["still"] == pytest.approx([0, 0], abs=1e-6)
    assert read["whole"] == pytest.approx(160, rel=1e-3)
    x, y, span = read["corner"]  # dragged for ever: the picture still fills the view
    assert abs(x - 79.5) <= 80.1 - span / 2
    assert abs(y - 59.5) <= 60.1 - 0.375 * span
    assert read["scrolls"][0] == read["scrolls"][1]  # a bare wheel is the page's
    assert read["stops"] == pytest.approx(0.25)


@pytest.mark.nightly
def test_what_the_tolerance_allows_has_no_colour_of_an_error(spoiled, chromium):
    with opened(chromium, spoiled[1].as_uri(), color_scheme="dark") as page:
        page.wait_for_selector("#viewer[data-ready]")
        shades = page.evaluate(
            "((v) => { const { allowed } = v.scale();"
            " return [1e-3, 0.1, 1, 1.01, 10].flatMap((k) => [v.shade(k * allowed), v.shade(-k * allowed)]); })"
            "(document.getElementById('viewer').viewer)"
        )
        said = page.inner_text("#viewer figure:has(.rt-legend)")
    spread = [max(shade) - min(shade) for shade in shades]
    assert max(spread[:6]) < 20
    assert min(spread[6:]) > 40
    assert "grey" in said


def test_links_places_flip_wipe_and_maps_do_what_they_say(looked):
    result, _, read = looked
    assert read["followed"] == "#pixel=11,10"  # the first reason: a pixel that is no number
    assert read["close"] == pytest.approx(48)
    assert read["flipped"] == ["one", "test", 1]
    left, right = (exposed(i, exposure(result.twin)).astype(int) for i in (result.subject, result.twin))
    assert np.abs(np.array(read["wiped"][0]) - left[0:3, 40]).min() <= 4
    assert np.abs(np.array(read["wiped"][1]) - right[0:3, 120]).min() <= 4
    assert read["place"] == [11, 10]
    assert read["count"].startswith("1 of ")
    assert read["map"] == "Relative difference"
    assert "0" in read["ticks"]
    assert all(text[0] in "+-0" for text in read["ticks"])


@pytest.mark.nightly
def test_thinned_values_are_their_blocks_worst_and_a_photo_of_another_size_is_shown(
    make_result, tmp_path, browse, monkeypatch
):
    thinned = partial(packing.pack, most_pixels=5000)
    monkeypatch.setattr("raytwin.show.compare_page.viewer.pack", thinned)
    result = make_result(photos=True)
    large = np.repeat(np.repeat(result.photo, 2, axis=0), 2, axis=1)
    write_report(replace(result, photo=large, augmented=None), tmp_path / "report.html")
    script = """
      const c = canvas("photo"), at = [0.6, 0.7].map((part, k) => Math.floor(part * [c.width, c.height][k]));
      result.photo = [...pixels("photo", ...at, 1, 1)].slice(0, 3);
      viewer.keep(97, 41);
      result.at = [viewer.x.valueAsNumber, viewer.y.valueAsNumber];
      result.error = texts("error");"""
    read, console = browse(tmp_path / "report.html", "", script)
    assert console == []
    assert np.abs(np.array(read["photo"], int) - result.photo[84, 96]).max() < 40  # the same field of view
    assert "of each 2 × 2 pixels, it has the one that errs most" in text_of(tmp_path / "report.html")
    error = (result.subject.mean - result.twin.mean)[40:42, 96:98]
    dy, dx = np.unravel_index(np.abs(error).max(axis=-1).argmax(), (2, 2))
    assert read["at"] == [96 + dx, 40 + dy]
    for text, value in zip(read["error"][:3], error[dy, dx], strict=True):
        assert_true_digits(text.lstrip("+"), float(value))


@pytest.mark.nightly
def test_where_there_is_no_noise_the_map_in_sigmas_holds_errors_to_the_tolerance(tmp_path, browse):
    """Noise on the left half; on the right an error of rounding, and one far beyond the tolerance."""
    reference = Image(np.full((16, 32, 3), 0.5, np.float32), np.zeros((16, 32, 3), np.float32), 64, batches=16)
    reference.variance[:, :16] = 1e-4
    test = replace(reference, mean=reference.mean.copy())
    test.mean[4, 20] += 1e-6
    test.mean[9, 25] += 1e-2
    test.mean[9, 5] += 0.02
    for name, image in (("a", test), ("b", reference)):
        write_image(tmp_path / f"{name}.exr", image)
    found = diff(tmp_path / "a.exr", tmp_path / "b.exr")
    assert (16, 0, 16, 16) in found.comparison.failing
    write_report(view_of(found), tmp_path / "report.html")
    script = """
    const shade = (x, y) => { const i = y * 32 + x; return viewer.shade(viewer.map()[i]); };
    result.map = viewer.state.map;
    result.shades = [shade(20, 4), shade(25, 9), shade(5, 9)];
    result.failing = viewer.data.failing;
    viewer.keep(25, 9);
    result.row = texts("further");
    """
    read, console = browse(tmp_path / "report.html", script=script)
    assert console == []
    assert read["map"] == "sigmas"
    small, large, noisy = read["shades"]
    assert small == [255, 255, 255]
    assert large[0] > 100  # as red as can be
    assert max(large[1:]) < 40
    assert noisy[0] > noisy[2] > max(large[1:])  # 2 sigma: pale red
    assert [16, 0, 16, 16] in read["failing"]
    assert read["row"][:3] == ["–"] * 3
