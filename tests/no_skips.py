"""With RAYTWIN_NO_SKIPS=1 a test that would be skipped fails: a lost backend, photo or browser must not pass unseen."""

import os
import re
from collections.abc import Generator

import pytest

ALLOWED = re.compile(
    r"cuda|CUDA"  # needs an NVIDIA GPU
    r"|lacks locks"  # the kernel's, or a container's
    r"|Windows"
    r"|not a checkout"
)
"""Reasons to skip that remain: what no machine of ours need have."""


def must_run(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure that says why it was one."""
    if not report.skipped or hasattr(report, "wasxfail") or os.environ.get("RAYTWIN_NO_SKIPS", "0") in ("", "0"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if not ALLOWED.search(reason):
        report.outcome = "failed"
        report.longrepr = f"{reason}\n(RAYTWIN_NO_SKIPS is set: what a test needs must be there)"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    must_run(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    must_run(report)
    return report
