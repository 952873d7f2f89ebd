"""The stages' tests: what is correct passes however it is done, and each typical mistake is found and named."""

import re

import numpy as np
import pytest
import shape_checks
from starter_submissions import FOOT

import raytwin
from raytwin.errors import InputError
from raytwin.explain.catalogue import FAULTS
from raytwin.explain.textbook import tracer_with
from raytwin.teach.contract import check_function as judging
from raytwin.teach.contract.check_function import judge_function
from raytwin.teach.contract.composed_tracer import compose
from raytwin.teach.contract.stage_result import MEND, CaseResult, StageResult
from raytwin.teach.contract.stage_table import CONTRACT, LESSONS

BY_HAND: dict = {}
"""A student's functions, by other formulas than the references'."""
exec(FOOT, BY_HAND)


def test_the_reference_passes_its_own_test():
    for name, stage in LESSONS.items():
        found = judge_function(stage, stage.reference, seed=1)
        assert found.passed, found.sentence
        assert (found.stage, found.wrong, found.causes) == (name, 0, ())


@pytest.mark.parametrize("stage", LESSONS.values(), ids=list(LESSONS))
def test_every_mistake_is_found_and_called_by_its_name_and_by_no_other(stage):
    """All variants' answers to the cases of a seed, held against one another as `explain` does."""
    cases = [*stage.cases(3), *stage.last(3)]
    shape_checks.next_test()  # whatever was kept of these cases: it is the variants' first calls that are checked

    def passes(answer):
        return all(judging._passes(stage, case, one) for case, one in zip(cases, answer, strict=True))

    def alike(a, b):
        return all(judging._agrees(stage, x, y) for x, y in zip(a, b, strict=True))

    answers = [(v.name, judging.call_stage(stage, v.make(), cases)) for v in stage.variants]
    shown = [(name, answer) for name, answer in answers if not passes(answer)]
    assert {name for name, _ in answers} - {name for name, _ in shown} <= {"too few steps"}
    assert not [(name, one) for name, answer in shown for one in answer if isinstance(one, str)]
    for name, answer in shown:
        names = {other for other, given in shown if alike(given, answer)}
        assert names == {name}, name


def test_a_planted_mistake_is_the_cause_that_is_told():
    for name, cause in (
        ("back_project", "tangential-swapped"),
        ("estimate_pose", "inverse pose"),
        ("intersect_sphere", "t-of-unit-rays"),
        ("shade", "no-clamp"),
    ):
        stage = CONTRACT[name]
        variant = next(v for v in stage.variants if v.name == cause)
        found = judge_function(stage, variant.make(), seed=2)
        assert not found.passed
        assert (found.causes, found.sentence) == ((cause,), variant.sentence)
        assert ("pixel u = " in found.inputs) == (name == "back_project")


def test_a_slip_in_the_textbook_is_the_cause_that_its_picture_names():
    slipped = compose({"intersect_sphere": tracer_with(changes=(("np.sqrt(disc)", "disc"),)).intersect_sphere})
    found = judge_function(CONTRACT["hit_points"], slipped.hit_points, seed=2)
    assert found.causes == ("root-missing",)
    assert next(f.sentence for f in FAULTS if f.name == "root-missing") in found.sentence


def test_misses_that_are_marked_by_another_number_are_named_with_it():
    def marked(*args, marks):
        origins, directions, center, _ = args
        t = BY_HAND["intersect_sphere"](*args)
        behind = ((center - origins) * directions).sum(axis=-1) < 0
        return np.where(np.isinf(t), np.where(behind, marks[-1], marks[0]), t)

    stage = CONTRACT["intersect_sphere"]
    for marks, named in (((1e10,), "1e+10"), ((np.nan,), "nan"), ((-np.inf,), "-inf"), ((np.nan, -1.0), "-1 or nan")):
        said = judge_function(stage, lambda *args, m=marks: marked(*args, marks=m))
        assert said.causes == ("misses-not-infinite",), marks
        assert f"np.inf, not {named}:" in said.sentence
    both = judge_function(stage, lambda *args: np.where((t := marked(*args, marks=(-1.0,))) < 0, t, 1.01 * t))
    assert "misses-not-infinite" not in both.causes


OUTSIDE = 'own = own & (np.linalg.norm(eye - thing["center"]) > thing["radius"])', "pass"


@pytest.mark.nightly
def test_a_wall_that_is_lit_from_inside_its_sphere_is_seen_once_all_else_is_right():
    """The pictures from inside are asked for last."""
    stage = CONTRACT["render"]
    found = judge_function(stage, tracer_with(changes=(OUTSIDE,)).render, seed=2)
    assert not found.passed
    assert found.causes == ("own-wall",)
    assert len(found.cases) == len(stage.cases(2)) + len(stage.last(2))
    assert [case.passed for case in found.cases[:5]] == [True] * 5
    assert "from inside a sphere its own wall is lit" in found.sentence


