"""The page itself: complete, offline, right with photos and without, and alive in a browser."""

import json
import re
from dataclasses import replace
from functools import partial
from html import unescape

import msgspec
import numpy as np
import pytest

from raytwin.image import Image
from raytwin.report import write_report
from raytwin.report.pictures import exposed, exposure
from raytwin.report.values import pack_values


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


def titles(page) -> list[str]:
    return [unescape(t) for t in re.findall(r"<figure>\s*<h3>(.*?)</h3>", page.read_text(encoding="utf-8"))]


# ------------------------------------------------------------------------------------------ what it says


def test_the_verdict_stands_in_words_with_every_reason(plain, spoiled):
    assert "✓ Pass" in text_of(plain[1])
    text = text_of(spoiled[1])
    assert "✗ Fail" in text
    for reason in spoiled[0].comparison.reasons:
        assert " ".join(reason.split()) in text


def test_a_scene_without_photos_leaves_their_panels_and_the_calibration_out(plain):
    assert titles(plain[1]) == ["Tracer's image", "Twin's image", "Signed error", "Silhouettes"]
    assert "Calibration" not in text_of(plain[1])


def test_a_photographed_scene_shows_photo_calibration_pose_and_truth(spoiled):
    result, page = spoiled
    assert titles(page)[:2] == ["Photo", "Augmented photo"]
    text = text_of(page)
    for said in ("few_views", "Against the truth", "Pose of photo_03.jpg", "homography", "rotation off by", "0.74"):
        assert said in text
    for view in result.calibration.views:
        assert view.photo in text


def test_a_missing_number_is_a_dash_with_its_reason(plain):
    assert "both images are free of noise" in text_of(plain[1])
    assert plain[0].comparison.statistics.z_mean is None


def test_settings_versions_and_times_beside_errors_are_there(plain):
    text = text_of(plain[1])
    for said in ("sphere solver robust", "numpy 2.4.6", "twin variant llvm_ad_rgb", "412 ms", "p99.9 error 2e-7"):
        assert said in text


def test_text_from_the_input_is_never_markup(make_result, tmp_path):
    result = make_result()
    evil = "</script><script>alert(1)</script><b>"
    report = msgspec.structs.replace(result.report.saying(evil), scene=evil)
    scene = msgspec.structs.replace(result.scene, name=evil)
    write_report(replace(result, scene=scene, report=report), tmp_path / "report.html")
    assert "<script>alert" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_an_image_without_surface_is_reported_without_silhouettes(make_result, tmp_path):
    result = make_result()
    result = replace(result, subject=Image(result.subject.mean))
    write_report(result, tmp_path / "report.html")
    assert "Silhouettes" not in titles(tmp_path / "report.html")


def test_images_equal_to_the_last_bit_have_no_worst_pixels(make_result, tmp_path):
    result = make_result()
    write_report(replace(result, subject=result.twin), tmp_path / "report.html")
    assert "equal to the last bit" in text_of(tmp_path / "report.html")


