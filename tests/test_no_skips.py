"""RAYTWIN_NO_SKIPS makes skips failures, but for what no machine of ours need have."""

from pathlib import Path

import pytest

pytestmark = pytest.mark.nightly

pytest_plugins = ["pytester"]

ROOT = Path(__file__).resolve().parent.parent
SKIPPED = """
import pytest

def test_of_a_lost_backend():
    pytest.skip("llvm_ad_rgb does not work here")

@pytest.mark.skipif(True, reason="real photos are not there")
def test_of_lost_photos():
    pass

def test_of_a_gpu():
    pytest.skip("no working CUDA")

@pytest.mark.xfail(strict=True)
def test_of_what_fails():
    assert False
"""


def test_a_skip_fails_where_none_is_wanted(pytester, monkeypatch):
    """Skipped by its mark a test has not begun: an error, in pytest's words."""
    monkeypatch.setenv("RAYTWIN_NO_SKIPS", "1")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests"))
    pytester.makepyfile(SKIPPED, test_whole="import pytest\npytest.importorskip('no_such_package')\n")
    done = pytester.runpytest_subprocess("-p", "no_skips", "--continue-on-collection-errors")
    done.assert_outcomes(failed=1, errors=2, skipped=1, xfailed=1)
    assert "llvm_ad_rgb does not work here" in done.stdout.str()
    assert "export RAYTWIN_NO_SKIPS=1\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
