"""What goes wrong because of the input or the machine, said in one line."""

from collections.abc import Iterable
from difflib import get_close_matches


class InputError(ValueError):
    """`where: expected ..., got ...`: the caller's input is wrong. Without `got`: a sentence, of which `where` is the
    subject and `expected` the rest, as in `tracer.py exists. --force overwrites it.`

    `where` names the file and the field (`scenes/desk/scene.toml: spheres[1].radius`), `expected` what would
    have been correct, with its unit, and `got` what was found. The command line prints it in one line, without a
    traceback, and exits with `exit_code`. Characters that cannot be printed on one line become spaces.
    """

    exit_code = 2

    def __init__(self, where: object, expected: str, *got: object) -> None:
        self.fields = tuple(_line(str(text)) for text in (where, expected, *got))
        self.where, self.expected, self.got = (*self.fields, "")[:3]
        super().__init__(f"{self.where}: {self.fault}" if got else f"{self.where} {self.fault}")

    @property
    def fault(self) -> str:
        """What is wrong, without where."""
        return f"expected {self.expected}, got {self.got}" if len(self.fields) == 3 else self.expected

    def at(self, place: str) -> "InputError":
        """Return the same error with a place before its own `where`."""
        return type(self)(f"{place}{self.where}", *self.fields[1:])

    def __reduce__(self) -> tuple[type, tuple[str, ...]]:
        # The default rebuilds from the one formatted argument, which loses the fields between processes.
        return type(self), self.fields


def check_one_of(where: object, value: str, known: Iterable[str]) -> None:
    """InputError where `value` is none of `known`, with what was probably meant.

    >>> check_one_of("--rung", "shadw", ("lambert", "shadow"))
    Traceback (most recent call last):
    raytwin.errors.InputError: --rung: expected one of lambert, shadow, got shadw (did you mean shadow?)
    """
    if value not in (names := list(known)):
        meant = get_close_matches(value, names, 1)
        got = f"{value} (did you mean {meant[0]}?)" if meant else value
        raise InputError(where, f"one of {', '.join(names)}", got)


def _line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


class MachineError(InputError):
    """The machine lacks something that was asked for (no CUDA, no LLVM, no Mitsuba): also exit code 2."""


class SubjectEnded(InputError):
    """The subject's process ended before it answered: a failure of the subject, exit code 1."""

    exit_code = 1


EXTRAS = {
    "mitsuba": ("twin", "llvm"), "drjit": ("twin", "llvm"),
    "cv2": ("photos",), "pupil_apriltags": ("photos",), "threadpoolctl": ("photos",),
    "reportlab": ("photos",), "tornado": ("live",), "jupytext": ("notebook",), "anywidget": ("notebook",),
}  # fmt: skip
"""Modules that the light install leaves out -> the extras that bring them."""


def extras_for(error: ModuleNotFoundError) -> tuple[str, ...]:
    """The extras that bring the module whose absence `error` reports; none where it is none of raytwin's."""
    return EXTRAS.get((error.name or "").partition(".")[0], ())


def missing_package(where: str, error: ModuleNotFoundError) -> MachineError:
    """The MachineError that names the extra which `where` needs.

    >>> print(missing_package("raytwin.render", ModuleNotFoundError("No module named 'mitsuba'", name="mitsuba")))
    raytwin.render: expected mitsuba (pip install 'raytwin[twin,llvm]'), got none installed
    """
    extras = ",".join(extras_for(error))
    return MachineError(where, f"{error.name} (pip install 'raytwin[{extras}]')", "none installed")
