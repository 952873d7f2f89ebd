"""What of this run, beside its input, may change a number."""

from raytwin import files

PACKAGES = "raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless", "pupil-apriltags"


def versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that may change a number."""
    return files.installed(PACKAGES)
