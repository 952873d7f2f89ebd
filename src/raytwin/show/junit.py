"""JUnit XML: what CI servers read. One test case per comparison; JUnit has no place for scores."""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import NamedTuple

from raytwin.compare import Report
from raytwin.errors import InputError
from raytwin.safe_write import write_text


class Case(NamedTuple):
    """`name` of the test, `group` it belongs to, and what came of it; `output` is shown with it."""

    name: str
    group: str
    outcome: Report | InputError
    output: str = ""


class Problem(NamedTuple):
    """What is wrong with a test: `element` is "failure" or "error"."""

    element: str
    message: str
    kind: str
    text: str = ""


def write_junit(cases: Iterable[Case], path: str | os.PathLike[str]) -> None:
    """A failed comparison is a `failure` with its reasons; an undecided one and an InputError are an `error`."""
    cases = list(cases)
    problems = [_problem(c.outcome) for c in cases]
    kinds = [problem.element if problem else "" for problem in problems]
    seconds = [sum(c.outcome.seconds.values()) if isinstance(c.outcome, Report) else 0.0 for c in cases]
    totals = {
        "tests": str(len(cases)), "failures": str(kinds.count("failure")), "errors": str(kinds.count("error")),
        "time": f"{sum(seconds):.3f}",
    }  # fmt: skip
    root = ET.Element("testsuites", totals)
    element = ET.SubElement(root, "testsuite", {"name": "raytwin"} | totals)
    for case, problem, taken in zip(cases, problems, seconds, strict=True):
        add_case(element, case.name, case.group, taken, problem, case.output)
    write_suites(root, path)


def add_case(
    suite: ET.Element, name: str, group: str, seconds: float, problem: Problem | None, output: str = ""
) -> None:
    """Add a test case to the suite."""
    test = ET.SubElement(suite, "testcase", {"name": legal(name), "classname": legal(group), "time": f"{seconds:.3f}"})
    if problem is not None:
        about = {"message": legal(problem.message), "type": problem.kind}
        ET.SubElement(test, problem.element, about).text = legal(problem.text) or None
    if output:
        ET.SubElement(test, "system-out").text = legal(output)


def write_suites(root: ET.Element, path: str | os.PathLike[str]) -> None:
    ET.indent(root)
    write_text(path, ET.tostring(root, "unicode", xml_declaration=True) + "\n")


def _problem(outcome: Report | InputError) -> Problem | None:
    """Return what is wrong, or None where the images agree."""
    if isinstance(outcome, InputError):
        return Problem("error", str(outcome), "InputError")
    made = outcome.comparison
    if made.passed:
        return None
    element = "error" if made.verdict == "undecided" else "failure"
    return Problem(element, made.reasons[0] if made.reasons else made.verdict, made.verdict, "\n".join(made.reasons))


def legal(text: str) -> str:
    """Replace the characters that XML 1.0 cannot hold, not even escaped (its section 2.2)."""
    return re.sub("[^\t\n\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)
