"""JUnit XML: what CI servers read. One test case per comparison; JUnit has no place for scores."""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import NamedTuple

from raytwin import files
from raytwin.compare import Report
from raytwin.errors import InputError


class Case(NamedTuple):
    """`name` of the test, `group` it belongs to, and what came of it; `output` is shown with it."""

    name: str
    group: str
    outcome: Report | InputError
    output: str = ""


def write_junit(cases: Iterable[Case], path: str | os.PathLike[str], suite: str = "raytwin") -> None:
    """A failed comparison is a `failure` with its reasons; an undecided one and an InputError are an `error`."""
    cases = list(cases)
    kinds = [_kind(c.outcome) for c in cases]
    seconds = [_seconds(c.outcome) for c in cases]
    totals = {
        "tests": str(len(cases)),
        "failures": str(kinds.count("failure")),
        "errors": str(kinds.count("error")),
        "time": f"{sum(seconds):.3f}",
    }
    root = ET.Element("testsuites", totals)
    element = ET.SubElement(root, "testsuite", {"name": suite} | totals)
    for case, kind, taken in zip(cases, kinds, seconds, strict=True):
        about = {"name": _legal(case.name), "classname": _legal(case.group), "time": f"{taken:.3f}"}
        test = ET.SubElement(element, "testcase", about)
        if isinstance(case.outcome, InputError):
            ET.SubElement(test, "error", {"message": _legal(str(case.outcome)), "type": "InputError"})
        elif kind:
            made = case.outcome.comparison
            reasons = [_legal(reason) for reason in made.reasons]
            said = {"message": reasons[0] if reasons else made.verdict, "type": made.verdict}
            ET.SubElement(test, kind, said).text = "\n".join(reasons)
        if case.output:
            ET.SubElement(test, "system-out").text = _legal(case.output)
    ET.indent(root)
    files.write_text(path, ET.tostring(root, "unicode", xml_declaration=True) + "\n")


def _seconds(outcome: Report | InputError) -> float:
    return sum(outcome.seconds.values()) if isinstance(outcome, Report) else 0.0


def _kind(outcome: Report | InputError) -> str:
    """The element that says what is wrong; none where the images agree."""
    if isinstance(outcome, InputError) or outcome.comparison.verdict == "undecided":
        return "error"
    return "" if outcome.comparison.passed else "failure"


def _legal(text: str) -> str:
    """Without what XML 1.0 cannot hold, not even escaped: its section 2.2."""
    return re.sub("[^\t\n\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)
