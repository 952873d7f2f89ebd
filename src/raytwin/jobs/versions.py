"""What of this run, beside its input, may change a number."""

import importlib.metadata
import platform


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
