"""What every way to make an image has in common."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from raytwin.images.image import Image
from raytwin.scene import Scene

Call = Callable[[int], Image]
"""seed -> Image: all that is timed."""


@dataclass(frozen=True)
class Renderer(ABC):
    """One frozen record per kind, whose fields say what varies; `method(scene, seed)` makes the image.

    `rung`: a name in RUNGS.

    To add a kind, write a record with a `name` and a `prepare`, and add its rows to RENDERERS.
    """

    rung: str = "shadow"

    @property
    @abstractmethod
    def name(self) -> str:
        """Unique name: how the command line, the bench and its files call it."""

    @property
    def family(self) -> str:
        """The name without the number of samples or pixels at its end; charts join a family by a line."""
        return re.sub(r"-?\d+$|\d+(?=spp$)", "", self.name)

    @property
    def library(self) -> str:
        """What computes: numpy, drjit (LLVM), cuda, or Mitsuba's variant."""
        return "numpy"

    @property
    def precision(self) -> int:
        """Bits of a float."""
        return 32

    @property
    def sampling(self) -> str:
        """`center`: one ray through each pixel's centre; `area`: the mean over the pixel."""
        return "center"

    @property
    def noisy(self) -> bool:
        """Another seed gives another image."""
        return False

    @property
    def trim(self) -> str | None:
        """The boxes outside which nothing is tested, a row of TRIMS."""
        return None

    @property
    def samples(self) -> int:
        """Rays per pixel."""
        return 1

    def with_samples(self, samples: int) -> "Renderer":
        """Return the same with another number of samples, which must be a field of this class."""
        fields: dict[str, Any] = {"samples": samples}
        return replace(self, **fields)

    @property
    def step(self) -> int:
        """Return n if every n-th pixel is traced and the others are interpolated; 1 if all are traced."""
        return 1

    @abstractmethod
    def prepare(self, scene: Scene) -> Call:
        """Do all preparation that is not to be timed, and return the call that makes the image.

        Raises InputError or MachineError where this scene or machine cannot have it.
        """

    def __call__(self, scene: Scene, seed: int = 0) -> Image:
        return self.prepare(scene)(seed)
