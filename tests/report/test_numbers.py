"""Every number of the comparison has a row and a unit."""

import math

import msgspec
import pytest

from raytwin import files
from raytwin.compare import Comparison, Geometry, Perceptual, Radiance, Report, Statistics
from raytwin.report import numbers
from raytwin.scene import Tolerance

GROUPS = {"geometry": Geometry, "radiance": Radiance, "statistics": Statistics, "perceptual": Perceptual}


def test_every_field_of_the_comparison_is_a_row_and_every_row_a_field():
    fields = {(group, name) for group, kind in GROUPS.items() for name in kind.__struct_fields__}
    fields -= {("statistics", "p_values")}  # a histogram, which is drawn
    assert {(n.group, n.key) for n in numbers.NUMBERS} == fields
    assert len(numbers.NUMBERS) == len(fields)
    assert set(numbers.GROUPS) == set(GROUPS)


@pytest.mark.parametrize("number", numbers.NUMBERS, ids=lambda n: n.key)
def test_every_number_says_what_it_is(number):
    assert number.name
    assert number.meaning


def found(comparison: Comparison, noisy=False) -> dict[str, numbers.NumberRow]:
    return {
        row.number.key: row for _, rows in numbers.rows(comparison, Tolerance(p999_abs=1e-3), noisy) for row in rows
    }


def test_a_bound_is_held_exceeded_or_silent():
    failed = Comparison("fail", geometry=Geometry(0), radiance=Radiance(p999_abs=2e-3, rmse=1.0))
    rows = found(failed)
    assert rows["mask_mismatch_pixels"].within is True
    assert rows["p999_abs"].within is False
    assert rows["rmse"].within is None
    assert rows.keys() == {"mask_mismatch_pixels", "p999_abs", "rmse"}  # what is missing has no row


def test_a_pass_never_shows_an_exceeded_bound():
    passed = Comparison("pass", geometry=Geometry(3), radiance=Radiance(p999_abs=2e-3))
    assert [r.number.key for r in found(passed).values() if r.within is False] == []


def test_noise_is_not_held_to_the_bounds_of_exact_images():
    noisy = Comparison("fail", radiance=Radiance(p999_abs=0.1), geometry=Geometry(1))
    rows = found(noisy, noisy=True)
    assert rows["p999_abs"].bound is None
    assert rows["mask_mismatch_pixels"].within is False


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (0, "0"), (0.0, "0"), (12, "12"), (1234567, "1 234 567"), (2.1e-7, "2.10e-07"), (-0.5, "-0.500"),
     (0.0123, "0.0123"), (999.6, "1 000"), (1.0, "1.00"), (1e9, "1.00e+09"), (math.nan, "NaN"), (-math.inf, "-inf")],
)  # fmt: skip
def test_numbers_are_shown_to_three_digits(value, text):
    assert numbers.shown(value).replace("\u202f", " ") == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(1e-5, "1e-05"), (7.038194e-6, "7.04e-06"), (0.5, "0.5"), (2.5e-4, "2.5e-04"), (20, "20"), (0, "0")],
)
def test_bounds_are_written_as_people_write_them(value, text):
    assert numbers.short(value) == text


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [(1559.97213, 0.42, "1559.97"), (1559.97213, 7.3, "1560.0"), (-0.16241, 0.0031, "-0.1624"), (2.0, None, "2.000")],
)
def test_a_measured_value_ends_with_the_second_digit_of_its_sigma(value, sigma, text):
    assert numbers.beside(value, sigma) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (1e-6, "< 0.1 ms"), (0.0031, "3.1 ms"), (0.412, "412 ms"), (2.31, "2.31 s"), (41.18, "41.2 s"),
     (123.4, "123 s")],
)  # fmt: skip
def test_times_are_shown_to_about_three_digits(value, text):
    assert numbers.seconds(value) == text


def test_the_json_has_the_designed_keys_and_null_for_what_is_not_finite(tmp_path):

    report = Report("s", "shadow", Comparison("pass", ("all well",), radiance=Radiance(max_abs=math.inf)))
    files.write_json(tmp_path / "comparison.json", report.numbers())
    data = msgspec.json.decode((tmp_path / "comparison.json").read_bytes())
    assert list(data) == [
        "scene", "rung", "verdict", "reasons", "geometry", "radiance", "statistics", "perceptual", "ledger", "seconds",
        "backend",
    ]  # fmt: skip
    assert data["radiance"] == {"max_abs": None, "p999_abs": None, "rmse": None, "relmse": None, "mean_ratio": None}
    assert data["geometry"].keys() == {"mask_mismatch_pixels", "depth_max_rel", "normal_max_deg", "shift_px"}
    assert data["seconds"].keys() == {"calibrate", "tracer", "twin", "compare"}
