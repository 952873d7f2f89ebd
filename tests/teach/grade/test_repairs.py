"""A submission that is graded gets the line to look at, in its sandbox, as far as the rubric's hints go."""

from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from starter_submissions import PLAIN, SLIPS

from raytwin.explain.repair import Repair
from raytwin.parallel import Workers
from raytwin.scene import Tolerance
from raytwin.teach.grade.check_picture import _compare_points
from raytwin.teach.grade.class_run import jobs_of, run
from raytwin.teach.grade.result import Marked, Result
from raytwin.teach.grade.sandboxed_repair import LineSearch, _with_hint
from raytwin.teach.sandbox.sandbox import Code

SOURCE = next(s.source for s in SLIPS if s.label == "sum of everything")
LIAR = "\n\nimport marshal\nmarshal.loads = lambda b: compile('raise SystemExit', '', 'exec')\n"
"""Answers nonsense for its repairs."""
LONG = SOURCE + "# " + "x" * 100_000 + "\n"
"""Too long to be read for a line."""


SPHERES = '[[exercises]]\nname = "spheres"\nstage = "intersect_sphere"\npoints = 20\n'
RAYS = '[[exercises]]\nname = "rays"\nstage = "back_project"\npoints = 20\n'
POINTS = '[[exercises]]\nname = "points"\nstage = "hit_points"\ndrawn = 1\npoints = 20\n'


def graded(folder, rubric, text):
    (folder / "r.toml").write_text(f'title = "t"\nhints = 3\n{rubric}')
    (folder / "a.py").write_text(text)
    (result,) = run(jobs_of(folder / "a.py", folder / "r.toml"), folder / "out", Workers())
    return result


@pytest.mark.nightly
@pytest.mark.parametrize(("text", "told"), [(SOURCE, True), (SOURCE + LIAR, False), (LONG, False)])
def test_the_line_of_a_slip_is_told_where_the_submission_lets_it_be_found(tmp_path, text, told):
    (exercise,) = graded(tmp_path, SPHERES, text).exercises
    assert exercise.status == "fail"
    fix = "in place of `c = (oc * oc).sum() - radius ** 2` makes everything correct"
    for said in ("line 39", fix):
        assert any(said in sentence for sentence in exercise.sentences) == told, exercise.sentences


@pytest.mark.nightly
def test_a_function_that_changes_its_arguments_loses_one_case_and_is_told_the_line(tmp_path):
    text = PLAIN.replace("    oc = origins - center\n", "    origins -= center\n    oc = origins\n")
    (exercise,) = graded(tmp_path, SPHERES, text).exercises
    assert [part.passed for part in exercise.parts].count(False) == 1
    assert any("`origins` in place" in said for said in exercise.sentences), exercise.sentences
    assert any("`origins = origins - center` in place of `origins -= center`" in said for said in exercise.sentences)


OWN_RAYS = PLAIN.replace("def back_project", "def own_rays").partition("def own_rays")[2].partition("def estimate")[0]
COPIED = PLAIN.replace("tx = 2*p1*x*y", "tx = 2*p2*x*y").replace("rays = back_project", "rays = own_rays")
COPIED += "\n\ndef own_rays" + OWN_RAYS
"""Its pictures do not call the function that is tested, but what is wrong in it."""


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("text", "of", "line", "told"),
    [(SOURCE, SPHERES, "line 39", "Caused by `intersect_sphere`"), (COPIED, RAYS, "line 12", "line 12")],
)
def test_a_change_that_makes_a_function_right_explains_the_pictures(tmp_path, monkeypatch, text, of, line, told):
    """No cause of the pictures is looked for; the function is its own again after pictures with a correct one."""
    monkeypatch.setattr("raytwin.teach.grade.marks.diagnose", lambda *_, **__: pytest.fail("looked at"))
    result = graded(tmp_path, of + POINTS, text)
    function, points = result.exercises
    assert (result.problem, function.sureness) == ("", "proved")
    assert any(line in sentence for sentence in function.sentences), function.sentences
    assert told in points.sentences[0]


def wrong_image(*faults):
    named = tuple((fault, "the cause") for fault in faults)
    return Marked("image", "render", "fail", 0, 1, sentences=("the cause", "where"), faults=named, sureness="proved")


def test_whether_the_line_or_the_cause_comes_first_and_how_sure_it_is():
    line = Repair("", 7, "the sign is wrong", "-a", "a")
    for faults, place in ((("nothing-met",), 0), (("no-planes",), 0), (("endless-planes",), 1)):  # two say what is seen
        made = _with_hint(wrong_image(*faults), line, 2)
        assert [k for k, sentence in enumerate(made.sentences) if "line 7" in sentence] == [place], faults
    for faults, sure, said in (
        ((), True, "proved"), ((), False, "likely"), (("shadow-offset",), True, "likely"),
        (("nothing-met",), True, "proved"),
    ):  # fmt: skip
        image = msgspec.structs.replace(wrong_image(*faults), sureness="likely" if faults else "")
        made = _with_hint(image, replace(line, sure=sure), 2)
        assert ("line 7" in made.sentences[0], made.sureness) == (True, said), faults


def test_a_picture_is_repaired_for_sure_where_no_other_picture_stays_wrong(monkeypatch):
    for other in (True, False):
        repaired = {"hit_points": Repair("", 7, "the sign is wrong", "-a", "a")}
        repaired |= {"render": Repair("", 8, "", "", "")} if other else {}
        monkeypatch.setattr(
            "raytwin.teach.grade.sandboxed_repair._repair", lambda stage, *_, found=repaired: found.get(stage.name)
        )
        line_search = LineSearch(SimpleNamespace(hints=2), Code("a", "f = 1"))
        child = SimpleNamespace(functions=("hit_points", "render"), spent=0.0)
        tried = [msgspec.structs.replace(wrong_image(), stage=stage) for stage in ("hit_points", "render")]
        line_search._repair(tried, (), (), (), (), SimpleNamespace(child=child))
        assert line_search.found["hit_points"].sure == other


def test_what_follows_from_another_function_is_looked_at_last():
    follows = msgspec.structs.replace(wrong_image(), status="error", because=("shade",))
    result = Result("a", "", "", (follows, wrong_image("no-clamp")))
    assert result.first_problem == "the cause"


def test_points_of_rays_that_meet_nothing_are_nan():
    right = np.zeros((4, 5, 3)) + np.arange(5)[:, None]
    right[:2] = np.nan
    for miss, passes in ((np.nan, True), (np.inf, False), (0.0, False)):
        assert _compare_points(right, np.where(np.isnan(right), miss, right), Tolerance())[0] == passes, miss


@pytest.mark.nightly
def test_a_text_that_is_nested_too_deeply_is_graded(tmp_path):
    """As deep as Python's own reader allows."""
    deep = "    return albedo * (n * irradiance + sky * 1.3)" + " + 0 * n" * 800
    head = "def shade(points, normals, albedo, to_light, irradiance, sky):\n    n = abs(normals @ to_light)[:, None]\n"
    result = graded(tmp_path, '[[exercises]]\nstage = "shade"\npoints = 20\n', head + deep)
    assert (result.problem, result.exercises[0].status) == ("", "fail")
