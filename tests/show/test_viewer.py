"""The viewer in a browser: numbers, pictures at their pixels, pointer, keys, parts of the light, rectangles, noise."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from test_compare_page import text_of

from raytwin.compare import Report, compare
from raytwin.images import packing
from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.images.packing import binned
from raytwin.show.compare_page import write_report
from raytwin.show.data_urls import exposed, exposure
from raytwin.show.report_folder import write_diff
from raytwin.show.view import PairView, view_of
from raytwin.study.diff_files import compare as diff


def assert_true_digits(text: str, value: float) -> None:
    """The last digit that is shown is correct: within half of it, or, next to a tie, of the value that was stored."""
    whole, _, exponent = text.replace("−", "-").partition("e")
    last = 10.0 ** (int(exponent or 0) - len(whole.partition(".")[2]))
    assert abs(float(text.replace("−", "-")) - value) <= 0.76 * last, (text, value)


def assert_true_row(texts: list[str], values: np.ndarray) -> None:
    """A value of each channel, with a sign where it is a difference."""
    for text, value in zip(texts[:3], values, strict=True):
        assert_true_digits(text.lstrip("+"), float(value))


POINTS = [(0, 0), (159, 119), (80, 60), (25, 61), (41, 70), (97, 41), (60, 30)]

LOOK = r"""
  const button = document.querySelector('[data-part="sun\'s shadow"]');
  const part = () => ({ pressed: button.ariaPressed, title: viewer.panes.get("map").head.textContent,
    at: [[10, 10], [150, 10], [10, 110]].map(([x, y]) => viewer.map()[y * viewer.data.columns + x]),
    row: texts("further").slice(0, 3) });
  result.buttons = [...document.querySelectorAll("[data-part]")].map((b) => b.textContent);
  viewer.keep(10, 10);
  result.before = part();
  button.click(); drawn(); result.part = part();
  button.click(); drawn(); result.after = part();
  const { allowed } = viewer.scale();
  result.shades = [1e-3, 0.1, 1, 1.01, 10].flatMap((k) => [viewer.shade(k * allowed), viewer.shade(-k * allowed)]);
  result.legend = viewer.panes.get("map").figure.innerText;
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
  result.brighter = [...pixels("reference", b.width / 2 - aside | 0, b.height / 2 - aside | 0, 1, 1)].slice(0, 3);
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
    names = ["sphere 0", "sphere 1", "sphere 2", "floor", "background"]
    for (x, y), read in zip(POINTS, found["read"], strict=True):
        for row, image in (("test", a), ("reference", b)):
            assert read[row][3] == names[image.surface.ids[y, x]]
            assert_true_row(read[row], image.mean[y, x])
            for text in read[row][:3]:
                assert text == "0" or len(text.replace(".", "").lstrip("0").partition("e")[0]) >= 2
            assert_true_digits(read[row][4], float(image.surface.depth[y, x]))
        error = a.mean[y, x].astype(float) - b.mean[y, x]
        assert_true_row(read["error"], error)
        assert_true_row(read["further"], error / (np.abs(b.mean[y, x]) + 0.01))


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
    for width, height in found["sizes"]:
        assert width > 350
        assert width / height == pytest.approx(160 / 120, rel=0.02)
    assert found["wide"][0] <= found["wide"][1]


def test_the_pointer_reads_a_pixel_a_click_keeps_it_and_keys_go_on_from_there(looked):
    result, _, read = looked
    assert read["hovered"] == [100, 50]
    seen = result.twin.surface.ids[50, 100]
    assert read["object"] == ["sphere 0", "sphere 1", "sphere 2", "floor", "background"][seen]
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


def test_what_the_tolerance_allows_has_no_colour_of_an_error(looked):
    spread = [max(shade) - min(shade) for shade in looked[2]["shades"]]
    assert max(spread[:6]) < 20
    assert min(spread[6:]) > 40
    assert "grey" in looked[2]["legend"]


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


def test_a_click_on_a_part_shows_its_values_and_a_second_click_the_difference(looked):
    found = looked[2]
    assert found["buttons"] == ["sun's shadow"]  # a part that is 0 has no picture
    assert (found["part"]["pressed"], found["part"]["title"]) == ("true", "sun's shadow")
    assert found["part"]["at"] == pytest.approx([0.02, -0.03, 0.0], abs=0.001)  # its noise
    assert [float(x) for x in found["part"]["row"]] == pytest.approx([0.02] * 3, abs=0.001)
    assert found["before"] == found["after"]
    assert found["after"]["title"] == "Difference"


