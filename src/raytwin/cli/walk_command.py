"""raytwin walk: from photos to the twin in eight stages, for whoever wants to write them."""

from pathlib import Path

from raytwin.cli.option_values import check_outputs
from raytwin.cli.terminal import say


def walk_command(notebook: bool = False, out: Path = Path(), solved: bool = False) -> None:
    """Write eight lessons, from photos to path tracing.

    Each has a function to fill in, a check in words, and the picture so far.
    """
    from raytwin.tutorial.written import write_walk

    check_outputs(folders=(out,))
    path = write_walk(out, notebook, solved)
    say(f"wrote {path}")
    say(f"jupyter lab {path}" if notebook else f"python {path}    # its pictures go to walk/; edit it, run it again")
