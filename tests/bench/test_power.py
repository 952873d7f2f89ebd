"""The power table and the count of false alarms, at toy size: what goes in, what is counted, how it is printed."""

import numpy as np
import pytest
from measure.power import (
    FAULTS,
    SAMPLED,
    TOOLS,
    _counted,
    by_fault,
    false_alarms,
    power_table,
    render,
    samples_table,
)

from raytwin import twin
from raytwin.bench.verdict_tools import sees_z_test
from raytwin.files import read_scene
from raytwin.image import Image


@pytest.fixture(scope="module")
def overlap(scenes):
    twin.activate()
    scene = read_scene(scenes / "overlap").scene
    return scene.with_camera(scene.camera.resized(64, 48))


def test_every_fault_changes_the_image(overlap):
    clean = render(overlap, 16, 0).mean
    for name, fault in FAULTS.items():
        same = np.array_equal(fault(overlap, 16, 0).mean, clean, equal_nan=True)
        assert same == (name == "none"), name


def test_the_coarse_faults_are_seen_and_no_fault_is_not(overlap):
    rows = {row["fault"]: row for row in power_table(overlap, [16], seeds=2, reference_samples=1024)}
    assert rows["none"]["raytwin"] == 0
    for fault in ("3 % too bright", "gamma applied twice", "one NaN pixel", "two black rows"):
        assert rows[fault]["raytwin"] == 1, fault


def test_correct_renders_are_counted(overlap):
    rows = false_alarms({"overlap": overlap}, count=6)
    assert [row["comparisons"] for row in rows] == [2, 2, 2, 6]
    assert rows[-1]["alarms"] == 0


def test_the_interval_is_clopper_and_pearsons():
    """None of n: the upper end u has (1 - u)^n = 2.5 %."""
    row = _counted("x", 2000, 0)
    assert row["low"] == 0
    assert (1 - row["high"]) ** 2000 == pytest.approx(0.025)


def test_mitsubas_test_passes_what_it_is_known_to_pass():
    """Up to a quarter per cent of the pixels may be black; one more fails."""
    rng = np.random.default_rng(0)
    variance = np.full((64, 64, 3), 1e-4, np.float32)
    reference = Image(np.ones((64, 64, 3), np.float32), variance, samples=1000)
    mean = (1 + 1e-3 * rng.standard_normal((64, 64, 3))).astype(np.float32)
    mean.reshape(-1, 3)[:10] = 0
    assert not sees_z_test(Image(mean, variance, 1000), reference)
    mean.reshape(-1, 3)[:12] = 0
    assert sees_z_test(Image(mean, variance, 1000), reference)


def test_the_table_has_a_line_a_fault_and_a_dash_where_a_tool_is_missing():
    rows = [{"fault": f, "samples": 16, **dict.fromkeys(TOOLS, 0.5), "idiff": None} for f in FAULTS]
    lines = by_fault(rows, [16])
    assert len(lines) == len(FAULTS)
    assert lines[0] == ["none", *("-" if tool == "idiff" else "50" for tool in TOOLS)]


def test_more_samples_see_more_and_nothing_is_seen_where_nothing_is_wrong():
    rows = {name: cells for name, *cells in samples_table((16, 1024), 4, (24, 32))}
    assert list(rows) == list(SAMPLED)
    assert rows["Gaussian"][0] == "0 / 0"
    assert rows["Gaussian"][-1] == "100 / 100"
    none, one, _ = (cell.split(" / ") for cell in rows["exponential"])
    assert none == ["0", "0"]
    assert int(one[0]) < int(one[1]) == 100
    assert rows["rare events"][0].startswith("- / ")
