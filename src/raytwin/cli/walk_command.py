"""raytwin walk: from photos to the twin in eight stages, for whoever wants to write them."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import check_outputs
from raytwin.cli.terminal import say


def walk_command(
    notebook: Annotated[
        bool, typer.Option("--notebook", help="A notebook, for Jupyter, in place of a script.")
    ] = False,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Where it goes.")] = Path(),
    solved: Annotated[bool, typer.Option("--solved", help="With every function filled in.")] = False,
) -> None:
    """Write the walk: eight lessons, each with an empty function to fill, a check in words, and the picture so far."""
    from raytwin.tutorial.written import write_walk

    check_outputs(folders=(out,))
    path = write_walk(out, notebook, solved)
    say(f"wrote {path}")
    say(f"jupyter lab {path}" if notebook else f"python {path}    # its pictures go to walk/; edit it, run it again")