DRAG = """
      const pane = viewer.shown()[0], box = pane.canvas.getBoundingClientRect();
      const send = (type, x, y) => {
        const [u, v] = viewer.frame_of(pane).at(x, y), at = { clientX: box.left + u, clientY: box.top + v };
        pane.canvas.dispatchEvent(new PointerEvent(type, { ...at, pointerId: 1, bubbles: true, SHIFT }));
      };
      const drag = (a, b) => { send("pointerdown", ...a); send("pointermove", ...b); send("pointerup", ...b); };
      const cells = (row) => row.innerText.split("\\t");
      const rows = () => [...document.querySelectorAll(".rt-inspector tbody tr")].map(cells);
      drag([5, 4], [16, 11]);
      result.area = viewer.area;
      result.rows = rows();
      result.said = status();
      const before = { ...viewer.view };
      send("pointerdown", 20, 20), send("pointerup", 20, 20);
      result.after = [viewer.area, rows()[3][0], viewer.kept];
      result.still = before.x === viewer.view.x;"""


@pytest.mark.parametrize("noisy", [True, False])
def test_a_dragged_rectangle_has_its_means_their_ratio_and_their_sigmas(noisy, browse, tmp_path):
    """Shift and drag for a pair with a variance, the button for one without."""
    rng = np.random.default_rng(5)
    a, b = rng.uniform(0.2, 0.8, (2, 24, 36, 3)).astype(np.float32)
    variance = rng.uniform(0.5e-3, 2e-3, a.shape).astype(np.float32)
    for name, mean in (("a.exr", a), ("b.exr", b)):
        write_exr(tmp_path / name, Image(mean, variance, samples=64) if noisy else Image(mean))
    write_diff(diff(tmp_path / "a.exr", tmp_path / "b.exr"), tmp_path / "out")
    script = DRAG.replace("SHIFT", f"shiftKey: {str(noisy).lower()}")
    if not noisy:
        script = '[...document.querySelectorAll("button")].find((b) => b.textContent === "Area").click();' + script
    read, console = browse(tmp_path / "out" / "report.html", "", script)
    assert console == []
    assert read["area"] == [5, 4, 16, 11]
    part = np.s_[4:12, 5:17]
    means = [x[part].mean(axis=(0, 1)) for x in (a, b)]
    z = (a - b)[part].sum(axis=(0, 1)) / np.sqrt(2 * variance[part].sum(axis=(0, 1)))
    last = z if noisy else means[0] / means[1]
    for row, expected in zip(read["rows"], (*means, means[0] - means[1], last), strict=True):
        np.testing.assert_allclose([float(x) for x in row[1:4]], expected, rtol=0.02, atol=1e-4)
    assert read["said"].startswith("means of 12 × 8 pixels: ratio ")
    ratio = float(read["said"].split("ratio ")[1].split(",")[0])
    assert ratio == pytest.approx(a[part].mean() / b[part].mean(), rel=1e-3)
    assert ("|z|" in read["said"]) == noisy
    assert read["after"] == [None, "in σ" if noisy else "relative", [20, 20]]
    assert read["still"]


# ------------------------------------------------------------------------------------------ large and noisy images


@pytest.fixture
def thinned(monkeypatch):
    """Pages keep at most 5000 pixels: every second one of 160 x 120."""
    monkeypatch.setattr("raytwin.show.compare_page.viewer.pack", partial(packing.pack, most_pixels=5000))


@pytest.mark.nightly
@pytest.mark.usefixtures("thinned")
def test_thinned_values_are_their_blocks_worst_and_a_photo_of_another_size_is_shown(make_result, tmp_path, browse):
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
    assert "one value per 2 × 2 pixels: that of the pixel with the largest error" in text_of(tmp_path / "report.html")
    error = (result.subject.mean - result.twin.mean)[40:42, 96:98]
    dy, dx = np.unravel_index(np.abs(error).max(axis=-1).argmax(), (2, 2))
    assert read["at"] == [96 + dx, 40 + dy]
    assert_true_row(read["error"], error[dy, dx])


@pytest.mark.nightly
@pytest.mark.usefixtures("thinned")
def test_noise_is_shown_in_sigmas_and_as_means_where_not_every_pixel_fits(make_result, tmp_path, browse):
    result = make_result()
    variance = np.full_like(result.twin.mean, 1e-4)
    mean = (result.twin.mean + 0.01 * np.random.default_rng(3).normal(size=variance.shape)).astype(np.float32)
    mean[40:48, 60:68] += 0.03
    test, reference = Image(mean, variance, 64), Image(result.twin.mean, 0 * variance, 1 << 20)
    pair = replace(result, test=test, reference=reference, report=Report("s", "", compare(test, reference)))
    shown = PairView(pair, "s", view_of(result).names)
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
    for row, values in (("test", a.mean[22, 31]), ("error", error), ("further", error / sigma)):
        assert_true_row(read[row], values)
    z = (mean - result.twin.mean)[44:48, 60:64].mean(axis=(0, 1)) / (0.01 / 4)
    assert read["z"][0] == pytest.approx(z[np.abs(z).argmax()], rel=0.05)
    assert read["z"][1] < 3


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
        write_exr(tmp_path / f"{name}.exr", image)
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