def test_what_nothing_explains_is_told_by_where_it_is_and_what_is_hardly_wrong_is_blamed_on_nothing():
    """Least on what shows nowhere, and is as near to the answer as the reference is."""
    stage = CONTRACT["intersect_sphere"]

    def drifting(origins, directions, center, radius):
        t = stage.reference(origins, directions, center, radius)
        return t * np.where(np.linalg.norm(origins - center, axis=1) < radius, 1 + 0.1 * np.sin(origins[:, 0]), 1)

    found = judge_function(stage, drifting)
    assert "Fails: rays that start inside" in found.sentence
    assert "Passes: rays that meet it from outside" in found.sentence
    slightly = (
        judge_function(stage, lambda *args, s=stage: s.reference(*args) * (1 + 20 * s.tolerance))
        for stage in (stage, CONTRACT["shade"])
    )
    for one in (found, *slightly):
        assert (one.passed, one.causes) == (False, ())


def test_what_is_no_answer_is_told_in_a_sentence():
    for function, said in (
        (lambda o, d, c, r: None, "it returned None: is there a return?"),
        (lambda o, d, c, r: "t", "it returned text, not numbers"),
        (lambda o, d, c, r: np.sqrt(-1 + 0j * o[:, 0]), "it returned complex numbers, not numbers"),
        (lambda o, d, c, r: o, r"it returned an array \(32, 3\), where t \(32,\) is wanted: one number each"),
        (lambda o, d, c, r: o[:, :1], r"\(32, 1\), where t \(32,\) is wanted: one number each is wanted"),
        (lambda o, d, c, r: (o[:, 0], o[:, 0]), "both roots, or t and a mask"),
        (lambda o, d, c: o, r"it is <lambda>\(o, d, c\), and is called as intersect_sphere\(origins, directions,"),
        (lambda o, d, c, r: {}["t"], r"it raised KeyError: 't' \(line \d+: "),
    ):
        found = judge_function(CONTRACT["intersect_sphere"], function)
        assert not found.passed
        assert found.error is None
        assert re.search(said, found.sentence), found.sentence


def test_a_mistake_in_some_cases_is_told_by_the_case():
    def one_albedo(points, normals, albedo, to_light, irradiance, sky):
        return CONTRACT["shade"].reference(points, normals, albedo.reshape(len(points), 3), to_light, irradiance, sky)

    found = judge_function(CONTRACT["shade"], one_albedo)
    assert re.fullmatch(r"it raised ValueError: cannot reshape.*\(one albedo for all\)", found.sentence)


def test_a_function_that_writes_into_its_arguments_fails_one_case_that_says_so():
    def greedy(points, normals, albedo, to_light, irradiance, sky):
        made = CONTRACT["shade"].reference(points, normals, albedo, to_light, irradiance, sky)
        normals[...] = sky[...] = 7
        return made

    found = judge_function(CONTRACT["shade"], greedy)
    assert [case.passed for case in found.cases].count(False) == 1
    assert "it changes `normals`, `sky` in place" in found.sentence


def test_a_function_that_keeps_its_rays_by_the_size_of_the_picture_fails_the_case_of_another_camera():
    kept, reference = {}, CONTRACT["back_project"].reference

    def lazy(K, dist, width, height):
        return kept.setdefault((width, height, *dist), reference(K, dist, width, height))

    found = judge_function(CONTRACT["back_project"], lazy)
    assert [case.shows for case in found.cases if not case.passed] == ["another camera of the same size"]


@pytest.mark.parametrize(
    ("faults", "equal", "got", "said"),
    [
        (("no-cosine",), 1, "0.3", ("the cause", f"{MEND} line 7")),
        (("no-cosine",), 2, "0.3", ("line 7", "the cause")),  # likely: another explains it as well
        (("no-spheres",), 1, "0.3", ("line 7", "the cause")),  # says only what is seen
        ((), 0, "0.3", ("line 7",)),
        ((), 0, "", ("the cause", "line 7")),  # it raised an error
    ],
)
def test_the_line_comes_behind_what_is_proved_and_before_what_is_likely(faults, equal, got, said):
    cases = (CaseResult("one", False), CaseResult("another", False))
    made = StageResult("shade", False, 1.0, 1e-5, "", "the cause", (*faults, "other")[:equal],
                       tuple((f, "the cause") for f in faults), "line 7", got=got, cases=cases)  # fmt: skip
    assert made.said == said


@pytest.mark.nightly
def test_check_names_in_a_picture_what_no_variant_has_with_its_number():
    def bright_shadows(scene):
        lit = CONTRACT["render"].reference(scene | {"rung": "lambert"})
        return lit if scene["rung"] == "lambert" else 0.3 * lit + 0.7 * CONTRACT["render"].reference(scene)

    found = judge_function(CONTRACT["render"], bright_shadows)
    assert found.causes == ("shadow-strength",)
    assert found.sentence.startswith("shadows let 30 % of the sun through: ")
    assert "explains" not in found.sentence


def test_check_prints_its_sentence_returns_the_numbers_and_raises_when_told_to(capsys):
    found = raytwin.check("shade", BY_HAND["shade"], raises=True)
    assert capsys.readouterr().out == f"{found}\n"
    assert str(found).startswith("PASS  shade: correct in all 7 cases, to ")
    with pytest.raises(
        AssertionError, match=r"^shade: it returned an array \(24,\), where radiance \(24, 3\) is wanted"
    ):
        raytwin.check("shade", lambda *args: args[0][:, 0], raises=True)
    with pytest.raises(InputError, match=r"got shad \(did you mean shade\?\)"):
        raytwin.check("shad", BY_HAND["shade"])
