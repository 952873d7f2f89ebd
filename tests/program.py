"""The command line as a user meets it, in this process; or, where a fresh one is the point, in one of its own."""

import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from typer.main import get_command

from raytwin.cli import app, main

WIDE = "1000"
"""Columns of a test's terminal: sentences are not broken, so that a test may look for a part of one."""

Done = subprocess.CompletedProcess[str]


def raytwin(*arguments: object, cwd: Path | None = None) -> Done:
    """What it did."""
    command = ["raytwin", *map(str, arguments)]
    with (
        pytest.MonkeyPatch.context() as patch, contextlib.chdir(cwd or Path.cwd()),
        _kept("stdout", 1) as out, _kept("stderr", 2) as err,
        _instead("argv", command), _instead("stdin", io.StringIO()),
    ):  # fmt: skip
        if "COLUMNS" not in os.environ:
            patch.setenv("COLUMNS", WIDE)
        try:
            main()
        except SystemExit as ended:
            code = ended.code
    return subprocess.CompletedProcess(command, code, out[0], err[0])


@contextlib.contextmanager
def _kept(name: str, number: int) -> Iterator[list[str]]:
    """What is written to the stream, by libraries in C too: told in the list's only place in the end."""
    told = [""]
    with tempfile.TemporaryFile() as file:
        before = os.dup(number)
        os.dup2(file.fileno(), number)
        try:
            with _instead(name, io.TextIOWrapper(os.fdopen(number, "wb", closefd=False), "utf-8")) as stream:
                yield told
                stream.flush()
        finally:
            os.dup2(before, number)
            os.close(before)
            file.seek(0)
            told[0] = file.read().decode()


@contextlib.contextmanager
def _instead(name: str, value):
    """sys's own, for a while."""
    before = getattr(sys, name)
    setattr(sys, name, value)
    try:
        yield value
    finally:
        setattr(sys, name, before)


def raytwin_alone(*arguments: object, cwd: Path | None = None, **environment: str) -> Done:
    """The same in a process of its own, with more in its environment."""
    command = [sys.executable, "-m", "raytwin", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=cwd, env={"COLUMNS": WIDE} | os.environ | environment,
        timeout=600, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def parse(words: list[str]) -> str | None:
    """Why the program refuses the words, None where it does not."""
    if "--install-completion" in words:
        return None  # it would be installed
    parent, group = None, get_command(app)
    try:
        while hasattr(group, "commands"):
            parent = group.make_context("raytwin", list(words), parent=parent)
            if not (rest := [*parent._protected_args, *parent.args]):
                return None  # a group that does something by itself
            _, group, words = group.resolve_command(parent, rest)
        group.make_context("raytwin", list(words), parent=parent)
    except Exception as error:
        return type(error).__name__
    return None


def refused(run: Done, *parts: str) -> None:
    """Exit code 2 and one line, without a traceback, that holds all of `parts`."""
    assert run.returncode == 2, run.stderr
    assert run.stderr.startswith("raytwin: ")
    assert run.stderr.count("\n") == 1, run.stderr
    assert not run.stdout
    for part in parts:
        assert part in run.stderr


# A module that runs several commands in one process, which imports once, and tells exit codes and what they print, on
# standard error too.
CHAIN = """
import contextlib, io, json, sys
from raytwin.cli import main
told = []
for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(out):
        try:
            main()
        except SystemExit as ended:
            told.append((ended.code, out.getvalue()))
print(json.dumps(told))
"""


def check_chain(steps: Sequence[tuple[str, int, str]], run: Callable[[str], str]) -> None:
    """Each step: a command, its exit code, and what it prints, among other things. `run(words)`: CHAIN's answer."""
    done = json.loads(run(json.dumps([command.split() for command, _, _ in steps])))
    for (command, code, part), (found, told) in zip(steps, done, strict=True):
        assert (found, part in told) == (code, True), f"{command}: {found}\n{told}"
