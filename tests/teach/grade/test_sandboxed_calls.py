"""What a submission's answers become before they are compared: pictures made of parts, arrays of another shape."""

import numpy as np
import pytest
import submitted_tracers as tracers

from raytwin.renderers.scene_exchange import as_scene
from raytwin.scene import Tolerance
from raytwin.teach.contract.loading import arrays_of, is_unwritten
from raytwin.teach.contract.stage_table import CONTRACT
from raytwin.teach.grade.questions import _picture_question
from raytwin.teach.grade.rubric import Exercise
from raytwin.teach.grade.sandboxed_calls import ask
from raytwin.teach.sandbox.sandbox import Answer

EXERCISE = Exercise("render", 10, name="image", scenes=("three spheres",), drawn=1)


@pytest.fixture(scope="module")
def question():
    """A picture of spheres and rectangles with shadows, 40 x 30 pixels, and how to ask for it."""
    case = CONTRACT["render"].cases(0)[2]
    scene = as_scene(case.args[0] | {"name": "three spheres"})
    return lambda: _picture_question(EXERCISE, scene, case.expected[0], Tolerance())


class Here:
    """A sandbox that is none: the functions of a text, called in this process."""

    def __init__(self, text: str) -> None:
        exec(text, space := {})
        self._space = {k: v for k, v in space.items() if k in CONTRACT and callable(v) and not is_unwritten(v)}
        self.functions = tuple(self._space)

    def call(self, name, *arguments):
        if name not in self.functions:
            return Answer(problem=f"{name} is not written", sort="missing")
        try:
            return Answer(arrays_of(self._space[name](*arguments)), 0.25)
        except ValueError as error:
            return Answer(problem=f"ValueError: {error}", sort="error")


PARTS = tracers.RIGHT.replace("def render", "def own")
"""A tracer without a function for the whole."""
RETURNED = "\nright = intersect_sphere\ndef intersect_sphere(o, d, c, r):\n    t = right(o, d, c, r)\n    return "


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (PARTS, ""),
        (PARTS + "\ndef render(scene):\n    raise NotImplementedError\n", ""),
        (PARTS.replace("def shade", "def shade_"), "render is not written"),
        (PARTS.replace("np.where(hit, disc, 0)", "np.where(hit, disc[:5], 0)"), "intersect_sphere: ValueError"),
        (PARTS + RETURNED + "t, t, t", "intersect_sphere: it returned 3 arrays, where one is wanted"),
        (PARTS + RETURNED + "()", "intersect_sphere: it returned 0 arrays"),
        (PARTS + RETURNED + "t[:, None]", "where (1200,) is wanted"),  # would be 468 x 468 in the grader
        (PARTS + RETURNED + "t[:5]", "where (1200,) is wanted"),
        # The first bytes of an 8-bit PNG beside a picture would grant half a step of 8 bits to each value.
        ("import numpy as np\ndef render(s): return 1.0, np.frombuffer(b'\\x89PNG' + bytes(22), 'u1')", "2 arrays"),
    ],
)  # fmt: skip
def test_a_picture_is_the_submissions_own_or_made_of_its_parts_or_refused_in_words(question, text, said):
    asked = question()
    ask(asked, Here(text), "python")
    assert said in asked.answer.problem
    if said:
        assert not asked.answer.arrays
    else:
        off = np.abs(asked.answer.arrays[0] - asked.case.expected[0]).max(axis=-1)
        assert (off > 1e-9).mean() < 0.01  # an outline's pixel may go either way
        assert asked.answer.seconds > 0.25
        assert "is made of your back_project and intersect_sphere and shade, the rest is ours" in asked.made_of
