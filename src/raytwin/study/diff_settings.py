"""The settings of `raytwin.compare`, which a light install has."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raytwin.errors import InputError, check_one_of
from raytwin.judging import Judging
from raytwin.rungs import RUNGS

if TYPE_CHECKING:
    from raytwin.scene import Scene


@dataclass(frozen=True)
class DiffSettings(Judging):
    """How `raytwin.compare` reads two images and judges them; checked when it is made.

    `layer` chooses within EXRs. `variances` (arrays or files) and `samples` of the two images are used where they lack
    them. `scene` (one made in Python, a file or a name) and `rung` say what is shown, so that a failure names its
    cause; `renders`: how often a function is called.
    """

    layer: str | None = None
    flip: bool = False
    variances: tuple[Any, Any] = (None, None)
    samples: tuple[int, int] = (0, 0)
    scene: "Scene | str | Path | None" = None
    rung: str | None = None
    renders: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.samples, tuple) and len(self.samples) == 2 and all(map(_is_count, self.samples))):
            expected = "rays per pixel of both images, as (4, 512); 0 if unknown"
            raise InputError("samples", expected, repr(self.samples))
        if self.rung is not None:
            check_one_of("rung", self.rung, RUNGS)

    @property
    def judging(self) -> Judging:
        return Judging(*(getattr(self, field) for field in Judging.__dataclass_fields__))


def _is_count(n: object) -> bool:
    return isinstance(n, int) and n >= 0
