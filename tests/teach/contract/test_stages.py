"""The stages' tests: what is correct passes however it is done, and each typical mistake is found and named."""

import inspect
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
        return all(judging.is_right(stage, case, one) for case, one in zip(cases, answer, strict=True))

    def alike(a, b):
        return all(judging._agrees(stage, x, y) for x, y in zip(a, b, strict=True))

    answers = [(v.name, judging.call_stage(stage, v.make(), cases)) for v in stage.variants]
    shown = [(name, answer) for name, answer in answers if not passes(answer)]
    assert {name for name, _ in answers} - {name for name, _ in shown} <= {"too few steps"}
    assert not [(name, one) for name, answer in shown for one in answer if isinstance(one, str)]
    for name, answer in shown:
        names = {other for other, given in shown if alike(given, answer)}
        assert names == {name}, name


OWN_SPHERE = 'own = own & (np.linalg.norm(eye - thing["center"]) > thing["radius"])'


def test_a_planted_mistake_is_the_cause_that_is_told():
    sentence_of = {fault.name: fault.sentence for fault in FAULTS}
    slipped = compose({"intersect_sphere": tracer_with(changes=(("np.sqrt(disc)", "disc"),)).intersect_sphere})
    lit_inside = tracer_with(changes=((OWN_SPHERE, "pass"),)).render  # shown by the last pictures alone
    planted = {
        "hit_points": (slipped.hit_points, "root-missing", sentence_of["root-missing"]),
        "render": (lit_inside, "own-wall", "from inside a sphere its own wall is lit"),
    }
    for name, cause in (
        ("back_project", "tangential-swapped"), ("estimate_pose", "inverse pose"),
        ("intersect_sphere", "t-of-unit-rays"), ("shade", "no-clamp"),
    ):  # fmt: skip
        variant = next(v for v in CONTRACT[name].variants if v.name == cause)
        planted[name] = variant.make(), cause, variant.sentence
    for name, (function, cause, sentence) in planted.items():
        found = judge_function(CONTRACT[name], function, seed=2)
        assert (found.passed, found.causes, sentence in found.sentence) == (False, (cause,), True), name
        assert name != "back_project" or "pixel u = " in found.inputs


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
        (lambda o, d, c, r: (o[:, 0], o[:, 0]), "return t alone"),
        (lambda o, d, c: o, r"it is <lambda>\(o, d, c\), and is called as intersect_sphere\(origins, directions,"),
        (lambda o, d, c, r: {}["t"], r"it raised KeyError: 't' \(line \d+: "),
    ):
        found = judge_function(CONTRACT["intersect_sphere"], function)
        assert not found.passed
        assert found.error is None
        assert re.search(said, found.sentence), found.sentence


def test_what_is_wrong_in_one_case_is_told_by_the_case():
    shade, back_project = CONTRACT["shade"].reference, CONTRACT["back_project"].reference
    kept = {}

    def one_albedo(points, normals, albedo, *light):
        return shade(points, normals, albedo.reshape(len(points), 3), *light)

    def greedy(points, normals, albedo, to_light, irradiance, sky):
        made = shade(points, normals, albedo, to_light, irradiance, sky)
        normals[...] = sky[...] = 7
        return made

    def lazy(K, dist, width, height):
        return kept.setdefault((width, height, *dist), back_project(K, dist, width, height))

    one_albedo.__signature__ = inspect.signature(shade)
    for stage, function, case, said in (
        ("shade", one_albedo, "one albedo for all", r"it raised ValueError: cannot reshape.*\(one albedo for all\)"),
        ("shade", greedy, "surfaces that face the sun, no sky", "it changes `normals`, `sky` in place"),
        ("back_project", lazy, "another camera of the same size", "Fails: another camera of the same size"),
    ):
        found = judge_function(CONTRACT[stage], function)
        assert [one.shows for one in found.cases if not one.passed] == [case]
        assert re.search(said, found.sentence), found.sentence


def test_the_line_comes_behind_what_is_proved_and_before_what_is_likely():
    cases = (CaseResult("one", False), CaseResult("another", False))
    for faults, causes, got, said in (
        (("no-cosine",), ("no-cosine",), "0.3", ("the cause", f"{MEND} line 7")),
        (("no-cosine",), ("no-cosine", "other"), "0.3", ("line 7", "the cause")),  # another explains it as well
        (("no-spheres",), ("no-spheres",), "0.3", ("line 7", "the cause")),  # says only what is seen
        ((), (), "0.3", ("line 7",)),
        ((), (), "", ("the cause", "line 7")),  # it raised an error
    ):
        pairs = tuple((name, "the cause") for name in faults)
        made = StageResult("shade", False, 1.0, 1e-5, "", "the cause", causes, pairs, "line 7", got=got, cases=cases)
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


def test_check_prints_its_sentence_and_returns_the_numbers(capsys):
    found = raytwin.check("shade", BY_HAND["shade"])
    assert capsys.readouterr().out == f"{found}\n"
    assert str(found).startswith("PASS  shade: correct in all 7 cases, to ")
    with pytest.raises(InputError, match=r"got shad \(did you mean shade\?\)"):
        raytwin.check("shad", BY_HAND["shade"])