def test_the_page_links_to_nothing_outside(spoiled):
    page = re.sub(r"<script\b.*?</script>", "", spoiled[1].read_text(encoding="utf-8"), flags=re.DOTALL)
    assert re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?(?!data:|#)[\w/.:]+', page) == []


# ------------------------------------------------------------------------------------------ in a browser


def shown(row: list[str]) -> list[float]:
    """Numbers of an inspector row, R, G, B and depth."""
    return [float(text.replace("−", "-")) for text in row[1:]]


def assert_true_digits(text: str, value: float) -> None:
    """The last digit that is shown is right: within half of it, or, next to a tie, of the value that was stored."""
    whole, _, exponent = text.replace("−", "-").partition("e")
    last = 10.0 ** (int(exponent or 0) - len(whole.partition(".")[2]))
    assert abs(float(text.replace("−", "-")) - value) <= 0.75 * last, (text, value)


READ = 'for (const row of ["test", "reference", "error"]) result[row] = texts(row);'


@pytest.mark.parametrize(("x", "y"), [(0, 0), (159, 119), (80, 60), (25, 61), (41, 70)])
def test_the_inspector_shows_the_pixel_of_the_address(spoiled, browse, x, y):
    result, page = spoiled
    read, console = browse(page, f"#pixel={x},{y}", READ + "result.status = document.body.dataset.ready;")
    assert console == []
    assert read["status"] == "true"
    a, b = result.subject, result.twin
    names = ["sphere 0", "sphere 1", "sphere 2", "plane 0", "background"]
    assert read["test"][0] == names[a.surface.ids[y, x]]
    assert read["reference"][0] == names[b.surface.ids[y, x]]
    for row, image in (("test", a), ("reference", b)):
        for text, value in zip(read[row][1:], [*image.mean[y, x], image.surface.depth[y, x]], strict=True):
            assert_true_digits(text, float(value))
    error = [*(a.mean - b.mean)[y, x], (a.surface.depth - b.surface.depth)[y, x]]
    np.testing.assert_allclose(shown(read["error"]), error, rtol=6e-3, atol=1e-12)


def test_pictures_are_drawn_at_their_pixels_and_stay_sharp_when_magnified(spoiled, browse):
    """At a zoom of 4 pixels, what the canvas shows towards a pixel's corners is the pixel's own colour."""
    result, page = spoiled
    shades = exposed(result.twin, exposure(result.twin)).astype(int)
    contrast = np.abs(shades[1:-1, 1:-1] - shades[2:, 2:]) + np.abs(shades[1:-1, 1:-1] - shades[1:-1, :-2])
    y, x = (int(i) + 1 for i in np.unravel_index(contrast.sum(axis=-1).argmax(), contrast.shape[:2]))
    script = """
      result.sizes = {};
      for (const key of ["photo", "augmented", "tracer", "twin", "error", "silhouettes"]) {
        const view = document.getElementById(`view-${key}`).getBoundingClientRect(), c = canvas(key);
        const at = (dx, dy) => [(0.5 + dx / 4) * c.width, (0.5 + dy / 3) * c.height].map(Math.round);
        let colours;
        // A busy machine paints late: look until the picture is the expected one, or for so long that it never will be.
        for (let tries = 0; tries < 40; tries++) {
          await pause();
          const all = pixels(key);
          colours = [[-1, 0], [0, 0], [1, 0], [1, 1]].flatMap(([dx, dy]) => [-0.3, 0.3].map((off) => {
            const [px, py] = at(dx + off, dy + off);
            return [...all.slice(4 * (py * c.width + px))].slice(0, 3);
          }));
          if (!(key in EXPECTED) || JSON.stringify(colours) === JSON.stringify(EXPECTED[key])) break;
          await new Promise((done) => setTimeout(done, 100));
        }
        result[key] = colours;
        result.sizes[key] = [view.width, view.height];
      }"""
    gain, corners = exposure(result.twin), ((-1, 0), (0, 0), (1, 0), (1, 1))
    expected = {}
    for key, image in (("tracer", result.subject), ("twin", result.twin)):
        pixels = exposed(image, gain)
        # Twice each: towards either corner of a pixel.
        expected[key] = [pixels[y + dy, x + dx].tolist() for dx, dy in corners for _ in range(2)]
    read, console = browse(page, f"#pixel={x},{y},4", f"const EXPECTED = {json.dumps(expected)};" + script)
    assert console == []
    for key, colours in expected.items():
        assert read[key] == colours
    for key in ("photo", "augmented"):
        near = np.abs(np.array(read[key][2], int) - getattr(result, key)[y, x])
        assert near.max() < 40  # a JPEG
    for width, height in read["sizes"].values():
        assert width > 350
        assert width / height == pytest.approx(160 / 120, rel=0.02)


def test_the_pointer_reads_a_pixel_and_a_click_keeps_it(spoiled, browse):
    result, page = spoiled
    script = """
      const target = canvas("twin").getRootNode().querySelector(".bk-events");
      target.setPointerCapture = target.releasePointerCapture = () => {};  // the browser knows no made-up pointer
      const settle = () => new Promise((done) => setTimeout(done, 500));
      const box = target.getBoundingClientRect();
      const at = (x, y) => ({
        clientX: box.left + ((x + 0.5) / 160) * box.width, clientY: box.top + ((y + 0.5) / 120) * box.height,
        bubbles: true, composed: true, pointerId: 1, isPrimary: true, button: 0, pointerType: "mouse" });
      const send = (type, x, y, more) => target.dispatchEvent(new PointerEvent(type, { ...at(x, y), ...more }));
      const where = () => ["at-x", "at-y"].map((id) => document.getElementById(id).valueAsNumber);
      send("pointermove", 100, 50); await settle();
      result.cross = ["height", "width"].map((d) => Bokeh.documents[0].get_model_by_name(`cross_${d}`).location);
      result.hovered = where(); result.object = texts("reference")[0];
      send("pointerdown", 90, 45, { buttons: 1 }); send("pointerup", 90, 45);
      await settle();
      result.clicked = where(); result.address = location.hash;
      const view = document.getElementById("view-twin");
      const key = (name, shiftKey = false) =>
        view.dispatchEvent(new KeyboardEvent("keydown", { key: name, shiftKey, bubbles: true }));
      key("ArrowRight"); key("ArrowDown", true);
      result.moved = where();
      const range = () => { const c = Bokeh.documents[0].get_model_by_name("columns"); return c.end - c.start; };
      key("+"); result.zoomed = range(); key("0"); result.whole = range();
      document.querySelector('a[href^="#pixel="]').click();
      result.followed = location.hash; result.close = range();"""
    read, console = browse(page, "", script)
    assert console == []
    assert read["hovered"] == read["cross"] == [100, 50]
    assert (
        read["object"]
        == ["sphere 0", "sphere 1", "sphere 2", "plane 0", "background"][result.twin.surface.ids[50, 100]]
    )
    assert (read["clicked"], read["address"]) == ([90, 45], "#pixel=90,45")
    assert read["moved"] == [91, 55]
    assert read["zoomed"] == pytest.approx(160 / 1.5)
    assert read["whole"] == pytest.approx(160)
    assert read["followed"] == "#pixel=40,70"  # the first pixel that sees another object
    assert read["close"] == pytest.approx(48)


def test_a_pixel_that_is_not_finite_is_shown_as_such(spoiled, browse):
    read, console = browse(spoiled[1], "#pixel=11,10", READ)
    assert console == []
    assert read["test"][1:4] == ["NaN"] * 3
    assert read["error"][1:4] == ["NaN"] * 3
    assert "NaN" not in read["reference"]


def test_an_address_beyond_the_picture_is_answered(plain, browse):
    read, console = browse(plain[1], "#pixel=160,0", 'result.status = document.getElementById("status").textContent')
    assert console == []
    assert read["status"] == "there is no pixel 160, 0"


def test_a_photo_of_another_size_spans_the_same_picture(make_result, tmp_path, browse):
    """Rendered at another size than the photo's, both still cover the same field of view."""
    result = make_result(photos=True)
    large = np.repeat(np.repeat(result.photo, 2, axis=0), 2, axis=1)
    write_report(replace(result, photo=large, augmented=None), tmp_path / "report.html")
    # A patch of the floor where the turned or mirrored picture shows the sky.
    ids = result.twin.surface.ids
    floor = (ids == 3) & (ids[::-1] == -1) & (ids[:, ::-1] == -1) & (ids[::-1, ::-1] == -1)
    inside = np.lib.stride_tricks.sliding_window_view(floor, (7, 7)).all(axis=(2, 3))
    y, x = (int(i) + 3 for i in np.argwhere(inside)[0])
    script = f"const fx = {(x + 0.5) / 160}, fy = {(y + 0.5) / 120};"
    script += """
      for (const key of ["photo", "twin"]) {
        const c = canvas(key), at = [fx * c.width, fy * c.height].map(Math.round);
        result[key] = [...pixels(key, ...at, 1, 1)].slice(0, 3);
      }"""
    read, console = browse(tmp_path / "report.html", "", script)
    assert console == []
    assert np.abs(np.array(read["photo"], int) - result.photo[y, x]).max() < 40
    assert read["twin"] == exposed(result.twin, exposure(result.twin))[y, x].tolist()


def test_thinned_values_are_those_of_a_named_neighbour(make_result, tmp_path, browse, monkeypatch):
    monkeypatch.setattr("raytwin.report.html.pack_values", partial(pack_values, most_pixels=5000))  # every 2nd pixel
    result = make_result()
    write_report(result, tmp_path / "report.html")
    assert "every 2nd pixel" in text_of(tmp_path / "report.html")
    script = READ + 'result.status = document.getElementById("status").textContent;'
    read, console = browse(tmp_path / "report.html", "#pixel=97,41", script)
    assert console == []
    assert read["status"] == "values of its neighbour 98, 42"
    twin = result.twin
    expected = [*twin.mean[42, 98], twin.surface.depth[42, 98]]
    np.testing.assert_allclose(shown(read["reference"]), expected, rtol=6e-4, atol=2e-5)


def test_noise_is_not_measured_against_the_tolerance_of_exact_images(make_result, tmp_path):
    result = make_result()
    noisy = replace(result.twin, variance=np.full_like(result.twin.mean, 1e-4), samples=64)
    write_report(replace(result, twin=noisy), tmp_path / "report.html")
    text = text_of(tmp_path / "report.html")
    assert "noise included" in text
    assert "64 samples a pixel" in text
    assert "black lines: the tolerance" not in text
