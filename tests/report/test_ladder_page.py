"""The ladder's page: any two of its pictures, drawn from the numbers that were rendered."""

import numpy as np
import pytest

from raytwin.analysis.ladder import Ladder, Rungs, Step
from raytwin.report.ladder_page import bars, ladder_summary, write_ladder

SIZE = 24, 32


@pytest.fixture(scope="module")
def made() -> Ladder:
    from raytwin.compare.report import Part

    rng = np.random.default_rng(3)
    names = "tracer: shadow", "twin: path", "bounce 1 alone", "global illumination"
    images = {name: rng.uniform(0.1, 0.9, (*SIZE, 3)).astype(np.float32) for name in names}
    steps = Step("shadow", "tracer", "drjit32-shadow-conic", 0.002, 0.0144, None), Step(
        "path", "twin", "twin-path", 2.29, 0.0048, 0.0047)  # fmt: skip
    parts = (
        Part("numerics", rmse=3e-8, share_of_light=0.0),
        Part("bounce 1", rmse=0.014, share_of_light=-0.0191, between=("sphere 1", "plane 0")),
    )
    return Ladder(Rungs("made <up>", *SIZE[::-1], 64, 8, 0.002, steps, {"shadow": parts}, 12.3), images)


def test_any_two_pictures_are_shown_to_eleven_bits(made, browse, tmp_path):
    write_ladder(made, tmp_path)
    script = """
      const shown = () => root.dataset.shown;
      await until(shown);
      result.first = shown();
      [...document.querySelectorAll('[data-picture="B"]')].find((b) => b.textContent === "bounce 1 alone").click();
      await until(() => shown() === "tracer: shadow | bounce 1 alone");
      const at = 5 * 32 + 7;
      const here = viewer.read(7, 5);
      for (const [key, name] of [["a", "test"], ["b", "reference"]]) result[key] = here[name].map(([v]) => v);
      result.d = [0, 1, 2].map((c) => viewer.values.d[3 * at + c]);
      result.text = document.body.innerText;"""
    read, console = browse(tmp_path / "ladder.html", "", script)
    assert console == []
    assert read["first"] == "tracer: shadow | twin: path"
    a, b = (made.images[name][5, 7] for name in ("tracer: shadow", "bounce 1 alone"))
    np.testing.assert_allclose(read["a"], a, rtol=2**-11)
    np.testing.assert_allclose(read["b"], b, rtol=2**-11)
    np.testing.assert_allclose(read["d"], a - b, atol=2**-11)
    assert "-1.91 %" in read["text"]
    assert {p.name for p in tmp_path.iterdir()} == {"ladder.html", "ladder.json", "ladder.svg"}


def test_bars_are_as_long_as_their_parts_are_large(made):
    numerics, bounce = bars(made.rungs, "shadow")
    assert bounce["width"] == pytest.approx(100)
    assert numerics["width"] == pytest.approx(100 * 3e-8 / 0.014)


def test_the_summary_names_each_rung_and_what_it_leaves_out(made):
    text = ladder_summary(made.rungs)
    assert "shadow   tracer    2.0 ms   rmse 0.0144" in text
    assert "path     twin      2.29 s   rmse 0.00480, of it noise 0.0047" in text
    assert "shadow: bounce 1 -1.9 % of the light" in text
