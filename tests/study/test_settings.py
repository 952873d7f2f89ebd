"""Settings are checked once, when they are made; the command line's options are the records' fields."""

import dataclasses
import inspect

import pytest

from raytwin.cli import compare_commands, photo_commands
from raytwin.cli.options import with_options
from raytwin.errors import InputError
from raytwin.judging import DiffSettings
from raytwin.study.settings import AugmentSettings, CompareSettings

WRONG = [
    (CompareSettings, {"rung": "nonsense"}, "--rung: expected one of surface, lambert, shadow, sky, path"),
    (CompareSettings, {"tracer_rung": "path"}, "--tracer-rung: expected one of surface, lambert, shadow, got path"),
    (CompareSettings, {"sampling": "corner"}, "--sampling: expected one of center, area"),
    (CompareSettings, {"samples": 0}, "--samples: expected a whole number from 1"),
    (CompareSettings, {"engine": "abacus"}, "engine: expected one of"),
    (CompareSettings, {"solver": "abacus"}, "solver: expected one of"),
    (CompareSettings, {"trim": "abacus"}, "trim: expected one of"),
    (CompareSettings, {"samples": 4, "budget": "30s"}, "--budget: expected no --samples beside it"),
    (CompareSettings, {"detectable_tile_bias": 0.0}, "--detectable-tile-bias: expected a number > 0, got 0"),
    (AugmentSettings, {"exposure": -1.0}, "--exposure: expected a number >= 0"),
    (AugmentSettings, {"exposure": float("nan")}, "--exposure: expected a number >= 0"),
    (DiffSettings, {"tolerance": 0.0}, "tolerance: expected a finite number > 0"),
    (DiffSettings, {"samples": (0, -1)}, "samples: expected rays per pixel of both images"),
    (DiffSettings, {"tolerance": float("inf")}, "tolerance: expected a finite number > 0"),
]


def test_wrong_settings_are_refused_when_they_are_made():
    for record, wrong, message in WRONG:
        with pytest.raises(InputError) as error:
            record(**wrong)
        assert str(error.value).startswith(message)


def test_the_twin_takes_one_sample_only_where_all_are_the_same():
    for rung, sampling, samples in (("shadow", "center", 1), ("shadow", "area", 64), ("sky", "center", 64)):
        assert CompareSettings(rung=rung, sampling=sampling).twin_samples == samples, (rung, sampling)
        assert CompareSettings(rung=rung, sampling=sampling, samples=7).twin_samples == 7


def test_the_tracer_stands_on_the_highest_rung_up_to_the_twins_that_a_formula_gives():
    chosen = {rung: CompareSettings(rung=rung).climbed for rung in ("surface", "lambert", "shadow", "sky", "path")}
    assert list(chosen.values()) == ["surface", "lambert", "shadow", "shadow", "shadow"]


@pytest.mark.parametrize(
    ("name", "command", "record"),
    [
        ("compare", compare_commands.compare_command, CompareSettings),
        ("diff", compare_commands.diff_command, DiffSettings),
        ("photo draw", photo_commands.draw_command, AugmentSettings),
    ],
)
def test_each_field_is_an_option_with_the_records_default_and_reaches_the_command(name, command, record):
    got = []
    options = inspect.signature(with_options(command, name)).parameters
    fields = {f.name: f.default for f in dataclasses.fields(record) if f.name in options}
    assert len(fields) >= 5
    assert {field: options[field].default for field in fields} == fields
    changed = {"flip": True} if "flip" in fields else {"boxes": True}

    def keep(settings):
        got.append(settings)

    keep.__annotations__["settings"] = record
    with_options(keep, name)(**fields | changed)
    assert got == [record(**changed)]
