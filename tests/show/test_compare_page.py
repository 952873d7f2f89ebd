"""What the page of two images says: of the tracer and its twin, of any two files, and where they cannot lie side by
side."""

import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from raytwin.compare import Report, compare
from raytwin.images.exr import write_exr
from raytwin.images.image import Image, Surface
from raytwin.images.photo_files import read_photo
from raytwin.show.compare_page import write_report
from raytwin.show.numbers import shown
from raytwin.show.report_folder import write_diff
from raytwin.study.diff_files import compare as diff

RNG = np.random.default_rng(11)
A = RNG.random((24, 36, 3)).astype(np.float32)
B = A.copy()
B[5, 7] += 0.5


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


# ------------------------------------------------------------------------------------------ tracer and twin


def test_a_page_says_what_there_is_and_leaves_out_what_means_nothing(make_result, tmp_path):
    result, page = make_result(), tmp_path / "report.html"
    write_report(replace(result, settings=result.settings | {"subject": "mine.py:render"}), page)
    text = text_of(page)
    assert titles(page) == ["Tracer's image", "Twin's image", "Difference", "Silhouettes"]
    worth = f"p99.9 error {result.comparison.radiance.p999_abs:.2g}"
    head = "mine.py:render beside its Mitsuba twin"
    for said in (head, "✓ Pass", "Silhouette mismatch", "sphere solver robust", "numpy 2.4.6", "412 ms", worth):
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
    result, page = make_result(), tmp_path / "report.html"
    noisy = replace(result.twin, variance=np.full_like(result.twin.mean, 1e-4), samples=64)
    write_report(replace(result, test=Image(result.subject.mean), reference=noisy), page)
    assert "noise included" in text_of(page)
    assert "64 samples per pixel" in text_of(page)
    assert not data_of(page)["bound"]["held"]
    assert "Silhouettes" not in titles(page)


@pytest.mark.foreign
def test_a_twin_of_another_size_or_kind_fails_and_such_a_surface_is_left_out(make_result, tmp_path):
    result, page = make_result(), tmp_path / "report.html"
    for wrong in (
        Image(result.twin.mean[:-3]), Image(result.twin.mean[..., :2]), Image(result.twin.mean[..., 0]),
        Image(np.zeros((0, 5, 3), np.float32)), Image(result.twin.mean.astype(object)), Image("no array"),
    ):  # fmt: skip
        report = Report("s", "shadow", compare(result.subject, wrong))
        assert not report.comparison.passed
        write_report(replace(result, reference=wrong, report=report), page)
        assert "✗ Fail" in text_of(page)
    s = result.twin.surface
    cropped = replace(result.twin, surface=Surface(s.ids[:-1], s.depth[:-1], s.normal[:-1]))
    write_report(replace(result, reference=cropped), page)
    assert "Silhouettes" not in titles(page)


# ------------------------------------------------------------------------------------------ two files


@pytest.fixture
def pair(tmp_path):
    def write(other):
        for name, mean in (("a.exr", A), ("b.exr", other)):
            write_exr(tmp_path / name, Image(mean))
        found = diff(tmp_path / "a.exr", tmp_path / "b.exr")
        write_diff(found, tmp_path / "out")
        return found, tmp_path / "out"

    return write


def test_the_images_are_called_a_and_b_and_nothing_else(pair):
    found, out = pair(B)
    text = text_of(out / "report.html")
    worst = f"worst {shown(found.comparison.radiance.max_abs)}"
    for said in ("✗ Fail", "a.exr against b.exr", "A − B", "psnr", worst, *found.comparison.reasons):
        assert " ".join(said.split()) in text
    for wrong in ("Mitsuba", "tracer", "Tracer", "twin", "scene"):
        assert not re.search(rf"\b{wrong}\b", text)
    assert {p.name for p in out.iterdir()} == {"report.html", "comparison.json", "heatmap.png"}
    colours = read_photo(out / "heatmap.png")
    assert colours.shape == A.shape
    blue = colours[5, 7]
    assert blue[2] > blue[0] + 50  # A is darker
    assert (colours[0, 0] == 255).all()


def test_other_sizes_give_a_page_that_shows_both(pair):
    _, out = pair(np.ascontiguousarray(A.transpose(1, 0, 2)))
    text = text_of(out / "report.html")
    assert "the test image is 36 x 24 pixels, the reference 24 x 36" in text
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count('<img class="alone" src="data:image/') == 2
    assert "RMSE" not in text  # no number of theirs means anything
    assert "<script" not in page
    assert not (out / "heatmap.png").exists()
