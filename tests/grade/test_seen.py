"""What a class has got wrong is counted, and the next class's mistakes are looked for in that order."""

from functools import partial

import pytest

from raytwin.diagnose.catalogue import FAULTS
from raytwin.diagnose.explanation import Cause
from raytwin.diagnose.hypothesis_search import Hypothesis, ranked
from raytwin.diagnose.repair import candidates
from raytwin.errors import InputError
from raytwin.grade.result import Marked, Result
from raytwin.grade.rubric import read_rubric
from raytwin.grade.seen import write_seen

RUBRIC = 'title = "t"\n[[exercises]]\nstage = "shade"\npoints = 10\n'
wrong = partial(Marked, "shade", "shade", "fail", 0.0, 10.0, "visible", "", 1e-6)


def test_proved_mistakes_are_counted_once_a_student_and_read_beside_the_next_rubric(tmp_path):
    pi, guess = (("pi-missing", "no pi"),), (("grey", "no colours"),)
    repaired = wrong(sureness="proved", repair="the sign is wrong")
    results = [
        Result("ann", "1", "t", (wrong(sureness="proved", faults=pi), wrong(sureness="proved", faults=pi))),
        Result("bob", "2", "t", (wrong(sureness="named", faults=pi), repaired)),
        Result("cy", "3", "t", (wrong(sureness="likely", faults=guess),)),
    ]
    rubric = tmp_path / "r.toml"
    rubric.write_text(RUBRIC)
    write_seen(results, read_rubric(rubric), tmp_path)
    assert read_rubric(rubric).seen == {"pi-missing": 2, "the sign is wrong": 1}
    write_seen(results[:1], read_rubric(rubric), tmp_path)  # the next class
    assert read_rubric(rubric).seen == {"pi-missing": 3, "the sign is wrong": 1}
    (tmp_path / "seen.toml").write_text('[seen]\n"pi-missing" = -1\n')
    with pytest.raises(InputError, match="seen"):
        read_rubric(rubric)


def test_of_mistakes_that_explain_as_well_the_one_made_more_often_comes_first():
    first, second = FAULTS[:2]
    guesses = [Hypothesis((Cause(f.name, f.stage, ""),), (), cost=1.0) for f in (first, second)]
    for seen, order in (({}, [first, second]), ({second.name: 1}, [second, first])):
        assert [g.causes[0].name for g in ranked(guesses, FAULTS, 0.1, seen)] == [f.name for f in order]
    guesses[0] = Hypothesis(guesses[0].causes, (), cost=0.5)
    assert ranked(guesses, FAULTS, 0.1, {second.name: 9})[0].causes[0].name == first.name


def test_repairs_of_a_common_kind_are_tried_earlier():
    text = "def f(x, y):\n    return x + y / 2\n"

    def place(seen):
        operators = [c.edit.operator for c in candidates([("", text)], "f", (), seen)]
        return operators.index("half a step is off")

    assert place({"half a step is off": 200}) == 0 < place({})
