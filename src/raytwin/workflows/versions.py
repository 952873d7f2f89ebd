"""What of this run, beside its input, may change a number."""

from raytwin import files

PACKAGES = "raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless", "pupil-apriltags"


def versions() -> dict[str, str]:
    """Of Python and of the packages whose version may change a number; those that are not installed are left out."""
    return files.installed(PACKAGES)
