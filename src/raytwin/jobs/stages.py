"""The stages of a job: each is timed, and told as progress; and what else of this run may change a number."""

import importlib.metadata
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager

from raytwin.progress import Progress, silent


class Stages:
    """`seconds` of each named stage, in order."""

    def __init__(self, progress: Progress = silent) -> None:
        self.progress = progress
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """What happens within is the stage `name`; more of it may come later."""
        self.progress(name, 0, 1)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
        self.progress(name, 1, 1)


def versions() -> dict[str, str]:
    """Of Python and of the packages whose version may change a number; those that are not installed are left out."""
    named = ("raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless", "pupil-apriltags")
    known = {"python": platform.python_version()}
    for name in named:
        try:
            known[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return known
