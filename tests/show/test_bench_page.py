"""The bench's page and pictures, from a made-up run: complete, offline, labels apart, alive in a browser."""

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from msgspec.structs import replace as replace_row

from raytwin.images.image import Image
from raytwin.show.bench_page import (
    MOST_PICTURES,
    bench_summary,
    error_chart,
    error_charts,
    frontier_rows,
    pictures_of,
    write_bench_all,
    write_bench_page,
)
from raytwin.show.charts.chart import HEIGHT, LEFT, LINE, TOP, WIDTH, log_range, svg_text
from raytwin.show.charts.svg import log_ticks
from raytwin.show.numbers import shown
from raytwin.study.bench import RENDERERS, Bench, Measurement, on_frontier

SIZES = ((400, 300), (800, 600), (1600, 1200))
FLOOR = {"shadow-center": 1e-8, "path-area": 1e-3}


@pytest.fixture(scope="module")
def made() -> Bench:
    return every_method()


def every_method(sizes: tuple[tuple[int, int], ...] = SIZES) -> Bench:
    """Every method that a machine without CUDA has, at three sizes, with seconds and errors that look the part."""
    rng = np.random.default_rng(4)
    rows, errors = [], []
    methods = [m for m in RENDERERS.values() if "cuda" not in m.library]
    for w, h in sizes:
        for m in methods:
            seconds = w * h / 1e6 * 0.02 * m.samples**0.8 * rng.lognormal(0, 0.7) + 1e-3
            exact = m.sampling == "center" and m.rung == "shadow"
            own = 0.0 if m.precision == 64 else 3e-8 * rng.lognormal(0, 0.5) if exact else 0.2 / m.samples**0.5
            whole = max(0.2 / m.samples**0.5 * rng.lognormal(0, 0.3), 5e-4)
            e = own if exact else whole
            own_truth = "shadow-center" if exact else "path-area"
            for found, truth, value in ((rows, own_truth, e), (errors, "path-area", whole)):
                found.append(
                    Measurement(m.name, m.library, f"float{m.precision}", m.rung, m.trim, m.step, m.samples, w, h,
                        seconds, 0.1 * seconds, 0.2, truth, value, 0.1 * value if m.noisy else None, value**2,
                        3 * value, FLOOR[truth], False, "pass", "they agree")
                )  # fmt: skip
    return Bench("made up", {"processor": "one", "cores": "2"}, {"numpy": "2"}, 60.0, 59.0, sizes,
                 (*ranked(rows),), (*ranked(errors),), {"cuda32-shadow-conic": "no <CUDA> here"})  # fmt: skip


def ranked(rows: list[Measurement]) -> Iterator[Measurement]:
    """Yield the rows with what is on the frontier among those of the same size and reference."""
    for size in dict.fromkeys((r.width, r.height, r.truth) for r in rows):
        same = [r for r in rows if (r.width, r.height, r.truth) == size]
        flags = on_frontier([r.seconds_median for r in same], [r.rmse for r in same], same[0].truth_floor)
        yield from (replace_row(r, on_frontier=flag) for r, flag in zip(same, flags, strict=True))


SVG = "{http://www.w3.org/2000/svg}"


def shapes(chart, kind: str) -> list[ElementTree.Element]:
    """What the chart's SVG has of one kind, bold and other labels being `text` of the class label."""
    return list(ElementTree.fromstring(svg_text(chart)).iter(SVG + kind))


def labels(chart) -> list[tuple[float, float, float, str]]:
    """(left, right, height, text) of every point's label, in pixels."""
    found = []
    for e in shapes(chart, "text"):
        if e.get("paint-order"):
            left = float(e.get("x"))
            found.append((left, left + 0.6 * float(e.get("font-size")) * len(e.text), float(e.get("y")), e.text))
    return found


def test_no_label_lies_over_another_or_beyond_the_frame(made):
    for chart in error_charts(made):
        found = labels(chart)
        for a, b in itertools.combinations(found, 2):
            assert a[1] <= b[0] or b[1] <= a[0] or abs(a[2] - b[2]) > LINE - 2, (chart.key, a[3], b[3])
        assert all(low >= LEFT and high <= LEFT + WIDTH and TOP <= y <= TOP + HEIGHT + 5 for low, high, y, _ in found)


