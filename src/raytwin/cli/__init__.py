"""The command line: a file a group of commands. Heavy imports happen inside the commands: `--help` answers at once.

Exit codes: 0 pass, 1 the comparison failed, 2 undecided, or the input or the machine is at fault.
"""

import contextlib
import io
import os
import re
import sys
import traceback
import warnings
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from raytwin.cli import (
    bench_commands,
    compare_commands,
    doctor_command,
    grade_commands,
    method_commands,
    photo_commands,
    reference_commands,
    scenes_commands,
)
from raytwin.cli.examples import EXAMPLES
from raytwin.cli.options import register
from raytwin.cli.terminal import say
from raytwin.errors import InputError, MachineError, extras_for
from raytwin.removed import moved_command, removed_command

COMPARE, REFERENCES, MEASURE = "Compare and explain", "References", "Measure"
PHOTOS, CLASSES, FURTHER = "Photos", "Learn and teach", "Further"
COMMANDS: dict[str, tuple[str, Any]] = {
    "compare": (COMPARE, compare_commands.compare_command),
    "diff": (COMPARE, compare_commands.diff_command),
    "laws": (COMPARE, method_commands.laws_command),
    "explore": (COMPARE, method_commands.explore_command),
    "shrink": (COMPARE, method_commands.shrink_command),
    "reference": (REFERENCES, reference_commands.app),
    "bench": (MEASURE, bench_commands.app),
    "levels": (MEASURE, method_commands.levels_command),
    "stability": (MEASURE, bench_commands.stability_command),
    "photo": (PHOTOS, photo_commands.app),
    "walk": (CLASSES, grade_commands.walk_command),
    "grade": (CLASSES, grade_commands.app),
    "scenes": (FURTHER, scenes_commands.app),
    "doctor": (FURTHER, doctor_command.doctor_command),
}
"""Command -> the heading that it stands under in `--help`, and what runs. An app is a group of commands."""
GROUP_HELP = {
    "reference": "Make, accept, check, show reference images, merge reports.",
    "bench": "Measure speed against accuracy.",
    "photo": "Calibrate from photos, find their light, draw into them.",
    "grade": "Grade students' tracers.",
    "scenes": "List, copy or export scenes.",
}
"""Group of commands -> its line of help."""


