"""The command line: a file a group of commands. Heavy imports happen inside the commands: `--help` answers at once.

Exit codes: 0 pass, 1 the comparison failed, 2 undecided, or the input or the machine is at fault.
"""

import contextlib
import io
import os
import sys
import traceback
import warnings
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
from raytwin.cli.options import with_options
from raytwin.cli.terminal import say
from raytwin.errors import InputError, extras_for
from raytwin.removed import moved_command, removed_command

COMMANDS: dict[str, tuple[Any, str]] = {
    "compare": (compare_commands.compare_command, "overlap --rung path --samples 256"),
    "diff": (compare_commands.diff_command, "mine.exr reference.exr -o out/diff"),
    "laws": (method_commands.laws_command, "'./mytracer {scene} {out}'"),
    "explore": (method_commands.explore_command, "overlap"),
    "shrink": (method_commands.shrink_command, "overlap --subject mine.py:render"),
    "reference": ("Make, accept, check, show reference images, merge reports.", "make overlap --rung shadow"),
    "reference make": (reference_commands.make_command, "overlap --rung shadow"),
    "reference accept": (reference_commands.accept_command, "pages/new/logo/lambert.exr --because 'new logo'"),
    "reference check": (reference_commands.check_command, "overlap"),
    "reference show": (reference_commands.show_command, "overlap"),
    "reference merge": (reference_commands.merge_command, "linux mac windows"),
    "bench": (bench_commands.scene_command, "overlap wedge --subject mine.py:render --methods 'drjit32-*'"),
    "bench list": (bench_commands.list_command, "--methods 'numpy*'"),
    "levels": (method_commands.levels_command, "overlap --tolerance 0.03 --size 160x120"),
    "stability": (bench_commands.stability_command, "sphere-far"),
    "photo": ("Calibrate from photos, find their light, draw into them.", "calibrate photos -o camera.toml"),
    "photo board": (photo_commands.board_command, "--tag 30mm --columns 5 --rows 7 --pitch 38mm -o board.pdf"),
    "photo calibrate": (photo_commands.calibrate_command, "photos --board board.toml -o camera.toml"),
    "photo light": (photo_commands.light_command, "a.jpg --camera c.toml --ball=-6cm,15cm,2cm,2cm -o light.toml"),
    "photo draw": (photo_commands.draw_command, "photos/*.jpg --scene desk -o out/drawn"),
    "photo simulate": (photo_commands.simulate_command, "--board board.toml --count 20 -o photos"),
    "walk": (grade_commands.walk_command, "--notebook"),
    "grade": (grade_commands.class_command, "submissions --rubric rubric.toml --jobs 4"),
    "grade starter": (grade_commands.starter_command, "-o tracer.py"),
    "grade zip": (grade_commands.zip_command, "rubric.toml"),
    "scenes": (scenes_commands.list_command, ""),
    "scenes list": (scenes_commands.list_command, ""),
    "scenes copy": (scenes_commands.copy_command, "desk my-desk"),
    "scenes export": (scenes_commands.export_command, "overlap -o overlap.json"),
    "doctor": (doctor_command.doctor_command, ""),
}
"""Command -> what runs, or the help of a group that does nothing by itself; and words for it, as an example."""
HEADINGS = {
    "Compare and explain": ("compare", "diff", "laws", "explore", "shrink"),
    "References": ("reference",),
    "Measure": ("bench", "levels", "stability"),
    "Photos": ("photo",),
    "Learn and teach": ("walk", "grade"),
    "Further": ("scenes", "doctor"),
}
"""Heading in `--help` -> the commands under it."""
BY_ITSELF = " "
"""Name of what a group does without a subcommand: no folder can have it."""


class InOrder(TyperGroup):
    """The program, whose `--help` lists commands and groups in the order of COMMANDS."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [name for name in COMMANDS if " " not in name]


class RunsByItself(TyperGroup):
    """A group that does something by itself: words that begin with no subcommand are its own, and so is its help."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args or args[0] not in {*self.commands, *ctx.help_option_names}:
            args = [BY_ITSELF, *args]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        command: Any = self.commands[BY_ITSELF]
        command.format_help(command.context_class(command, info_name=ctx.info_name, parent=ctx.parent), formatter)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        say(f"raytwin {version('raytwin')}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def _program() -> typer.Typer:
    """Make the program of COMMANDS."""
    program = typer.Typer(
        help="Compare a ray tracer with Mitsuba on the same scene and explain the difference.",
        epilog="Example: raytwin compare single. Each command has its own --help.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        cls=InOrder,
        rich_markup_mode="markdown",
        context_settings={"help_option_names": ["-h", "--help"]},
        callback=_options,
    )
    heading_of = {name: heading for heading, names in HEADINGS.items() for name in names}
    groups: dict[str, typer.Typer] = {}
    for name, (command, example) in COMMANDS.items():
        first, _, last = name.partition(" ")
        within = [other for other in COMMANDS if other.startswith(f"{name} ")]
        epilog = " ".join(f"Example: raytwin {name} {example}".split())
        if within and callable(command):
            epilog += f". Beside it: {', '.join(f'raytwin {other}' for other in within)}"
        shown: dict[str, Any] = {"epilog": epilog, "rich_help_panel": heading_of.get(name)}
        if within:
            by_itself = callable(command)
            groups[name] = typer.Typer(cls=RunsByItself if by_itself else TyperGroup, no_args_is_help=not by_itself)
            text = (command.__doc__ or "").splitlines()[0] if by_itself else command
            program.add_typer(groups[name], name=name, help=text, **shown)
        if callable(command):
            place, own = (groups[first], last or BY_ITSELF) if first in groups else (program, name)
            place.command(own, **shown)(with_options(command, name))
    return program


app = _program()

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
        words = moved_command(sys.argv[1:])
        if gone := removed_command(words):
            return _said(gone)
        Path.cwd()  # before a library looks for it: Mitsuba aborts the whole process where it is gone
        code = app(words, standalone_mode=False, prog_name="raytwin")
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
    if isinstance(error, ModuleNotFoundError) and (extras := ",".join(extras_for(error))):
        return _said(f"this needs {error.name}, which is not installed: pip install 'raytwin[{extras}]'")
    if isinstance(error, InputError):
        return _said(str(error), error.exit_code)
    if isinstance(error, typer.Abort):
        return _said("interrupted", INTERRUPTED)
    if hasattr(error, "format_message"):  # typer's own
        return _said(text) if (text := _misused(error)) else 2  # without words the help is printed already
    if isinstance(error, OSError):
        if error.filename is None:  # what was left to print: not a second time, when Python ends
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED if isinstance(error, BrokenPipeError) else _said(str(_unusable(error)))
    if isinstance(error, UnicodeEncodeError):
        return _said(str(InputError("the name of a file", "UTF-8", repr(error.object)[:80])))
    if isinstance(error, MemoryError):
        return _said(f"not enough memory{f': {error}' if str(error) else ''}")
    traceback.print_exception(error)
    return _said("this is a fault of raytwin's own", OWN_FAULT)


def _misused(error: Any) -> str:
    """What typer says is wrong with the words of the command line, and where to look; empty where it says nothing."""
    text = error.format_message().rstrip(".")
    command = error.ctx.command_path.rstrip() if getattr(error, "ctx", None) else "raytwin"
    return f"{text} (`{command} --help` lists what it takes)" if text else ""


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
