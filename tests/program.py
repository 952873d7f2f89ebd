"""The command line in a process of its own, as a user meets it."""

import os
import re
import subprocess
import sys
from pathlib import Path

STAGE = re.compile(r"^[\w/ .-]+: \d+ of \d+, [\d.]+ s\n", re.MULTILINE)


def raytwin(*arguments: object, cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """What it did, without the lines that a busy machine's long stages leave on standard error."""
    command = [sys.executable, "-m", "raytwin", *map(str, arguments)]
    run = subprocess.run(
        command, capture_output=True, text=True, cwd=cwd, env=os.environ | environment, timeout=600, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    run.stderr = STAGE.sub("", run.stderr)
    return run


def refused(run: subprocess.CompletedProcess[str], *parts: str) -> None:
    """Exit code 2 and one line, without a traceback, that holds all of `parts`."""
    assert run.returncode == 2, run.stderr
    assert run.stderr.startswith("raytwin: ")
    assert run.stderr.count("\n") == 1, run.stderr
    assert not run.stdout
    for part in parts:
        assert part in run.stderr
