"""A student's page: what to do first, then each failure with its cause, its lines and its pictures.

The instructor's lies in the class and shares its scripts. The one that is handed out is whole in itself, and says
nothing of the class, of scenes that are not shown, or of the machine that graded.
"""

import json
import re
import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup, escape
from msgspec.structs import replace

from raytwin.show import viewer
from raytwin.show.page import asset, render_page
from raytwin.teach.grade.result import Marked, Picture, Result
from raytwin.teach.grade.rubric import PICTURES, Rubric

SURENESS = {
    "proved": "proved",
    "likely": "likely",
    "": "cause unknown",
}
"""How sure a cause is, from the surest, in words."""
STATUS = {
    "pass": ("✓", "passes"),
    "fail": ("✗", "wrong values"),
    "follows": ("↪", "wrong by a mistake that is counted elsewhere"),
    "error": ("!", "crashed or returned no array"),
    "missing": ("–", "not written"),
    "limit": ("◷", "too much time, memory or output"),
    "broken": ("☇", "the process ended"),
}
"""What became of an exercise -> a sign that needs no colour, and what it means."""


def seen_as(e: Marked) -> str:
    """A key of STATUS."""
    return "follows" if e.follows else e.status


def of_points(points: float) -> str:
    """
    >>> of_points(12.0), of_points(3.25)
    ('12', '3.25')
    """
    return f"{points:.2f}".rstrip("0").rstrip(".")


def next_step(e: Marked | None) -> str:
    """What a student does about an exercise, or a file, after reading what is wrong."""
    if e is None:
        return "Run the file yourself until it loads without an error, then hand in again."
    if e.follows:
        return ""
    if e.status == "missing":
        return f"Write {e.stage}; the starter file says what it takes and returns."
    if e.status == "limit":
        return "Find the loop that does not end, or do all rays at once, then hand in again."
    if e.status in ("error", "broken"):
        return f"Run {e.stage} yourself until it returns an array without an error, then hand in again."
    change = "Change that" if e.faults or e.sureness else "Find out what differs there"
    if e.stage in PICTURES:
        return f"{change}, and compare your picture with the expected one below."
    return f'{change}, then test it alone: raytwin.check("{e.stage}", {e.stage}).'


def as_code(text: str) -> Markup:
    """What stands between backticks, as code.

    >>> as_code("a `b < c`")
    Markup('a <code>b &lt; c</code>')
    """
    return Markup(re.sub(r"`([^`\n]+)`", r"<code>\1</code>", str(escape(text))))


def student_page(result: Result, rubric: Rubric, handed_out: bool = False) -> str:
    """The page; `handed_out`: of what `for_student` leaves, with scripts and styles in it."""
    files: tuple[tuple[str, ...], ...] = ()
    if handed_out:
        files = (viewer.style() + "\n", "grade.css"), (viewer.script(), "grade.js")
        result = for_student(result, rubric)
    return render_page(
        "grade_student.html.j2", *files, r=result, rubric=rubric, exercises=_ordered(result), handed_out=handed_out,
        views=[_view(p) for p in result.pictures], of_points=of_points, seen_as=seen_as, as_code=as_code,
        caused_by=caused_by, next_step=next_step, STATUS=STATUS, SURENESS=SURENESS, PICTURES=PICTURES,
    )  # fmt: skip


def _ordered(result: Result) -> list[Marked]:
    """What to look at first comes first, then by lost points; what passes, and last what is not written."""
    late = {"pass": 1, "missing": 2}
    first = result.worst
    return sorted(result.exercises, key=lambda e: (late.get(e.status, 0), e is not first, e.follows, e.points - e.of))


def caused_by(e: Marked, exercises: Collection[Marked]) -> list[str]:
    """The exercises that are wrong by this one's mistake."""
    return [other.name for other in exercises if other.same_as == e.name or e.stage in other.because]


def _view(picture: Picture) -> dict[str, Any]:
    """What the viewer mounts: the picture's planes and how to show them; empty where there is a small one alone."""
    view: dict[str, Any] = {
        "exercise": picture.exercise, "shows": picture.shows, "thumb": picture.thumb, "full": picture.full, "data": "",
    }  # fmt: skip
    if picture.planes:
        panes = [
            {"key": "reference", "kind": "radiance", "title": "Expected", "tab": "expected"},
            {"key": "test", "kind": "radiance", "title": "Got", "tab": "got"},
            {"key": "map", "kind": "map", "title": "Difference", "tab": "difference"},
        ]
        more = {
            "names": {"test": "got", "reference": "expected"},
            "panes": [pane | {"alt": f"{pane['title']}, {picture.shows}"} for pane in panes],
            "objects": [], "noisy": False, "places": [], "marks": [], "start": None, "address": False,
            "bound": {"share": picture.share, "scale": picture.scale, "held": True}, "exposure": picture.stops,
        }  # fmt: skip
        # "<" would end the element that holds it.
        view["data"] = json.dumps(json.loads(picture.planes) | more).replace("<", "\\u003c")
    return view


# ------------------------------------------------------------------------------------------ what is handed out

NOT_GRADED = "The grader failed, which is not your doing: your submission will be graded again."
FOLDERS = re.compile(r"(?<![\w.)\]])(?:[A-Za-z]:|~|\.{1,2})?(?:[/\\][^\s/\\'\"`:;,()<>|]+)+[/\\](?=[^\s/\\])")
"""A path but for its last name."""


def for_student(result: Result, rubric: Rubric) -> Result:
    """What a student may know: the exercises that are visible, without scenes of others, without any folder."""
    if result.grader_fault:
        return Result(result.student, "", rubric.title, (), problem=NOT_GRADED)
    hidden = unshown(result)
    shown = [e for e in result.exercises if e.visibility == "visible"]
    names = {e.name for e in shown}
    shown = [replace(e, same_as=e.same_as if e.same_as in names else e.same_as and "another exercise") for e in shown]
    pictures = tuple(p for p in result.pictures if p.exercise in names)
    places = [str(Path.cwd()), str(Path.home()), tempfile.gettempdir()]

    def told(value: Any) -> Any:
        if isinstance(value, str):
            for place in places:
                value = value.replace(f"{place}/", "/") if len(place) > 1 else value
            return without(hidden, FOLDERS.sub("", value))
        if isinstance(value, dict):
            return {key: told(one) for key, one in value.items()}
        return list(map(told, value)) if isinstance(value, list | tuple) else value

    left = replace(result, exercises=tuple(shown), pictures=(), open_locks=(), seed=0, key="")
    left = msgspec.convert(told(msgspec.to_builtins(left)), Result)
    exercises = tuple(replace(e, code=own.code) for e, own in zip(left.exercises, shown, strict=True))
    return replace(left, student=result.student, exercises=exercises, pictures=pictures)


def unshown(result: Result) -> frozenset[str]:
    """Return the names of the scenes that only exercises which are not visible have.

    One cause is looked for in all pictures of a submission, so its words may name any of them.
    """
    named: dict[bool, set[str]] = {True: set(), False: set()}
    for e in result.exercises:
        if e.stage in PICTURES:
            named[e.visibility == "visible"] |= {p.shows.partition(", ")[0] for p in e.parts}
    return frozenset(named[False] - named[True])


def without(names: Collection[str], text: str) -> str:
    """Return the text with other words for these scenes."""
    for name in sorted(names, key=len, reverse=True):
        text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", "a scene that is not shown", text)
    return text


def styles() -> str:
    """Of all pages of a class."""
    return asset("report.css") + viewer.style() + asset("grade.css")
