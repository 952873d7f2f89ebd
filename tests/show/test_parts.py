"""The ledger's parts are maps: a click on a part makes it the difference picture."""

import base64
import zlib
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from raytwin.compare.report import Part
from raytwin.explain.ledger import Ledger
from raytwin.images.packing import pack_parts
from raytwin.show.compare_page import write_report

CLICKS = r"""
  const button = document.querySelector('[data-part="sun\'s shadow"]');
  const look = () => ({ pressed: button.ariaPressed, title: viewer.panes.get("map").head.textContent,
    at: [[10, 10], [150, 10], [10, 110]].map(([x, y]) => viewer.map()[y * viewer.data.columns + x]),
    row: texts("further").slice(0, 3) });
  result.buttons = [...document.querySelectorAll("[data-part]")].map((b) => b.textContent);
  result.before = look();
  viewer.keep(10, 10); button.click(); drawn(); result.part = look();
  button.click(); drawn(); result.after = look();
"""


@pytest.mark.nightly
def test_a_click_on_a_part_shows_its_values_and_a_second_click_the_difference(make_result, tmp_path, browse):
    result = make_result()
    picture = np.zeros((60, 80, 3), np.float32)  # of every second pixel of 160 x 120
    picture[:50, :40], picture[:50, 40:] = 0.02, -0.03
    rows = (Part("sun's shadow", rmse=0.02, noise=0.001), Part("bounce 1", rmse=0.0), Part("noise", rmse=0.001))
    ledger = Ledger(rows, {"sun's shadow": picture, "bounce 1": np.zeros_like(picture)}, picture, 2)
    report = msgspec.structs.replace(result.report, ledger=rows)
    write_report(replace(result, ledger=ledger, report=report), tmp_path / "report.html")
    found, console = browse(tmp_path / "report.html", script=CLICKS)
    assert console == []
    assert found["buttons"] == ["sun's shadow"]  # a part that is 0 has no picture
    assert found["part"]["pressed"] == "true"
    assert found["part"]["title"] == "sun's shadow"
    assert found["part"]["at"] == pytest.approx([0.02, -0.03, 0.0], abs=0.001)  # its noise
    assert [float(x) for x in found["part"]["row"]] == pytest.approx([0.02] * 3, abs=0.001)
    assert found["before"] == found["after"] | {"row": found["before"]["row"]}
    assert found["after"]["title"] == "Difference"


def test_a_large_part_is_averaged_in_blocks_in_which_its_noise_cancels():
    rng = np.random.default_rng(1)
    picture = (0.5 + rng.normal(0, 0.1, (400, 600, 3))).astype(np.float32)
    (part,) = pack_parts({"some": picture, "none": 0 * picture}, 3, {"some": 0.1})
    assert (part["step"], part["columns"], part["lines"]) == (6, 300, 200)
    raw = np.frombuffer(zlib.decompress(base64.b64decode(part["planes"][0]["data"])), np.uint8).reshape(2, -1)
    words = (raw[0].astype(np.uint16) << 8 | raw[1]).view(np.float16)
    red = np.ldexp(words.astype(float), part["planes"][0]["shift"])
    assert red.std() == pytest.approx(0.05, rel=0.03)  # of 4 pixels each; five standard errors
    assert len(np.unique(red)) < 200  # digits below the noise are left out
