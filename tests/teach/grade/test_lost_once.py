"""Points are arithmetic with what is stored: a mistake costs them once, and a rubric may change."""

import pytest

from raytwin.teach.grade.points import with_points
from raytwin.teach.grade.result import Again, Marked, MarkedPart, Result
from raytwin.teach.grade.rubric import Exercise, Rubric

CREDIT = ((0.1, 0.5), (1.0, 0.5))
EXERCISES = (
    Exercise("intersect_sphere", 20, "spheres"),
    Exercise("hit_points", 10, "points", drawn=1),
    Exercise("render", 15, "image", scenes=("single",), credit=CREDIT),
    Exercise("render", 30, "shadows", drawn=2),
)


def rubric(**more) -> Rubric:
    return Rubric("t", EXERCISES, **({"follow_through": 1.0} | more))


def wrong(name: str, *mistakes: str, parts: str = "x", again: Again | None = None) -> Marked:
    """An exercise whose parts are wrong (x) or not (o), by these mistakes."""
    stage = next(e.stage for e in EXERCISES if e.name == name)
    some = tuple(MarkedPart("", p == "o", error=0.0 if p == "o" else 0.5, wrong=0.5, seconds=1.0,
                      again=None if p == "o" else again) for p in parts)  # fmt: skip
    return Marked(name, stage, "fail" if "x" in parts else "pass", parts=some, mistakes=mistakes)


def result(*exercises: Marked) -> Result:
    of = {m.name: m for m in exercises}
    return Result("a", "k", "t", tuple(of.get(e.name) or wrong(e.name, parts="oo") for e in EXERCISES))


def points(made: Result) -> list[float]:
    return [e.points for e in made.exercises]


def test_a_mistake_in_a_helper_is_paid_for_once_by_the_function():
    helper = "line 3: the sign is wrong"
    found = result(wrong("spheres", helper, "far-root", parts="oox"), wrong("points", helper),
                   wrong("image", helper), wrong("shadows", helper, parts="ox"))  # fmt: skip
    made = with_points(found, rubric())
    assert points(made) == [pytest.approx(40 / 3, abs=1e-3), 10, 15, 30]
    assert [e.followed for e in made.exercises] == [0, 10, 7.5, 15]
    assert [e.follows for e in made.exercises] == [False, True, True, True]
    assert made.exercises[3].said == ("The same mistake in spheres has cost you points already, so you keep 15 here.",)
    assert points(with_points(found, rubric(follow_through=0.5))) == [pytest.approx(40 / 3, abs=1e-3), 5, 7.5, 22.5]
    assert points(with_points(found, rubric(follow_through=0.0))) == [pytest.approx(40 / 3, abs=1e-3), 0, 7.5, 15]


def test_of_pictures_alone_the_one_that_loses_most_pays():
    made = with_points(result(wrong("image", "gamma"), wrong("shadows", "gamma")), rubric())
    assert points(made) == [20, 10, 15, 0]
    assert [e.same_as for e in made.exercises] == ["", "", "shadows", ""]


def test_mistakes_that_share_no_explanation_are_paid_for_each():
    made = with_points(result(wrong("spheres", "a"), wrong("image", "b"), wrong("shadows")), rubric())
    assert points(made) == [0, 10, 7.5, 0]
    joined = with_points(result(wrong("spheres", "a"), wrong("image", "b"), wrong("shadows", "b", "a")), rubric())
    assert points(joined) == [0, 10, 15, 30]


def test_what_is_correct_with_correct_functions_keeps_the_share_that_is_their_own():
    found = result(wrong("spheres"), wrong("shadows", parts="xx", again=Again(True, 0.0, 0.0, 2 / 3)))
    assert points(with_points(found, rubric())) == [0, 10, 15, pytest.approx(20, abs=1e-4)]
    still = result(wrong("spheres"), wrong("image", again=Again(False, 0.5, 0.5)))
    assert with_points(still, rubric()).exercises[2].followed == 0


def test_marking_twice_is_marking_once_and_a_result_of_other_exercises_stays():
    found = result(wrong("spheres", "a", parts="ox"), wrong("shadows", "a"))
    once = with_points(found, rubric())
    assert with_points(once, rubric()) == once
    assert with_points(with_points(found, rubric(follow_through=0.2)), rubric()) == once
    broken = Result("a", "k", "", (), problem="the grader's own fault", grader_fault=True)
    assert with_points(broken, rubric()) == broken
