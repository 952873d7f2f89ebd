"""raytwin doctor: what this machine has, and what to install for what one wants to do."""

from collections.abc import Iterator
from importlib.util import find_spec

from raytwin.cli.terminal import say
from raytwin.errors import EXTRAS, InputError

USES = {
    "twin": "compare a scene with its twin; levels, bench, reference (add llvm: tens of times faster)",
    "photos": "calibrate a camera from photos of a board, draw into photos, print boards",
    "live": "open the live page (raytwin explore)",
    "notebook": "run raytwin walk --notebook, and the viewer in a notebook",
}
"""Extra -> what it is for."""


def doctor_command() -> None:
    """Show what works on this machine, and what to install.

    Prints Mitsuba's backends and why one fails, the extras that are installed, and which locks of the sandbox work.
    """
    from raytwin import twin

    for name, value in (*twin.doctor(), *_extras(), *_sandbox()):
        say(f"{name:<24} {value}")


def _extras() -> Iterator[tuple[str, str]]:
    for extra, use in USES.items():
        absent = [module for module, brought_by in EXTRAS.items() if extra == brought_by[0] and not find_spec(module)]
        wanted = "twin,llvm" if extra == "twin" else extra
        state = (
            f"no {' nor '.join(absent)}: pip install 'raytwin[{wanted}]'; needed to:" if absent else "installed, to:"
        )
        yield f"extra: {extra}", f"{state} {use}"


def _sandbox() -> Iterator[tuple[str, str]]:
    from raytwin.teach.sandbox import sandbox

    try:
        locks = sandbox.probe()
    except InputError as error:
        yield "sandbox", f"none: {error}"
        return
    for lock, state in sandbox.lock_rows(locks):
        yield f"sandbox: {lock}", state
