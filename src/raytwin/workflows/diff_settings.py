"""The settings of `diff_files`: keyword arguments in Python, options on the command line (`cli.options.OPTIONS`)."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from raytwin.errors import InputError

if TYPE_CHECKING:
    from raytwin.compare import Limits


@dataclass(frozen=True)
class DiffSettings:
    """How `diff_files` reads two images and decides; checked when it is made.

    Without `limits`, `compare` decides: values without noise by `tolerance`, the others at `false_alarm_rate`. With
    them, they alone do (and NaN, infinity or another size fail); `warn` are limits that never fail. `part` and `layer`
    choose within EXRs. `variances` and `samples` of the two images are used where the files lack them; `noise` and
    `detectable_bias` as in `compare`.
    """

    part: str | None = None
    layer: str | None = None
    tolerance: float = 1e-5
    false_alarm_rate: float = 1e-3
    noise: Literal["both", "reference", "none"] = "both"
    detectable_bias: float = 0.1
    flip: bool = False
    limits: "Limits | None" = None
    warn: "Limits | None" = None
    variances: tuple[Path | None, Path | None] = (None, None)
    samples: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < math.inf:
            raise InputError("tolerance", "a finite number > 0", self.tolerance)
