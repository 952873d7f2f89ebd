"""A rectangle's means in the viewer, and the keys that choose two of many pictures."""

import numpy as np
import pytest
from test_bench_page import every_method
from test_levels_page import FOUND

from raytwin.images.exr import write_exr
from raytwin.images.image import Image
from raytwin.show.bench_page import MOST_PICTURES, pictures_of, write_bench_all
from raytwin.show.levels_page import write_levels
from raytwin.show.report_folder import write_diff
from raytwin.study.diff_files import compare as diff
from raytwin.study.levels import Levels

SIZE = 24, 36
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
      result.said = document.querySelector(".rt-status").textContent;
      const before = { ...viewer.view };
      send("pointerdown", 20, 20), send("pointerup", 20, 20);
      result.after = [viewer.area, rows()[3][0], viewer.kept];
      result.still = before.x === viewer.view.x;"""


@pytest.mark.parametrize("noisy", [True, False])
def test_a_dragged_rectangle_has_its_means_their_ratio_and_their_sigmas(noisy, browse, tmp_path):
    """Shift and drag for a pair with a variance, the button for one without."""
    rng = np.random.default_rng(5)
    a, b = rng.uniform(0.2, 0.8, (2, *SIZE, 3)).astype(np.float32)
    variance = rng.uniform(0.5e-3, 2e-3, (*SIZE, 3)).astype(np.float32)
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
    assert float(read["said"].split("ratio ")[1].split(",")[0]) == pytest.approx(
        a[part].mean() / b[part].mean(), rel=1e-3
    )
    assert ("|z|" in read["said"]) == noisy
    assert read["after"] == [None, "in σ" if noisy else "relative", [20, 20]]
    assert read["still"]


def test_digits_choose_the_first_picture_and_with_shift_the_second(browse, tmp_path):
    names = "tracer: shadow", "twin: path", "reference: all light"
    rng = np.random.default_rng(3)
    write_levels(
        Levels(FOUND, {name: Image(rng.uniform(0, 1, (*SIZE, 3)).astype(np.float32)) for name in names}), tmp_path
    )
    script = """
      const shown = () => root.dataset.shown, press = (on, code, shiftKey) =>
        on.dispatchEvent(new KeyboardEvent("keydown", { code, key: code.at(-1), shiftKey, bubbles: true }));
      await until(shown);
      press(document.body, "Digit2", false);
      press(document.querySelector("#viewer canvas"), "Digit1", true);
      await until(() => shown() === "twin: path | tracer: shadow");
      result.shown = shown();
      result.mode = viewer.state.mode;
      press(document.querySelector("#viewer input"), "Digit3", false);
      press(document.body, "Digit9", false);
      result.pressed = document.querySelectorAll('[data-picture][aria-pressed="true"]').length;"""
    read, console = browse(tmp_path / "levels.html", "", script)
    assert (console, read["shown"], read["pressed"]) == ([], "twin: path | tracer: shadow", 2)
    assert read["mode"] == "grid"


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
