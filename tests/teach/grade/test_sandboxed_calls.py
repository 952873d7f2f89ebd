"""What a submission's answers become before they are compared."""

import numpy as np
import pytest

from raytwin.renderers.scene_exchange import as_scene
from raytwin.scene import Tolerance
from raytwin.teach.contract.stage_table import CONTRACT
from raytwin.teach.grade.marks import marked
from raytwin.teach.grade.points import with_points
from raytwin.teach.grade.questions import _picture_question
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import Exercise, Rubric, Speed
from raytwin.teach.grade.sandboxed_calls import ask
from raytwin.teach.sandbox.sandbox import Answer, Code

EXERCISE = Exercise("render", 10, name="image", scenes=("three spheres",), drawn=1)


@pytest.fixture(scope="module")
def question():
    """A picture of three spheres with shadows, 26 x 18 pixels, and how to ask for it."""
    case = CONTRACT["render"].cases(0)[2]
    scene = as_scene(case.args[0] | {"name": "three spheres"})
    return lambda: _picture_question(EXERCISE, scene, case.expected[0], Tolerance())


class Here:
    """A sandbox that is none: it answers with these arrays."""

    def __init__(self, *arrays: np.ndarray) -> None:
        self.arrays = arrays

    def call(self, name, scene):
        return Answer(self.arrays, 0.25)


def test_a_function_gives_one_array_and_a_program_may_add_the_format_of_its_image(question):
    """The first bytes of an 8-bit PNG beside a picture would grant half a step of 8 bits to each value."""
    picture, png = np.ones((18, 26, 3)), np.frombuffer(b"\x89PNG" + bytes(22), "u1")
    for arrays, kind, said in (
        ((picture,), "python", ""),
        ((picture, png), "images", ""),
        ((picture, png), "python", "it returned 2 arrays, where one is wanted"),
        ((), "python", "it returned 0 arrays"),
    ):
        asked = question()
        ask(asked, Here(*arrays), kind)
        assert said in asked.answer.problem
        assert len(asked.answer.arrays) == (0 if said else len(arrays))


def test_seconds_are_those_of_drawn_scenes_since_a_named_one_may_be_stored(question):
    asked = [question(), question()]
    for one, seconds in zip(asked, (0.001, 7.0), strict=True):
        one.answer = Answer(one.case.expected, seconds)
    rubric = Rubric("t", (EXERCISE,), speed=Speed("image", bonus=2, fast=0.1, slow=10.0))
    result = with_points(marked(Result("a", "k", "t", ()), rubric, asked, "", Code()), rubric)
    assert result.exercises[0].status == "pass"
    assert result.speed == (("image", 7.0, 0.0),)
    assert result.bonus == rubric.speed.earned(7.0) < 0.2
