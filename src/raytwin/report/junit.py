"""JUnit XML: what CI servers read. One test case per comparison; JUnit has no place for scores."""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import NamedTuple

from raytwin import files
from raytwin.compare import Comparison
from raytwin.errors import InputError


class Case(NamedTuple):
    """`name` of the test, `group` it belongs to, and what came of it; `output` is shown with it."""

    name: str
    group: str
    outcome: Comparison | InputError
    output: str = ""


def write_junit(cases: Iterable[Case], path: str | os.PathLike, suite: str = "raytwin") -> None:
    """A failed comparison is a `failure` with its reasons, an InputError an `error`."""
    cases = list(cases)
    failed = sum(isinstance(c.outcome, Comparison) and not c.outcome.passed for c in cases)
    wrong = sum(isinstance(c.outcome, InputError) for c in cases)
    seconds = [_seconds(c.outcome) for c in cases]
    totals = {"tests": str(len(cases)), "failures": str(failed), "errors": str(wrong), "time": f"{sum(seconds):.3f}"}
    root = ET.Element("testsuites", totals)
    element = ET.SubElement(root, "testsuite", {"name": suite} | totals)
    for case, taken in zip(cases, seconds, strict=True):
        about = {"name": _legal(case.name), "classname": _legal(case.group), "time": f"{taken:.3f}"}
        test = ET.SubElement(element, "testcase", about)
        if isinstance(case.outcome, InputError):
            ET.SubElement(test, "error", {"message": _legal(str(case.outcome)), "type": "InputError"})
        elif not case.outcome.passed:
            reasons = [_legal(reason) for reason in case.outcome.reasons]
            failure = ET.SubElement(test, "failure", {"message": reasons[0] if reasons else "fail", "type": "fail"})
            failure.text = "\n".join(reasons)
        if case.output:
            ET.SubElement(test, "system-out").text = _legal(case.output)
    ET.indent(root)
    files.write_text(path, ET.tostring(root, "unicode", xml_declaration=True) + "\n")


def _seconds(outcome: Comparison | InputError) -> float:
    return sum(s or 0 for s in outcome.seconds.values()) if isinstance(outcome, Comparison) else 0.0


def _legal(text: str) -> str:
    """Without what XML 1.0 cannot hold, not even escaped: its section 2.2."""
    return re.sub("[^\t\n\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)
