"""The page of the paper's figures, from a made-up run: its numbers are those of paper.json, and it links to nothing."""

import json
import re

import pytest

from raytwin.bench import Calibrated, LeftOut
from raytwin.bench.calibration_cost import OURS, SHRUNK, WHOLE
from raytwin.paper import paper_summary, write_paper_all
from raytwin.paper.paper_page import charts_of
from raytwin.paper.paper_record import PUBLISHED, Boxed, Frame, Paper, Ratio
from raytwin.report.numbers import seconds, shown


@pytest.fixture(scope="module")
def made() -> Paper:
    calibration = tuple(
        Calibrated(setting, scale, 15, 3.1 * scale + i, 0.061 / scale, source, 0.1, 500 + i, "k1k2", focal, w, h)
        for source, focal, w, h in (("synthetic", 0.0123, 4032, 3024), ("smaller", None, 1000, 1333))
        for i, (setting, scale) in enumerate(((WHOLE, 1.0), (OURS, 1.0), (SHRUNK, 0.5), (SHRUNK, 0.25)))
    )  # fmt: skip
    loops = tuple(
        Frame(f"loop-lambert-{trim}", "Python loop lambert", trim, 1008, 756, t, 0.01, 1e-9, 2e-9, 3e-9, 0, waste)
        for trim, t, waste in (("none", 6.13, 1447337), ("corners", 0.612, 24680), ("conic", 0.512, 13579))
    )  # fmt: skip
    full = Frame("numpy32-lambert-none", "numpy32 lambert", "none", 4032, 3024, 0.777, 0.01, 7e-8, 8e-7, 1.5e-5, 0, 9)
    fill = Frame("fill", "fill", "fill", 4032, 3024, 0.0043, 0.0, None, None, None)
    guessed = tuple(
        Frame(f"numpy32-lambert-{way}{n}", f"speculation, {way}", f"n={n}", 4032, 3024, 0.7 / n, 0.0, e * n, 2 * e * n,
              9 * e * n)
        for way, e in (("paper", 1e-3), ("careful", 7e-8)) for n in (2, 4, 8, 16)
    )  # fmt: skip
    boxes = (Boxed("hard", "corners", 800, 600, 211204, 63, 22075, 139.0),)
    ratios = (Ratio("this / that", "at most 2", 1.875),)
    left = (LeftOut("drjit32-lambert-none", 4032, 3024, "no <LLVM>"),)
    return Paper(
        "two spheres", {"processor": "one", "cores": "2"}, {"numpy": "2"}, 60.0, 59.0, 0.049, PUBLISHED, calibration,
        (*loops, fill, full), guessed, boxes, ratios, {"1008x756": 3e-9, "4032x3024": 3e-9}, left,
    )  # fmt: skip


@pytest.fixture(scope="module")
def out(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    write_paper_all(made, folder)
    return folder


def rows_of(page: str, key: str) -> list[list[str]]:
    table = re.search(rf'<table[^>]*id="t-{key}">(.*?)</table>', page, re.DOTALL)[1]
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)]
    return [[cell.replace("&#39;", "'").replace("&lt;", "<").replace("&gt;", ">") for cell in row] for row in rows[1:]]


def test_the_numbers_of_the_page_and_the_table_are_those_of_the_json(out):
    found = json.loads((out / "paper.json").read_text(encoding="utf-8"))
    page = (out / "paper.html").read_text(encoding="utf-8")
    table = (out / "paper.md").read_text(encoding="utf-8")
    want = {
        "calibration": [
            [c["setting"], f"{c['scale']:g}", str(c["tags"]), seconds(c["seconds_median"]), shown(c["heldout_px"]),
             shown(c["focal_percent"])]
            for c in found["calibration"]
        ],
        "intersection": [
            [f["family"], seconds(f["seconds_median"]), *(shown(f[k]) for k in ("rmse", "p999_abs", "max_abs", "cut"))]
            for f in found["intersection"]
        ],
        "speculation": [
            [seconds(f["seconds_median"]), shown(0.777 / f["seconds_median"]), shown(f["rmse"]), shown(f["max_abs"])]
            for f in (found["intersection"][-1], *found["speculation"])
        ],
        "boxes": [[b["scene"], shown(b["pixels"]), shown(b["wasted"]), shown(b["cut"])] for b in found["boxes"]],
        "ratios": [[r["what"], r["asked"], shown(r["measured"])] for r in found["ratios"]],
    }  # fmt: skip
    for key, expected in want.items():
        rows = rows_of(page, key)
        assert len(rows) == len(expected), key
        for row, cells in zip(rows, expected, strict=True):
            assert [c for c in cells if c not in row] == [], (key, row)
            assert "| " + " | ".join(row) + " |" in table


def test_the_papers_own_seconds_stand_beside_ours(out):
    page = (out / "paper.html").read_text(encoding="utf-8")
    by_photos = {(r[0].split(",")[0], r[1], r[2]): r[-2:] for r in rows_of(page, "calibration")}
    assert by_photos["synthetic", WHOLE, "1"] == ["34.8 s", "1.00"]
    assert by_photos["synthetic", SHRUNK, "0.25"] == ["2.5 s", "13.9"]
    assert by_photos["smaller", WHOLE, "1"] == ["4.5 s", ""]
    loops = {r[1]: r[-2:] for r in rows_of(page, "intersection") if r[0].startswith("Python loop")}
    assert loops["untrimmed"] == ["17.7 and 19.6 s", ""]
    assert loops["eight-corner box"] == ["1.3 and 8 s", "13.6 and 2.45"]
    assert "seconds of the two do not compare" in page


def test_the_page_opens_offline_and_charts_stand_beside_it(out, made):
    page = (out / "paper.html").read_text(encoding="utf-8")
    source = re.sub(r"<script\b.*?</script>", "", page, flags=re.DOTALL)
    assert re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?(?!data:|#)[\w/.:]+', source) == []
    assert "no &lt;LLVM&gt;" in source
    keys = [c.key for charts in charts_of(made).values() for c in charts]
    assert keys == ["calibration", "calibration-2", "intersection", "speculation"]
    assert all((out / f"{key}.svg").exists() for key in keys)
    assert "1.88" in paper_summary(made)


def test_charts_hold_the_frames_and_mark_what_the_truth_cannot_tell(made):
    charts = {c.key: c for charts in charts_of(made).values() for c in charts}
    points = {p.name: p for p in charts["intersection"].points}
    assert "fill, 4032 x 3024" not in points  # it has no error
    assert points["loop-lambert-none, 1008 x 756"].hollow
    assert not points["numpy32-lambert-none, 4032 x 3024"].hollow
    assert points["numpy32-lambert-none, 4032 x 3024"].x == 0.777
    assert len(charts["speculation"].points) == 9
    assert {(p.x, p.y) for p in charts["calibration-2"].points} == {
        (c.seconds_median, c.heldout_px) for c in made.calibration if c.source == "smaller"
    }
