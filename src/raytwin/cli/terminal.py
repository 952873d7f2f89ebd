"""What the terminal shows: text whose names cannot move its cursor, change its colours or fake a line."""

import typer


def printable(text: str) -> str:
    r"""Replace every character that is not printable by its escape; line ends and tabs stay.

    >>> printable("a\x1b[31mb\n")
    'a\\x1b[31mb\n'
    """
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def say(text: object, err: bool = False) -> None:
    """Print a line. File, scene and student names are a stranger's text: only `say` prints in this package."""
    typer.echo(printable(str(text)), err=err)
