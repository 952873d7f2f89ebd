"""The slips that pictures can show, a line each in `slips.tsv`, the least far-fetched first: nobody writes them.

A line is a weight, the form of the textbook's text, the function, what was wrong, what stands there, how many of these
stand before it, and what the slip puts in its place. `tests/measure/slip_classes.py` makes the file.
"""

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zlib import crc32

from raytwin.diagnose.operators import Edit
from raytwin.diagnose.predict import Pipeline, slip
from raytwin.diagnose.textbook import FORMS, FUNCTIONS, Changes

LONG = 70
"""Characters of a change, beyond which its name is a number."""
FILE = Path(__file__).with_name("slips.tsv")


@dataclass(frozen=True)
class Slip:
    """`before`, the text after `nth` others like it, becomes `after`. `operator`: what was wrong, in words."""

    weight: float
    form: str
    function: str
    operator: str
    before: str
    nth: int
    after: str

    @classmethod
    def of(cls, weight: float, form: str, function: str, edit: Edit) -> "Slip | None":
        """The slip that an edit of the function's text is; None where it is not one of an expression."""
        text = text_of(form, function)
        before = ast.get_source_segment(text, edit.old)
        several = isinstance(edit.new, list) and not isinstance(edit.new[0], ast.Pass)
        if not before or "\n" in before or several or edit.also or not isinstance(edit.old, ast.expr | ast.stmt):
            return None
        after = edit.after.replace("\n", " ")
        simple = ast.Name | ast.Constant | ast.Call | ast.Tuple
        if isinstance(edit.new, ast.expr) and not isinstance(edit.new, simple):
            after = f"({after})"
        lines = text.splitlines(keepends=True)
        start = sum(map(len, lines[: edit.line - 1])) + len(
            lines[edit.line - 1].encode()[: edit.old.col_offset].decode()
        )
        return cls(round(weight, 2), form, function, edit.operator, before, text[:start].count(before), after)

    @property
    def line(self) -> tuple[str, str]:
        """The line that it is in: right, and wrong."""
        text, at = self._found()
        begin, end = text.rfind("\n", 0, at) + 1, text.find("\n", at)
        right = text[begin : end if end >= 0 else len(text)]
        return right.strip(), (text[begin:at] + self.after + right[at - begin + len(self.before) :]).strip()

    @property
    def sentence(self) -> str:
        """What a student is told."""
        right, wrong = self.line
        return f"{PLACES[self.function]}: it looks as if you had `{wrong}` where `{right}` is right"

    @property
    def stage(self) -> str:
        """The stage of the catalogue."""
        return STAGE_OF[self.function]

    def _found(self) -> tuple[str, int]:
        text, at = text_of(self.form, self.function), -1
        for _ in range(self.nth + 1):
            at = text.index(self.before, at + 1)
        return text, at

    @property
    def changes(self) -> Changes:
        """The function's whole text, and the same with the slip."""
        text, at = self._found()
        return ((text_of("", self.function), text[:at] + self.after + text[at + len(self.before) :]),)

    @property
    def name(self) -> str:
        """Short, and without the bar that parts causes on the class page."""
        place = f" (place {self.nth + 1})" if self.nth else ""
        change = f"{self.before} -> {self.after}{place}{' in ' + self.form if self.form else ''}".replace("|", "or")
        return f"slip-in-{self.function}: {change if len(change) <= LONG else f'{crc32(change.encode()):08x}'}"

    @property
    def way(self) -> Pipeline:
        """The mistake."""
        beside = (slip(other, *changes) for other, changes in FORMS_BESIDE.get(self.form, ()) if other != self.function)
        return (*slip(self.function, *self.changes), *(step for way in beside for step in way))


@cache
def text_of(form: str, function: str) -> str:
    """The function's text in this form; in the textbook's own where that is empty."""
    text = FUNCTIONS[function].rstrip("\n")
    for old, new in FORMS[form] if form else ():
        text = text.replace(old, new)
    return text


def forms_of(function: str) -> Iterator[tuple[str, str]]:
    """(form, text): the textbook's own, and what is another text of this function or of one that is put beside it."""
    own = text_of("", function)
    yield "", own
    for form in FORMS:
        text = text_of(form, function)
        if text != own or function in SHOWN_BY.get(form, ()):
            yield form, text


SHOWN_BY: dict[str, tuple[str, ...]] = {"rays of any length": ("intersect_sphere", "nearest")}
"""Form -> functions in which slips show other pictures because of it."""
FORMS_BESIDE: dict[str, tuple[tuple[str, Changes], ...]] = {
    "rays of any length": (("through", FORMS["rays of any length"]),)
}
"""Form -> the function that it changes, beside the one with the slip."""


def write(rows: Sequence[Slip]) -> None:
    """Write the file."""
    lines = ["\t".join(map(str, (r.weight, r.form, r.function, r.operator, r.before, r.nth, r.after))) for r in rows]
    FILE.write_text("\n".join([*lines, ""]), encoding="utf-8")


@cache
def read() -> tuple[Slip, ...]:
    """All of the file's slips."""
    made = []
    for line in FILE.read_text(encoding="utf-8").splitlines():
        weight, form, function, operator, before, nth, after = line.split("\t")
        made.append(Slip(float(weight), form, function, operator, before, int(nth), after))
    return tuple(made)


PLACES = {
    "pixel": "where pixels are counted",
    "undistort": "undoing the lens's distortion",
    "through": "from the pixel to the ray",
    "to_board": "from the camera's frame to the board's",
    "intersect_sphere": "the sphere's quadratic",
    "intersect_plane": "where a ray meets a rectangle",
    "intersect_all": "going through all objects",
    "nearest": "choosing the nearest hit",
    "met": "the points that rays meet",
    "normals_at": "the normals",
    "sun_visible": "the shadow test",
    "shade": "shading",
    "radiance": "putting light and background together",
}
"""Function -> what it does, for a sentence."""
STAGE_OF = {
    **dict.fromkeys(("pixel", "undistort", "through", "to_board"), "camera"),
    **dict.fromkeys(("intersect_sphere", "intersect_plane", "met"), "solver"),
    **dict.fromkeys(("intersect_all", "nearest"), "order"),
    "normals_at": "normals",
    "sun_visible": "shadow",
    "shade": "light",
    "radiance": "light",
}
"""Function -> stage of the catalogue."""
