"""The bench's page and pictures, from a made-up run: complete, offline, labels apart, alive in a browser."""

import itertools
import re

import numpy as np
import pytest

from raytwin.bench import METHODS, Bench, Calibrated, Error, Growth, LeftOut, Repeats, Row, Truth, against
from raytwin.report.bench_files import bench_summary, write_bench_all
from raytwin.report.bench_html import all_charts, as_data, write_bench_page
from raytwin.report.charts import FRAME, calibration_charts, error_chart, growth_charts
from raytwin.report.labels import BOLD_WIDTH, WIDTH, Label, place

SIZES = ((400, 300), (800, 600), (1600, 1200))
FLOOR = {"shadow-center": 1e-8, "path-area": 1e-3}


@pytest.fixture(scope="module")
def made() -> Bench:
    """Every method that a machine without CUDA has, at three sizes, with seconds and errors that look the part."""
    rng = np.random.default_rng(4)
    rows, errors, repeats = [], [], []
    methods = [m for m in METHODS if "cuda" not in m.engine]
    for w, h in SIZES:
        for m in methods:
            seconds = w * h / 1e6 * 0.02 * m.samples**0.8 * rng.lognormal(0, 0.7) + 1e-3
            exact = m.exact and m.rung == "shadow"
            own = 0.0 if m.precision == 64 else 3e-8 * rng.lognormal(0, 0.5) if exact else 0.2 / m.samples**0.5
            whole = max(0.2 / m.samples**0.5 * rng.lognormal(0, 0.3), 5e-4)
            repeats.append(Repeats(m.name, w, h, tuple(seconds * rng.lognormal(0, 0.02, 9)), (own,)))
            e = own if exact else whole
            truth = "shadow-center" if exact else "path-area"
            rows.append(
                Row(m.name, m.engine, f"float{m.precision}", m.rung, m.trim, m.speculation, m.samples, w, h, seconds,
                    0.1 * seconds, 0.2, 12.5, e, e * e, 3 * e, None, FLOOR[truth], False)
            )  # fmt: skip
            for t, value in (("path-area", whole), *((("shadow-center", own),) if exact else ())):
                errors.append(Error(m.name, w, h, t, value, value**2, 3 * value, None, False))
    truths = tuple(
        Truth(t, w, h, 1024, 2.0, {"rmse": f, "relmse": f * f, "p999_abs": 3 * f, "flip": None})
        for w, h in SIZES for t, f in FLOOR.items()
    )  # fmt: skip
    growth = tuple(
        Growth(m, n, 400, 300, 1e-3 * n**0.5, 0.0, 0.1)
        for m in ("numpy32-shadow-conic", "drjit32-shadow-conic") for n in (1, 10, 100, 1000)
    )  # fmt: skip
    calibration = tuple(
        Calibrated(setting, s, 15, 20 * s**1.5 * f, 0.3 / s**0.5)
        for setting, f in (("one pass", 1.0), ("refined", 1.3)) for s in (1.0, 0.5, 0.25)
    )  # fmt: skip
    left = (LeftOut("cuda32-shadow-conic", 400, 300, "no <CUDA> here"),)
    return Bench("made up", {"processor": "one", "cores": "2"}, {"numpy": "2"}, 60.0, 59.0, tuple(rows), truths,
                 tuple(errors), growth, calibration, left, tuple(repeats))  # fmt: skip


def boxes(chart):
    """Every text's rectangle, in pixels of the frame."""
    (x0, x1), (y0, y1) = np.log10(chart.x_range), np.log10(chart.y_range)
    for t in chart.texts:
        x = (np.log10(t.x) - x0) / (x1 - x0) * FRAME[0]
        y = (np.log10(t.y) - y0) / (y1 - y0) * FRAME[1]
        size = 11 if t.bold else 10
        yield x, y - size / 2, x + (BOLD_WIDTH if t.bold else WIDTH) * size * len(t.text), y + size / 2, t.text


def test_no_label_lies_over_another_or_beyond_the_frame(made):
    for chart in (*all_charts(made), *growth_charts(made), *calibration_charts("made", made.calibration)):
        found = list(boxes(chart))
        for a, b in itertools.combinations(found, 2):
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (chart.key, a[4], b[4])
        assert all(x0 >= 0 and y0 >= 0 and x1 <= FRAME[0] and y1 <= FRAME[1] for x0, y0, x1, y1, _ in found)


def test_nearly_every_method_has_its_label(made):
    for chart in all_charts(made):
        assert len(chart.unlabelled) <= 3, chart.unlabelled


