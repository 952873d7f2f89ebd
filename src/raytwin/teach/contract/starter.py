"""The file that a student starts from: the contract's functions, their docstrings, one worked example, their checks."""

from collections.abc import Sequence
from pathlib import Path

from raytwin.teach.contract.stage_table import CONTRACT

SOURCE = Path(__file__).with_name("starter.py.txt")
"""All of them, and the functions of the walk's lessons."""


def starter(name: str = "tracer.py", stages: Sequence[str] = tuple(CONTRACT)) -> str:
    """The text of that file, with the functions of these names."""
    head, *functions, tail = SOURCE.read_text(encoding="utf-8").split("\n\n\n")
    text_of = {text.removeprefix("def ").partition("(")[0]: text for text in functions}
    chosen = [text_of[function] for function in ("intersect_plane", *stages)]
    names = f"names = {list(stages)!r}".replace("'", '"')
    return "\n\n\n".join([head.replace("tracer.py", name), *chosen, tail.replace("names = []", names)])
