"""The page of any two images: their own names, and a page even where they cannot lie side by side."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_html import text_of, titles

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


@pytest.fixture
def pair(tmp_path):
    def write(a, b, **options):
        for name, image in (("a.exr", a), ("b.exr", b)):
            write_exr(tmp_path / name, image if isinstance(image, Image) else Image(image))
        found = diff(tmp_path / "a.exr", tmp_path / "b.exr", **options)
        write_diff(found, tmp_path / "out")
        return found, tmp_path / "out"

    return write


def test_the_images_are_called_a_and_b_and_nothing_else(pair):
    found, out = pair(A, B)
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


@pytest.mark.parametrize("other", [A[:-1], A.transpose(1, 0, 2)])
def test_other_sizes_give_a_page_that_shows_both(pair, other):
    _, out = pair(A, np.ascontiguousarray(other))
    text = text_of(out / "report.html")
    h, w = other.shape[:2]
    assert f"the test image is 36 x 24 pixels, the reference {w} x {h}" in text
    assert f"{w} × {h} pixels" in text
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count('<img class="alone" src="data:image/') == 2
    assert "RMSE" not in text  # no number of theirs means anything
    assert "<script" not in page
    assert not (out / "heatmap.png").exists()


def test_the_head_of_a_scenes_page_names_the_subject(make_result, tmp_path):
    result = make_result()
    named = replace(result, settings=result.settings | {"subject": "mine.py:render"})
    write_report(named, tmp_path / "report.html")
    assert "mine.py:render beside its Mitsuba twin" in text_of(tmp_path / "report.html")


@pytest.mark.foreign
def test_the_tracers_report_survives_a_twin_of_another_size_or_kind_and_leaves_out_such_a_surface(
    make_result, tmp_path
):
    result = make_result()
    for wrong in (
        Image(result.twin.mean[:-3]), Image(result.twin.mean[..., :2]), Image(result.twin.mean[..., 0]),
        Image(np.zeros((0, 5, 3), np.float32)), Image(result.twin.mean.astype(object)), Image("no array"),
    ):  # fmt: skip
        report = Report("s", "shadow", compare(result.subject, wrong))
        assert not report.comparison.passed
        write_report(replace(result, reference=wrong, report=report), tmp_path / "report.html")
        assert "✗ Fail" in text_of(tmp_path / "report.html")
    s = result.twin.surface
    cropped = replace(result.twin, surface=Surface(s.ids[:-1], s.depth[:-1], s.normal[:-1]))
    write_report(replace(result, reference=cropped), tmp_path / "report.html")
    assert "Silhouettes" not in titles(tmp_path / "report.html")


def test_flip_is_one_row_of_the_page_where_it_was_asked_for(pair):
    pytest.importorskip("OpenImageIO")
    for flip in (False, True):
        found, out = pair(A, B, flip=flip)
        assert ("FLIP, mean" in text_of(out / "report.html")) == flip
        assert (found.comparison.perceptual.flip_mean is None) != flip
        assert found.metrics["flip_hdr"] == found.comparison.perceptual.flip_mean