def test_who_is_on_the_frontier_is_named_and_what_lies_below_the_floor_is_marked(made):
    for chart in error_charts(made):
        assert {p.name for p in chart.points if p.strong} == {text for *_, text in labels(chart)}
        for p in chart.points:
            assert p.y >= chart.floor * (1 - 1e-12)
            assert p.hollow == (p.y <= chart.floor * (1 + 1e-12))
    assert any(p.hollow for p in error_chart(made, SIZES[0], "shadow-center").points)


def test_noisy_methods_alone_have_an_upright_of_two_standard_errors(made):
    lines = error_chart(made, SIZES[0], "path-area").lines
    noisy = [e for e in made.errors if (e.width, e.height) == SIZES[0] and e.rmse_sigma]
    bars = [(line.xs[0], *line.ys) for line in lines if len(set(line.xs)) == 1]
    np.testing.assert_allclose(bars, [(e.seconds_median, 0.8 * e.rmse, 1.2 * e.rmse) for e in noisy])


def test_a_method_whose_error_is_no_number_is_left_out_of_the_chart(made):
    size, truth = made.sizes[0], made.errors[0].truth
    wrong = (replace_row(made.errors[0], rmse=math.nan, rmse_sigma=math.nan), *made.errors[1:])
    drawn = error_chart(replace_row(made, errors=wrong), size, truth)
    assert len(drawn.points) == len(error_chart(made, size, truth).points) - 1
    alone = replace_row(made, errors=wrong[:1], rows=())
    assert error_chart(alone, size, truth) is None


@pytest.mark.nightly
def test_the_choice_of_size_and_reference_shows_another_chart(made, tmp_path, browse):
    write_bench_page([made], tmp_path / "bench.html")
    script = r"""
      const shown = () => [...document.querySelectorAll("[data-chart]")].filter((e) => !e.hidden);
      result.first = shown().map((e) => e.dataset.chart);
      const pick = (name, value) => {
        const select = document.querySelector(`[data-choice="${name}"]`);
        select.value = value; select.dispatchEvent(new Event("change"));
      };
      pick("size", "1600x1200"); pick("truth", "shadow-center");
      result.then = shown().map((e) => e.dataset.chart);
      result.title = shown()[0].querySelector("svg").getAttribute("aria-label");
      result.frontier = [...shown()[1].querySelectorAll("tbody tr")].map(
        (row) => [...row.children].map((cell) => cell.textContent));
      const point = shown()[0].querySelector('[data-name="drjit32-shadow-conic"]');
      point.dispatchEvent(new PointerEvent("pointerover", { bubbles: true, clientX: 300, clientY: 300 }));
      const box = document.querySelector(".hover");
      result.hidden = box.hidden; result.tip = box.textContent; result.tags = box.children.length;
      result.box = box.getBoundingClientRect().top;
      result.walked = [];
      const view = shown()[0].querySelector(".view");
      for (const key of ["Escape", "ArrowRight", "ArrowRight", "ArrowLeft", "Escape"]) {
        view.focus();
        view.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        result.walked.push(box.hidden ? "" : box.textContent.split("\n")[0]);
      }
      pick("truth", "path-area");
      result.gone = box.hidden;"""
    read, console = browse(tmp_path / "bench.html", "", script)
    assert console == []
    assert read["first"] == 2 * ["400x300/path-area"]
    assert read["then"] == 2 * ["1600x1200/shadow-center"]
    chart = error_chart(made, SIZES[2], "shadow-center")
    assert read["title"] == chart.title
    assert [tuple(row) for row in read["frontier"]] == frontier_rows(chart)
    row = next(r for r in made.rows if r.method == "drjit32-shadow-conic" and r.width == 1600)
    assert read["tip"].startswith("drjit32-shadow-conic\n")
    assert f"RMSE {shown(row.rmse)}" in read["tip"]
    assert (read["hidden"], read["tags"], read["gone"]) == (False, 0, True)
    assert 200 < read["box"] < 420
    by_time = [p.name for p in sorted(chart.points, key=lambda p: p.x)]
    assert read["walked"] == ["", by_time[0], by_time[1], by_time[0], ""]


