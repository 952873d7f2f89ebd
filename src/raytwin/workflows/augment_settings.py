"""The settings of `augment_photos`: keyword arguments in Python, options on the command line (`cli.options`)."""

from dataclasses import dataclass
from pathlib import Path

from raytwin.errors import InputError


@dataclass(frozen=True)
class AugmentSettings:
    """How `augment_photos` draws; checked when it is made.

    `camera`: a camera.toml, whose K, distortion and board's shape count; without it the scene's own photos are
    calibrated. Each photo's pose comes from its own tags of `board` (the scene's, if none is named). `against`: a
    folder of true photos of the same names, the objects really there. `shadows` fall on what the photo shows.
    `exposure`: the photo's linear value of radiance 1, by default 1. `light`: a light.toml in the place of the scene's
    sun and sky; then each photo's exposure is by default what its white paper shows.
    """

    camera: str | Path | None = None
    board: str | Path | None = None
    against: str | Path | None = None
    shadows: bool = True
    exposure: float | None = None
    light: str | Path | None = None

    def __post_init__(self) -> None:
        if self.exposure is not None and not self.exposure >= 0:
            raise InputError("--exposure", "a number >= 0", self.exposure)
