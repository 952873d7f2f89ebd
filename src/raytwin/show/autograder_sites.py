"""What came of one submission as autograders take it: Gradescope's results.json, JUnit XML."""

import json
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from raytwin.safe_write import write_text
from raytwin.show.junit import Problem, add_case, legal, write_suites
from raytwin.show.student_page import STATUS, SURENESS, next_step, of_points, unshown, without
from raytwin.teach.grade.result import Marked, Picture, Result
from raytwin.teach.grade.rubric import Rubric

MOST_BYTES = 950_000
"""Bytes of a results.json: Gradescope takes one megabyte."""
MOST_TEXT = 4000
"""Characters per field: the rest is cut."""


def write_gradescope(result: Result, rubric: Rubric, path: str | os.PathLike[str]) -> None:
    """Text first; one small picture for each test that fails; the last ones go where there is no room for all."""
    made = gradescope(result, rubric)
    for test in reversed(made["tests"]):
        if len(json.dumps(made)) <= MOST_BYTES:
            break
        if test["output_format"] == "html":
            test["output"] = re.sub(
                r"<p>Expected.*$", "<p>(no room for its picture)</p>", test["output"], flags=re.DOTALL
            )
    write_text(Path(path), json.dumps(made, indent=1, allow_nan=False) + "\n")


def gradescope(result: Result, rubric: Rubric) -> dict[str, Any]:
    """https://gradescope-autograders.readthedocs.io/en/latest/specs/"""
    tests, hidden = [], unshown(result)
    for number, e in enumerate(result.exercises, start=1):
        picture = _picture(result, e)
        text = "\n".join(_lines(e, hidden))
        test: dict[str, Any] = {
            "name": e.name,
            "number": str(number),
            "score": e.points,
            "max_score": e.of,
            "status": "passed" if e.status == "pass" else "failed",
            "visibility": e.visibility,
            "output": text,
            "output_format": "text",
        }
        if picture is not None:
            test |= {"output": _html(text, picture), "output_format": "html"}
        tests.append(test)
    made: dict[str, Any] = {
        "score": result.points,
        "execution_time": max(1, round(result.seconds)),
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "output": result.problem or _sum_shown(result),
        "output_format": "text",
        "tests": tests,
        "extra_data": {"key": result.key, "open_locks": list(result.open_locks)},
    }
    return made


def _sum_shown(result: Result) -> str:
    """In words; what is shown later, or never, is not given away by a sum."""
    shown = [e for e in result.exercises if e.visibility == "visible"]
    points, of = sum(e.points for e in shown), sum(e.of for e in shown)
    more = "" if len(shown) == len(result.exercises) else ", of the exercises that are shown now"
    return f"{of_points(points)} of {of_points(of)} points{more}"


def write_grade_junit(results: Sequence[Result], path: str | os.PathLike[str]) -> None:
    """A suite a student, a case an exercise: points stand in a property, since JUnit has no place for them."""
    root = ET.Element("testsuites")
    for r in results:
        bad = [e for e in r.exercises if e.status != "pass"]
        failures = sum(e.status == "fail" for e in bad)
        about = {"tests": str(len(r.exercises)), "failures": str(failures), "errors": str(len(bad) - failures)}
        suite = ET.SubElement(root, "testsuite", {"name": legal(r.student), "time": f"{r.seconds:.3f}"} | about)
        properties = ET.SubElement(suite, "properties")
        for name, value in (("points", of_points(r.points)), ("of", of_points(r.of)), ("problem", legal(r.problem))):
            ET.SubElement(properties, "property", {"name": name, "value": value})
        for e in r.exercises:
            message = e.sentences[0] if e.sentences else STATUS[e.status][1]
            element = "failure" if e.status == "fail" else "error"
            problem = Problem(element, message, e.status, "\n".join(_lines(e))) if e in bad else None
            add_case(suite, e.name, r.student, sum(p.seconds for p in e.parts), problem)
    write_suites(root, path)


def _lines(e: Marked, hidden: Collection[str] = ()) -> list[str]:
    """What a student reads: the sentence, then numbers, then which cases pass.

    `hidden`: scenes whose names a visible exercise keeps to itself.
    """
    lines = [without(hidden, text) for text in e.said] if e.visibility == "visible" else [*e.said]
    if lines and e.sureness:
        lines[0] += f" ({SURENESS[e.sureness]})"
    if e.status != "pass":
        lines.append(next_step(e))
    if e.expected and e.status != "pass":
        lines += [e.inputs, f"expected {e.expected}", f"got      {e.got}"]
    for p in e.parts:
        error = "" if p.error is None or p.passed or e.judged_by else f", error {p.error:.3g} {e.unit}"
        problem = f": {p.problem}" if p.problem and p.problem not in e.sentences else ""
        lines.append(f"{'✓' if p.passed else '✗'} {p.shows}{error}{problem}")
    text = "\n".join(line for line in lines if line)
    return text[:MOST_TEXT].splitlines()


def _picture(result: Result, e: Marked) -> Picture | None:
    """The first is the worst."""
    return next((p for p in result.pictures if p.exercise == e.name), None)


def _html(text: str, picture: Picture) -> str:
    from html import escape

    shown = f'<img src="{picture.thumb}" alt="expected, got, difference: {escape(picture.shows, quote=True)}">'
    return f"<pre>{escape(text)}</pre><p>Expected, got, difference: {escape(picture.shows)}</p>{shown}"


def write_unfinished(path: Path) -> None:
    """What Gradescope finds if the grader does not come to its end."""
    text = "Grading did not finish: it took too much time or memory. Hand in again, or tell your instructor."
    write_text(path, json.dumps({"score": 0, "output": text, "output_format": "text", "visibility": "visible"}))