def test_a_chart_has_every_point_at_its_place_in_its_colour_and_escapes_every_text(made):
    chart = replace(error_chart(made, SIZES[0], "shadow-center"), title='a <b> & "c"')
    drawn = [e for kind in ("circle", "polygon") for e in shapes(chart, kind) if e.get("data-name")]
    found = {e.get("data-name"): e for e in drawn}
    assert found.keys() == {p.name for p in chart.points}
    (x0, x1), (y0, y1) = np.log(chart.x_range), np.log(chart.y_range)
    for p in chart.points:
        e = found[p.name]
        assert (e.get("stroke"), e.get("fill")) == (p.colour, "#ffffff" if p.hollow else p.colour)
        corners = np.array([[float(v) for v in xy.split(",")] for xy in (e.get("points") or "").split()])
        x, y = corners.mean(axis=0) if corners.size else (float(e.get("cx")), float(e.get("cy")))
        assert x == pytest.approx(LEFT + WIDTH * (np.log(p.x) - x0) / (x1 - x0), abs=1)
        assert y == pytest.approx(TOP + HEIGHT * (1 - (np.log(p.y) - y0) / (y1 - y0)), abs=1)
    assert chart.title in [e.text for e in shapes(chart, "text")]


@pytest.fixture
def judged() -> list[Bench]:
    """Two scenes, of which the second has a subject that fails, and one that was not measured."""
    few, mine, crash = every_method(SIZES[:1]), "numpy32-shadow-conic", {"mine.py:crash": "IndexError: seven"}
    wrong = {"verdict": "fail", "reason": "too <dark>"}
    rows = tuple(replace_row(r, **(wrong if r.method == mine else {})) for r in few.rows)
    wild = replace_row(few, scene="wild", rows=rows, subjects=(mine, *crash), left_out=few.left_out | crash)
    return [replace_row(few, scene="calm", subjects=(mine,)), wild]


def test_the_subjects_alone_decide_the_exit_code_and_the_terminal_says_their_verdicts_first(judged):
    calm, wild = judged
    assert (calm.exit_code, wild.exit_code) == (0, 1)
    assert replace_row(wild, subjects=()).exit_code == 0
    assert replace_row(wild, subjects=("mine.py:crash",)).exit_code == 2
    lines = bench_summary(wild).splitlines()
    assert lines[1].startswith("FAIL  wild, 400 x 300: numpy32-shadow-conic: ")
    assert lines[1].endswith(": too <dark>")
    assert lines[2] == "UNDECIDED  wild, 400 x 300: mine.py:crash: not measured: IndexError: seven"
    assert bench_summary(calm).splitlines()[1].startswith("PASS  calm")


def test_the_folder_has_every_number_and_each_chart_of_every_scene(made, judged, tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    write_bench_all([made], one)
    charts = {f"{w}x{h}-{t}.svg" for w, h in SIZES for t in FLOOR}
    assert {p.name for p in one.iterdir()} == {"bench.html", "bench.json"} | charts
    page = (one / "bench.html").read_text(encoding="utf-8")
    for said in ("no &lt;CUDA&gt; here", *(f'"row">{r.method}</th>' for r in made.rows)):
        assert said in page
    write_bench_all(judged, two)
    assert [scene["scene"] for scene in json.loads((two / "bench.json").read_text())] == ["calm", "wild"]
    assert {p.name for p in two.iterdir()} == {"bench.html", "bench.json", "calm", "wild"}
    assert (two / "wild" / "400x300-path-area.svg").exists()
    page = (two / "bench.html").read_text(encoding="utf-8")
    for said in ("wild: error against seconds", "✓ pass", "✗ fail", "too &lt;dark&gt;", "IndexError: seven"):
        assert said in page


def test_the_bench_shows_the_subjects_the_reference_and_what_is_on_a_frontier(tmp_path):
    bench = every_method(((400, 300),))
    wide = Image(np.full((30, 600, 3), 0.5, np.float32))
    methods = list(dict.fromkeys(row.method for row in bench.rows))
    images = dict.fromkeys([*methods, "reference path-area", "reference sky-area"], wide)
    chosen = pictures_of(bench, images)
    on = {row.method for row in (*bench.rows, *bench.errors) if row.on_frontier}
    assert next(iter(chosen)) == "reference path-area"
    assert set(chosen) - {"reference path-area"} <= on
    assert 2 <= len(chosen) <= MOST_PICTURES
    assert {image.shape for image in chosen.values()} == {(10, 200, 3)}
    assert pictures_of(bench, {}) == {}
    write_bench_all([bench], tmp_path / "with", images)
    write_bench_all([bench], tmp_path / "without")
    shown = ['id="pictures"' in (tmp_path / name / "bench.html").read_text() for name in ("with", "without")]
    assert shown == [True, False]


def test_an_axis_has_three_to_nine_ticks_wherever_its_points_lie():
    for low in np.geomspace(1e-9, 1e3, 271):
        for factor in (1.0, 1.3, 3.0, 50.0, 1e6):
            assert 3 <= len(log_ticks(log_range((low, factor * low), 0.1))) <= 9
