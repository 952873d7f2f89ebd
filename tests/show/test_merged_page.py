"""One test run on several machines: who contradicts the others, and pages that a reader can follow."""

import re
from pathlib import Path

import numpy as np
import pytest
from program import raytwin, refused

from raytwin.compare import Report, compare
from raytwin.images.image import Image
from raytwin.show import check_page
from raytwin.show.merged_page import merge, sentences

GREY = Image(np.full((12, 16, 3), 0.5, np.float32))


def report(folder: Path, **values: float | None) -> Path:
    """Write a machine's report: test -> the value of the upper half of its picture; None: the test was not run."""
    check_page.prepare(folder)
    for test, value in values.items():
        if value is not None:
            mean = GREY.mean.copy()
            mean[:6] = value
            made = Report(test, "path", compare(Image(mean), GREY))
            check_page.write_check(folder, f"test_mine.py::{test}", 0, made, (), Image(mean), GREY)
    check_page.write_index(folder)
    return folder


@pytest.fixture
def machines(tmp_path) -> list[Path]:
    return [
        report(tmp_path / "linux", same=0.5, odd_verdict=0.5, odd_picture=0.7, wrong=0.9, not_run=0.5),
        report(tmp_path / "mac", same=0.5, odd_verdict=0.4, odd_picture=0.3, wrong=0.9, not_run=0.5),
        report(tmp_path / "windows", same=0.5, odd_verdict=0.5, odd_picture=0.7, wrong=0.9, not_run=None),
    ]


def test_the_odd_machine_differs_from_most_in_verdict_or_in_how_its_picture_fails(machines):
    rows = merge(machines)
    odd = {re.search(r"::(\w+)", row.name)[1]: row.odd for row in rows}
    assert odd == {"odd_verdict": (1,), "odd_picture": (1,), "not_run": (2,), "wrong": (), "same": ()}
    assert sentences(rows, ["linux", "mac", "windows"]) == [
        "1 of 5 comparisons pass on all 3 machines.",
        "mac is the odd one in 2 of 5.",
        "windows is the odd one in 1 of 5.",
    ]
    two = merge(machines[:2])  # of two that differ, none is the odd one
    assert not any(row.odd for row in two)


def test_the_merged_pages_name_files_that_are_there(machines, tmp_path):
    done = raytwin("reference", "merge", *machines, "-o", tmp_path / "all", cwd=tmp_path)
    assert (done.returncode, done.stdout.splitlines()[1]) == (1, "mac is the odd one in 2 of 5.")
    page, summary = ((tmp_path / "all" / name).read_text() for name in ("index.html", "summary.md"))
    places = re.findall(r'(?:href|src)="(\.\.[^"]+)"', page)
    assert len(places) == 14 + 7  # pages, and pictures of what failed
    assert all((tmp_path / "all" / place).is_file() for place in places)
    shown = re.findall(r"!\[\w+\]\(([^)]+)\)", summary)
    assert len(shown) == 7
    assert set(shown) < set(places)
    assert page.count("the odd one") == 3 + 2
    assert raytwin("reference", "merge", report(tmp_path / "good", same=0.5), cwd=tmp_path).returncode == 0


def test_a_folder_without_a_report_is_refused(tmp_path):
    refused(raytwin("reference", "merge", tmp_path, cwd=tmp_path), "expected a report as pytest --raytwin-report")
    (tmp_path / "check-a.json").write_text("{")
    refused(raytwin("reference", "merge", tmp_path, cwd=tmp_path), "expected a report as pytest --raytwin-report")


def test_a_cell_of_a_summary_holds_no_markup(subtests):
    cases = {
        "a | b": "a \\| b",
        "<b>": "&lt;b&gt;",
        "*x* `y` [z](w)": "\\*x\\* \\`y\\` \\[z\\](w)",
        "two\nlines": "two lines",
    }
    for text, cell in cases.items():
        with subtests.test(text):
            assert check_page.cell(text) == cell
    assert check_page.cell("a", "", "b") == "a<br>b"
