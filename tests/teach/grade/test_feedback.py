"""Wrong numbers that nobody has a name for: found among many, named once, said to all who have them."""

import itertools

import numpy as np
import pytest
import submitted_tracers as tracers

from raytwin.errors import InputError
from raytwin.parallel import Workers
from raytwin.show import class_page as pages
from raytwin.teach.contract.check_function import call_stage
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.grade.class_run import jobs_of, run
from raytwin.teach.grade.feedback import row_of, unnamed
from raytwin.teach.grade.fingerprint import PROBE_SEED, fingerprint, same
from raytwin.teach.grade.rubric import read_rubric

RUBRIC = 'title = "t"\nseed = {seed}\nhints = 0\n[[exercises]]\nstage = "shade"\npoints = 10\n'
STRIPED = (
    "def shade(points, normals, albedo, to_light, irradiance, sky):\n"
    "    stripes = 1 + 0.3 * np.sin(9 * points[:, :1])\n"
    "    return plain(points, normals, albedo, to_light, irradiance, sky) * stripes\n"
)
LOOPED = (
    "def shade(points, normals, albedo, to_light, irradiance, sky):\n"
    "    right = plain(points, normals, albedo, to_light, irradiance, sky)\n"
    "    return np.array([c + 0.3 * c * np.sin(p[0] * 9) for p, c in zip(points, right)])\n"
)


def submission(wrong: str) -> str:
    return f"{tracers.RIGHT}\nplain = shade\n{wrong}"


@pytest.mark.nightly
def test_an_unknown_mistake_is_named_once_and_said_to_all_who_make_it_without_grading_them_again(tmp_path, monkeypatch):
    rubric, out = tmp_path / "r.toml", tmp_path / "out"
    rubric.write_text(RUBRIC.format(seed=1))
    (tmp_path / "in").mkdir()
    for name, text in (("ann", STRIPED), ("bob", LOOPED), ("cy", STRIPED.replace("0.3", "0.4"))):
        (tmp_path / "in" / f"{name}.py").write_text(submission(text))
    results = run(jobs_of(tmp_path / "in", rubric), out, Workers())
    (found, who), (_, alone) = unnamed(results)
    assert [r.student for r in who] == ["ann", "bob"]
    assert [r.student for r in alone] == ["cy"]
    pages.write_class(results, read_rubric(rubric), out)
    assert found.fingerprint in (out / "index.html").read_text()
    row = row_of(found).replace('sentence = ""', 'sentence = "no stripes"').replace('name = ""', 'name = "stripes"')
    rubric.write_text(RUBRIC.format(seed=1) + row)
    monkeypatch.setattr("raytwin.teach.grade.class_run.grade_submission", None)
    told = {r.student: r for r in run(jobs_of(tmp_path / "in", rubric), out, Workers())}
    assert {name: r.exercises[0].sureness for name, r in told.items()} == {"ann": "named", "bob": "named", "cy": ""}
    assert told["bob"].exercises[0].sentences == ("no stripes",)
    assert told["ann"].faults == {"stripes": "no stripes"}
    monkeypatch.undo()  # next year: another seed, another student, the same row
    rubric.write_text(RUBRIC.format(seed=77) + row)
    (tmp_path / "dee.py").write_text(submission(STRIPED) + "\n# mine\n")
    (next_year,) = run(jobs_of(tmp_path / "dee.py", rubric), out, Workers())
    assert next_year.exercises[0].sentences == ("no stripes",)


def test_mistakes_that_differ_have_other_fingerprints_and_rounding_changes_none():
    stage, rng, made = LESSONS["shade"], np.random.default_rng(0), []
    cases = stage.cases(PROBE_SEED)[:3]
    expected = [a for case in cases for a in case.expected]
    for variant in stage.variants:
        got = call_stage(stage, variant.make(), cases)
        arrays = [a for one in got if not isinstance(one, str) for a in one]
        if text := fingerprint(expected, arrays):
            made.append((text, arrays))
            rounded = [a * (1 + 1e-7 * rng.standard_normal(a.shape)) for a in arrays]
            assert same(text, fingerprint(expected, rounded)), variant.name
    assert len(made) > 20
    for (x, a), (y, b) in itertools.combinations(made, 2):
        near = [
            np.allclose(p, q, rtol=0, atol=1e-2 * np.abs(p).max(), equal_nan=True) for p, q in zip(a, b, strict=True)
        ]
        assert all(near) or not same(x, y)


def test_infinities_in_the_wrong_place_are_errors_and_the_correct_ones_and_rounding_are_none():
    """Where a finite value is expected, infinity counts as half of the largest error, on either side."""
    expected = [np.array([1, np.inf])]
    assert fingerprint(expected, [np.array([1 + 0.9e-9, np.inf])]) == ""
    assert fingerprint(expected, [np.array([1 + 1.5e-9, np.inf])])
    found = [fingerprint(expected, [np.array(got)]) for got in ([np.inf, np.inf], [6, np.inf], [1, 1], [2, np.inf])]
    assert found[0] == found[1] != found[2]
    assert len(set(found)) == 3
    assert fingerprint([np.zeros(2)], [np.zeros(3)]) == ""


def test_a_row_that_is_wrong_is_refused_with_its_field(tmp_path):
    for field, value, said in (
        ("fingerprint", "1 2", r"feedback\[0\]\.fingerprint"),
        ("sentence", " ", r"feedback\[0\]\.sentence"),
        ("stage", "shad", "did you mean shade"),
    ):
        row = {"stage": "shade", "sentence": "x", "fingerprint": " ".join(["0.5"] * 16)} | {field: value}
        text = RUBRIC.format(seed=1) + "[[feedback]]\n" + "".join(f'{k} = "{v}"\n' for k, v in row.items())
        (tmp_path / "r.toml").write_text(text)
        with pytest.raises(InputError, match=said):
            read_rubric(tmp_path / "r.toml")
