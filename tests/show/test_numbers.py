"""Every number of the comparison has a row and a unit."""

from raytwin.compare import Comparison, Geometry, Perceptual, Radiance, Statistics
from raytwin.scene import Tolerance
from raytwin.show import numbers

GROUPS = {"geometry": Geometry, "radiance": Radiance, "statistics": Statistics, "perceptual": Perceptual}


def test_every_field_of_the_comparison_is_a_row_and_every_row_a_field():
    fields = {(group, name) for group, kind in GROUPS.items() for name in kind.__struct_fields__}
    assert {(n.group, n.key) for n in numbers.NUMBERS} == fields
    assert len(numbers.NUMBERS) == len(fields)
    assert set(numbers.GROUPS) == set(GROUPS)
    assert all(number.name and number.meaning for number in numbers.NUMBERS)


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


def test_a_pass_exceeds_nothing_and_noise_is_not_held_to_the_bounds_of_exact_images():
    passed = Comparison("pass", geometry=Geometry(3), radiance=Radiance(p999_abs=2e-3))
    assert [r.number.key for r in found(passed).values() if r.within is False] == []
    rows = found(Comparison("fail", radiance=Radiance(p999_abs=0.1), geometry=Geometry(1)), noisy=True)
    assert rows["p999_abs"].bound is None
    assert rows["mask_mismatch_pixels"].within is False
