"""What was removed answers with what to use instead, in one line."""

import pytest
from program import raytwin

import raytwin as package
from raytwin import removed
from raytwin.cli import COMMANDS as ALIVE
from raytwin.errors import InputError
from raytwin.renderers.renderer_table import RENDERERS, renderers_of
from raytwin.teach.contract.subject import find_subject


@pytest.mark.parametrize("name", removed.COMMANDS)
def test_a_removed_command_or_option_says_what_to_use_instead(name):
    run = raytwin(*name.split())
    assert run.returncode == 2
    assert run.stderr.splitlines() == [f"raytwin: `{name}` was removed in 0.2.0. {removed.COMMANDS[name]}"]


@pytest.mark.parametrize(("old", "new"), removed.MOVED.items())
def test_a_command_that_moved_answers_to_its_old_name(old, new):
    for word in ("--help", "--nonsense"):
        was, now = raytwin(*old.split(), word), raytwin(*new.split(), word)
        assert (was.returncode, was.stdout, was.stderr) == (now.returncode, now.stdout, now.stderr)
    assert f"raytwin {new}" in was.stderr


@pytest.mark.parametrize("name", removed.NAMES)
def test_a_removed_name_says_what_to_use_instead(name):
    with pytest.raises(AttributeError, match=r"removed in 0\.2\.0"):
        getattr(package, name)


@pytest.mark.parametrize("start", removed.RENDERERS)
def test_a_removed_renderer_says_what_to_use_instead(start):
    said = rf"`{start}shadow` was removed in 0\.2\.0\. {removed.RENDERERS[start]}"
    with pytest.raises(InputError, match=said):
        find_subject(f"{start}shadow", "shadow")
    with pytest.raises(InputError, match=said):
        renderers_of([f"{start}shadow"])


def test_what_is_said_to_be_removed_is_gone():
    assert not [name for name in RENDERERS if removed.removed_renderer(name)]
    assert not set(removed.COMMANDS) & set(ALIVE)
    assert not set(removed.NAMES) & set(package.__all__)


def test_words_behind_two_dashes_are_no_options():
    removed.COMMANDS["diff --old"] = "Use --new."
    try:
        assert removed.removed_command(["diff", "--old"])
        assert not removed.removed_command(["diff", "--", "--old"])
        assert not removed.removed_command(["compare", "--old"])
    finally:
        del removed.COMMANDS["diff --old"]


def test_a_second_board_is_refused(tmp_path):
    run = raytwin("calibrate", tmp_path, "--board", "a.toml", "--board", "b.toml")
    assert run.returncode == 2
    assert run.stderr.startswith(
        "raytwin: `photo calibrate --board` more than once was removed in 0.2.0. Use one board"
    )