def test_labels_find_room_around_one_crowded_point():
    labels = [Label(f"label {i}", 300.0, 300.0) for i in range(25)]
    found = place(labels, [(300.0, 300.0)], *FRAME)
    assert sum(p is not None for p in found) == 25
    assert found[0].leader is None
    assert any(p.leader for p in found)


def test_a_label_without_room_is_left_out():
    assert place([Label("much too long for the frame" * 9, 5.0, 5.0)], [], 100, 100) == [None]


def test_no_point_lies_below_the_floor_unmarked(made):
    for chart in all_charts(made):
        assert chart.floor is not None
        for p in chart.points:
            assert p.y >= chart.floor * (1 - 1e-12)
            assert p.hollow == (p.y <= chart.floor * (1 + 1e-12))
    assert any(p.hollow for p in error_chart(made, SIZES[0], "shadow-center", "rmse").points)


def test_guides_have_the_slope_that_is_said(made):
    for metric, slope in (("relmse", -1), ("rmse", -0.5)):
        guides = [g for g in error_chart(made, SIZES[0], "path-area", metric).lines if g.dash == "dotted"]
        assert guides
        for g in guides:
            assert np.diff(np.log(g.ys)) / np.diff(np.log(g.xs)) == pytest.approx(slope)


def test_growth_says_its_exponents(made):
    by_pixels, by_spheres = growth_charts(made)
    assert (by_pixels.key, by_spheres.key) == ("pixels", "spheres")
    assert all(re.search(r": 0\.50 ± 0\.00$", t.text) for t in by_spheres.texts)


def test_the_page_holds_every_number_and_links_to_nothing(made, tmp_path):
    write_bench_page(made, tmp_path / "bench.html", against(made, made))
    page = (tmp_path / "bench.html").read_text(encoding="utf-8")
    source = re.sub(r"<script\b.*?</script>", "", page, flags=re.DOTALL)
    assert re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?(?!data:|#)[\w/.:]+', source) == []
    assert "no &lt;CUDA&gt; here" in source
    for row in made.rows:
        assert f'<th scope="row">{row.method}</th>' in source
    assert "Against the earlier run" in source
    assert "calibration" in source


def test_pictures_stand_beside_the_page(made, tmp_path):
    write_bench_all(made, tmp_path / "out")
    names = {p.name for p in (tmp_path / "out").iterdir()}
    keys = {"pixels", "spheres", "calibration", *(f"{w}x{h}-{t}-relmse" for w, h in SIZES for t in FLOOR)}
    assert names == {"bench.html", "bench.json"} | {k + s for k in keys for s in (".svg", ".png")}
    svg = (tmp_path / "out" / "spheres.svg").read_text(encoding="utf-8")
    assert "numpy32-shadow-conic" in svg  # text stays text
    assert (tmp_path / "out" / "spheres.png").read_bytes().startswith(b"\x89PNG")


def test_the_terminal_names_what_changed(made):
    assert "nothing became slower" in bench_summary(made, against(made, made))


def test_the_choice_of_truth_and_metric_redraws_the_chart(made, tmp_path, browse):
    write_bench_page(made, tmp_path / "bench.html")
    script = """
      const model = (name) => Bokeh.documents[0].get_model_by_name(name);
      result.first = document.body.dataset.chart;
      result.before = model("points").data.y.length;
      const pick = (name, value) => {
        const select = document.getElementById(`choose-${name}`);
        select.value = value; select.dispatchEvent(new Event("change"));
      };
      pick("size", "1600x1200"); pick("truth", "shadow-center"); pick("metric", "rmse");
      await pause();
      result.then = document.body.dataset.chart;
      result.y = [...model("points").data.y]; result.range = [model("y_range").start, model("y_range").end];
      result.title = model("title").text;
      result.frontier = [...document.querySelectorAll("#frontier-rows th")].map((cell) => cell.textContent);
      result.row = window.raytwinBench.row("drjit32-shadow-conic");"""
    read, console = browse(tmp_path / "bench.html", "", script)
    assert console == []
    assert read["first"] == "400x300/path-area/relmse"
    assert read["then"] == "1600x1200/shadow-center/rmse"
    chart = error_chart(made, SIZES[2], "shadow-center", "rmse")
    np.testing.assert_allclose(read["y"], as_data(chart)["points"]["y"])
    assert read["range"] == pytest.approx(chart.y_range)
    assert read["title"] == chart.title
    assert set(read["frontier"]) == {p.method for p in chart.points if p.frontier}
    assert "seconds median" in read["row"]
    assert "12.5" in read["row"]
