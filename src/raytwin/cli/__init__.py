"""The command line: a file a group of commands. Heavy imports happen inside the commands: `--help` answers at once.

Exit codes: 0 pass, 1 the comparison failed, 2 undecided, or the input or the machine is at fault.
"""

import sys
from typing import Annotated

import typer

from raytwin.cli import bench, board, images, photos, reference, scenes
from raytwin.errors import InputError

app = typer.Typer(
    help="A hand-written ray tracer beside its Mitsuba twin: compare the two and explain the difference.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"raytwin {version('raytwin')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell it.")] = False,
) -> None:
    pass


app.command("compare")(images.compare_command)
app.command("diff")(images.diff_command)
app.add_typer(reference.app, name="reference")
app.add_typer(scenes.app, name="scenes")
app.command("calibrate")(photos.calibrate_command)
app.command("augment")(photos.augment_command)
app.command("board")(board.board_command)
app.command("photograph")(photos.photograph_command)
app.add_typer(bench.app, name="bench")


@app.command("doctor")
def doctor() -> None:
    """Show which backend the twin uses on this machine, what else was tried, and why."""
    from raytwin import twin

    for name, value in twin.doctor():
        typer.echo(f"{name:<24} {value}")


EXTRAS = {
    "mitsuba": "twin", "drjit": "twin", "cv2": "photos", "pupil_apriltags": "photos", "bokeh": "charts",
    "reportlab": "charts",
}  # fmt: skip
"""What the light install leaves out, by the extra that brings it."""


def main() -> None:
    """The entry point: an InputError becomes one line on standard error and exit code 2."""
    try:
        app()
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name not in EXTRAS:
            raise
        print(f"raytwin: this needs {name}: pip install 'raytwin[{EXTRAS[name]}]'", file=sys.stderr)
        sys.exit(2)
    except InputError as error:
        print(f"raytwin: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:
        sys.exit(141)
    except KeyboardInterrupt:
        print("raytwin: interrupted", file=sys.stderr)
        sys.exit(130)
