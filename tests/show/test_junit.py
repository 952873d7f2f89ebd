"""JUnit XML as CI servers parse it."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from raytwin.compare import Comparison, Report, compare
from raytwin.compare.finding import notes
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.show.junit import Case, write_junit

ONES = np.ones((4, 5, 3), np.float32)


@pytest.fixture
def written(tmp_path):
    passed, failed = (Report("s", "", compare(Image(k * ONES), Image(ONES))) for k in (1, 2))
    differs, undecided = (Report("s", "", Comparison(verdict, notes(["why"]))) for verdict in ("differs", "undecided"))
    cases = [
        Case("good", "g", passed, "text"),
        Case("bad", "g", failed),
        Case("less", "g", differs),
        Case("open", "g", undecided),
        Case("none", "g", InputError("x.exr", "a file", "<nothing> & \x1b[31m")),
    ]
    write_junit(cases, tmp_path / "x.xml")
    return ET.parse(tmp_path / "x.xml").getroot(), failed.comparison


def test_passes_failures_and_errors_are_counted_and_told_apart(written):
    root, failed = written
    suite = root.find("testsuite")
    for element in (root, suite):
        assert [element.get(k) for k in ("tests", "failures", "errors")] == ["5", "1", "2"]
    good, bad, less, still_open, none = suite.findall("testcase")
    assert (good.find("failure"), good.find("error")) == (None, None)
    assert (less.find("failure"), less.find("error")) == (None, None)
    assert (still_open.find("error").get("type"), still_open.findtext("error")) == ("undecided", "why")
    assert good.findtext("system-out") == "text"
    assert bad.find("failure").get("message") == failed.reasons[0]
    assert bad.findtext("failure") == "\n".join(failed.reasons)
    assert none.find("error").get("message").startswith("x.exr: expected a file, got <nothing> &")
    times = [float(c.get("time")) for c in suite.findall("testcase")]
    assert float(root.get("time")) == pytest.approx(sum(times), abs=2e-3)


def test_names_that_xml_cannot_hold_are_replaced(tmp_path):
    name = "a\x00\x08\x1b<>&\"'é\ud800\ufffe\U0001f600\n"
    failed = Report("s", "", Comparison("fail", notes([name])))
    write_junit([Case(name, name, failed, name)], tmp_path / "x.xml")
    case = ET.parse(tmp_path / "x.xml").getroot().find("testsuite/testcase")
    expected = "a\ufffd\ufffd\ufffd<>&\"'é\ufffd\ufffd\U0001f600"
    assert case.get("name").strip() == case.findtext("system-out").strip() == expected