class Grouped(TyperGroup):
    """The list of commands under headings; a command that moved into a group still answers to its old name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, moved_command(args))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        limit = formatter.width - 6 - max(map(len, self.commands))
        for heading in dict.fromkeys(heading for heading, _ in COMMANDS.values()):
            named = [n for n, (own, _) in COMMANDS.items() if own == heading]
            with formatter.section(heading):
                formatter.write_dl([(n, self.commands[n].get_short_help_str(limit)) for n in named])


app = typer.Typer(
    cls=Grouped,
    help="Compare a ray tracer with Mitsuba on the same scene and explain the difference.",
    epilog="Example: raytwin compare single. Each command has its own --help.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        say(f"raytwin {version('raytwin')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


for name, (_, command) in COMMANDS.items():
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=name, help=GROUP_HELP[name], epilog=f"Example: {EXAMPLES[name]}")
    else:
        register(app, {name: command})

NEEDS = {
    "bench": ("twin", "llvm"), "compare": ("twin", "llvm"), "explore": ("live", "twin", "llvm"),
    "levels": ("twin", "llvm"), "photo": ("photos",), "photo simulate": ("photos", "twin", "llvm"),
    "reference": ("twin", "llvm"), "shrink": ("twin", "llvm"), "stability": ("photos",),
}  # fmt: skip
"""The extras that a command needs whatever it is given: named all at once where one of them is missing."""


INTERRUPTED, CLOSED, OWN_FAULT = 130, 141, 70
"""Exit codes as shells and sysexits.h have them. 1 says that a comparison failed, and nothing else."""


def main() -> None:
    """The entry point: whatever goes wrong is one line on standard error, and an exit code that is not 1."""
    sys.exit(_run())


def _run() -> int:
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be UTF-8
    warnings.showwarning = lambda message, *_, **__: say(f"raytwin: {message}", err=True)
    # No command has matrices large enough for two: beside another process the second spins, and a fit takes five times
    # as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        if gone := removed_command(moved_command(sys.argv[1:])):
            return _said(gone)
        Path.cwd()  # before a library looks for it: Mitsuba aborts the whole process where it is gone
        code = app(standalone_mode=False, prog_name="raytwin")
        sys.stdout.flush()
        return code or 0
    except Exception as error:
        return _report(error)
    except KeyboardInterrupt:
        return _said("interrupted", INTERRUPTED)
    except SystemExit as ended:
        if isinstance(ended.__context__, BrokenPipeError):  # typer's own answer to it is exit code 1
            return _report(ended.__context__)
        raise


def _report(error: Exception) -> int:
    """The error in one line on standard error, and its exit code."""
    missing = error.__context__ if isinstance(error, MachineError) else error
    if isinstance(missing, ModuleNotFoundError) and (extras := extras_for(missing)):
        words = [word for word in moved_command(sys.argv[1:]) if not word.startswith("-")] or ["this"]
        command = " ".join(words[: 2 if words[0] == "photo" else 1])
        wanted = ",".join(dict.fromkeys((*NEEDS.get(command, NEEDS.get(words[0], ())), *extras)))
        return _said(f"{command} needs {missing.name}, which is not installed: pip install 'raytwin[{wanted}]'")
    if isinstance(error, InputError):
        return _said(str(error), error.exit_code)
    if isinstance(error, typer.Abort):
        return _said("interrupted", INTERRUPTED)
    if hasattr(error, "show"):  # typer's own
        shown: Any = error
        if type(error).__name__ == "NoArgsIsHelpError":
            say(shown.format_message(), err=True)
            return 2
        return _said(_misused(shown))
    if isinstance(error, OSError):
        if error.filename is None:  # what was left to print: not a second time, when Python ends
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return CLOSED
        return _said(str(_unusable(error)))
    if isinstance(error, UnicodeEncodeError):
        return _said(str(InputError("the name of a file", "UTF-8", repr(error.object)[:80])))
    if isinstance(error, MemoryError):
        return _said(f"not enough memory{f': {error}' if str(error) else ''}")
    traceback.print_exception(error)
    return _said("this is a fault of raytwin's own", OWN_FAULT)


def _misused(error: Any) -> str:
    """What is wrong with the words of the command line, in a line of our own.

    Typer's exceptions have moved between its releases: they are known by their fields.
    """
    text = error.format_message()
    if value := re.match(r"Option '(.*)' (requires|does not take)", text):
        return f"{value[1]} {'needs a' if value[2] == 'requires' else 'takes no'} value."
    command = error.ctx.command_path.rstrip()
    help_lists = f"`{command} --help` lists what it takes."
    if (param := getattr(error, "param", None)) is not None:
        name = param.opts[0] if param.opts[0].startswith("-") else param.name.upper()
        if text.startswith("Missing"):
            return f"{name} is missing. {help_lists}"
        found: list[dict[str, Any]] = getattr(error.__cause__, "errors", list)()
        if not found:
            return f"{name}: {error.message}"
        kind = {"int": "a whole number", "float": "a number"}.get(found[0]["type"].partition("_")[0])
        bound = found[0]["msg"].removeprefix("Input should be ").replace("greater than or equal to", "a number >=")
        return str(InputError(name, kind or bound, found[0]["input"]))
    if more := re.search(r"unexpected extra argument.*\((.*)\)", text):
        return f"`{command}` takes no further words, as here {more[1]}. {help_lists}"
    if unknown := re.match(r"No such (option|command):? '?([^\s']*)", text):
        parameters = [name for p in error.ctx.command.params for name in p.opts]
        known = parameters if unknown[1] == "option" else error.ctx.command.commands
        meant = get_close_matches(unknown[2], known, 1)
        return f"`{command}` has no {unknown[1]} {unknown[2]}. {f'Did you mean {meant[0]}?' if meant else help_lists}"
    return f"{text.rstrip('.')}. {help_lists}"


def _unusable(error: OSError) -> InputError:
    """Which file or stream an OSError is about: the current folder, where that is gone, has no name."""
    try:
        Path.cwd()
    except OSError:
        return InputError("the current folder", "one that exists", "one that was removed")
    return InputError(error.filename or "standard output", "a working one", error.strerror or error)


def _said(text: str, code: int = 2) -> int:
    with contextlib.suppress(OSError):
        say(f"raytwin: {text}", err=True)
    return code
