"""raytwin walk: from photos to the twin in eight stages, for whoever wants to write them."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import check_outputs
from raytwin.cli.terminal import say


def walk_command(
    notebook: Annotated[bool, typer.Option("--notebook", help="Write a Jupyter notebook instead of a script.")] = False,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to.")] = Path(),
    solved: Annotated[bool, typer.Option("--solved", help="Fill in every function.")] = False,
) -> None:
    """Write eight lessons: each has a function to fill in, a check in words, and the picture so far."""
    from raytwin.tutorial.written import write_walk

    check_outputs(folders=(out,))
    path = write_walk(out, notebook, solved)
    say(f"wrote {path}")
    say(f"jupyter lab {path}" if notebook else f"python {path}    # its pictures go to walk/; edit it, run it again")
