"""Settings as records, each checked once, when it is made: keyword arguments in Python, options on the command line.

`cli.options.OPTIONS` has a row for each field that is an option.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from raytwin.errors import InputError, check_one_of
from raytwin.judging import Judging
from raytwin.rungs import MOST_SAMPLES, RUNGS, SAMPLINGS

if TYPE_CHECKING:
    from collections.abc import Callable

    from raytwin.renderers.renderer import Renderer
    from raytwin.study.rounds import Budget

SAMPLES_IF_EXACT, SAMPLES_IF_NOISY = 1, 64
"""The twin's samples per pixel where all are the same, and where they differ."""


@dataclass(frozen=True)
class CompareSettings:
    """How `compare_scene` renders both sides; checked when it is made.

    `rung` is the twin's. The tracer stands on `tracer_rung`, by default the highest up to there that a formula gives.
    `subject`: what is compared in the tracer's place: a name of `raytwin bench list`, FILE.py:FUNCTION, an image, a
    folder of images, a command, or a function of a scene (see `method`); `engine`, `solver` and `trim` are
    the tracer's. `photo`: whose camera pose is used. `size` (width, height) replaces the camera's. `cache` reuses
    the twin's renders and the photos' tags. `flip` adds the perceptual metric, which is slow. `light`: a
    light.toml in the place of the scene's sun and sky.

    `samples`: per pixel, of the twin and of a subject that takes them. Without it both come in rounds until the verdict
    is certain or the `budget` is spent: samples per pixel ("256") or a time ("30s"). `detectable_bias` of the whole
    image and `detectable_tile_bias` of any 24 x 24 pixels: what a pass must exclude (by default, while the budget
    lasts, 0.01 and 0.1).
    """

    rung: str = "shadow"
    tracer_rung: str | None = None
    subject: "Renderer | Callable[..., Any] | str | None" = None
    engine: str = "numpy64"
    solver: str = "robust"
    sampling: str = "center"
    samples: int | None = None
    budget: str | None = None
    detectable_bias: float | None = None
    detectable_tile_bias: float | None = None
    seed: int = 0
    photo: str | None = None
    size: tuple[int, int] | None = None
    trim: str = "conic"
    cache: bool = True
    flip: bool = False
    light: "str | Path | None" = None

    def __post_init__(self) -> None:
        from raytwin.fast import check_rows

        check_one_of("--rung", self.rung, RUNGS)
        check_one_of("--sampling", self.sampling, SAMPLINGS)
        if self.samples is not None and not 1 <= self.samples <= MOST_SAMPLES:
            raise InputError("--samples", f"a whole number from 1 to {MOST_SAMPLES}", self.samples)
        if self.samples is not None and self.budget is not None:
            raise InputError("--budget", "no --samples beside it, which takes just as many", self.budget)
        self.judging, self.spending  # noqa: B018 (checked)
        check_one_of("--tracer-rung", self.climbed, list(RUNGS)[: list(RUNGS).index(self.rung) + 1])
        check_rows("shadow", self.engine, self.solver, self.trim)

    @property
    def judging(self) -> Judging:
        """What a pass must exclude."""
        try:
            return Judging(detectable_bias=self.detectable_bias, detectable_tile_bias=self.detectable_tile_bias)
        except InputError as error:  # named as it is typed
            raise InputError(f"--{error.where.replace('_', '-')}", *error.fields[1:]) from None

    @property
    def climbed(self) -> str:
        """The tracer's rung."""
        from raytwin.tracer import RADIANCE

        return self.tracer_rung or list(RADIANCE)[min(list(RUNGS).index(self.rung), len(RADIANCE) - 1)]

    @property
    def spending(self) -> "Budget":
        """What the rounds may spend."""
        from raytwin.study.rounds import Budget, parse_budget

        return Budget() if self.budget is None else parse_budget(self.budget)

    @property
    def twin_samples(self) -> int:
        return self.samples or (
            SAMPLES_IF_NOISY if RUNGS[self.rung].noisy or self.sampling == "area" else SAMPLES_IF_EXACT
        )


@dataclass(frozen=True)
class AugmentSettings:
    """How `augment_photos` draws; checked when it is made.

    `camera`: a camera.toml, whose K, distortion and board's shape count; without it the scene's own photos are
    calibrated. Each photo's pose comes from its own tags of `board` (the scene's, if none is named). `exposure`: the
    photo's linear value of radiance 1, by default 1. `light`: a light.toml in the place of the scene's sun and sky;
    then each photo's exposure is by default what its white paper shows. `boxes`: also draw the box of pixels that each
    sphere's work is trimmed to.
    """

    camera: str | Path | None = None
    board: str | Path | None = None
    exposure: float | None = None
    light: str | Path | None = None
    boxes: bool = False

    def __post_init__(self) -> None:
        if self.exposure is not None and not self.exposure >= 0:
            raise InputError("--exposure", "a number >= 0", self.exposure)


@dataclass(frozen=True)
class ReferenceSettings:
    """How a reference is made. What is None stays as in the old one, or is the default; `again`: even if up to date."""

    samples: int | None = None
    sampling: str | None = None
    size: tuple[int, int] | None = None
    again: bool = False
