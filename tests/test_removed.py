"""What was removed answers with what to use instead, in one line."""

import re

import pytest
from program import raytwin

import raytwin as package
from raytwin import removed
from raytwin.cli import COMMANDS as ALIVE
from raytwin.errors import InputError
from raytwin.renderers.renderer_table import RENDERERS, renderers_of
from raytwin.teach.contract.subject import find_subject


def test_a_removed_command_or_option_says_what_to_use_instead():
    for row, instead in removed.COMMANDS.items():
        command, *options = row.split(" -")
        for name in [f"{command} -{option}" for option in options] or [command]:
            assert removed.removed_command(name.split()) == f"`{name}` was removed in 0.2.0. {instead}"
    run = raytwin("bench", "paper")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"raytwin: {removed.removed_command(['bench', 'paper'])}\n"


def test_a_command_that_moved_answers_to_its_old_name():
    for old, new in removed.MOVED.items():
        was, now = raytwin(*old.split(), "--nonsense"), raytwin(*new.split(), "--nonsense")
        assert (was.returncode, was.stdout, was.stderr) == (now.returncode, now.stdout, now.stderr), old
        assert f"raytwin {new}" in was.stderr


def test_a_removed_name_or_renderer_says_what_to_use_instead():
    for name in removed.NAMES:
        with pytest.raises(AttributeError, match=r"removed in 0\.2\.0"):
            getattr(package, name)
    for pattern, instead in removed.RENDERERS.items():
        name = pattern.replace("*", "shadow")
        for asked in (lambda name: find_subject(name, "shadow"), lambda name: renderers_of([name])):
            with pytest.raises(InputError, match=rf"`{name}` was removed in 0\.2\.0\. {re.escape(instead)}"):
                asked(name)


def test_what_is_said_to_be_removed_is_gone():
    assert not [name for name in RENDERERS if removed.removed_renderer(name)]
    assert not set(removed.COMMANDS) & set(ALIVE)
    assert not set(removed.NAMES) & set(package.__all__)


def test_words_behind_two_dashes_are_no_options(monkeypatch):
    monkeypatch.setitem(removed.COMMANDS, "diff --old", "Use --new.")
    assert removed.removed_command(["diff", "--old"])
    assert not removed.removed_command(["diff", "--", "--old"])
    assert not removed.removed_command(["compare", "--old"])


def test_a_second_board_is_refused(tmp_path):
    run = raytwin("photo", "calibrate", tmp_path, "--board", "a.toml", "--board", "b.toml")
    assert run.returncode == 2
    assert "`photo calibrate --board` more than once was removed in 0.2.0. Use one board" in run.stderr
