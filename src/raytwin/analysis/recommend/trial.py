"""A way to the image while it is looked at: its error, its seconds, how simple it is."""

from dataclasses import dataclass

import numpy as np

from raytwin.analysis.recommend.converged import Error
from raytwin.analysis.recommend.recommendation import Row
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.subject_renderers import Filled, PathTraced
from raytwin.rungs import RUNGS
from raytwin.speed import ENGINES


@dataclass(eq=False)
class Tried:
    """A method, while it is looked at. `guess`: seconds at full size."""

    method: Renderer
    guess: float
    error: Error | None = None
    pixels: float | None = None
    call: Call | None = None
    seconds: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        return float(np.median(self.seconds)) if self.seconds else self.guess

    @property
    def least(self) -> float:
        """What a busy machine makes longer least."""
        return min(self.seconds, default=self.guess)

    @property
    def spread(self) -> float:
        return float(np.subtract(*np.quantile(self.seconds, (0.75, 0.25)))) if self.seconds else 0.0

    def row(self, reason: str) -> Row:
        m, e = self.method, self.error
        depth = m.depth if isinstance(m, PathTraced) else None
        engine = getattr(m, "engine", "numpy32")
        return Row(
            "none" if isinstance(m, Filled) else m.rung, 2 if depth is None and m.noisy else depth, engine, m.precision,
            m.sampling, m.samples, m.step, m.trim, m.name, e and e.value, e and e.most, self.pixels,
            self.median or None, self.spread if self.seconds else None, len(self.seconds), reason,
        )  # fmt: skip


def simplicity(method: Renderer) -> tuple[object, ...]:
    """Less is simpler: light, depth, rays, guesses; an engine and boxes that need less explaining."""
    light = 0 if isinstance(method, Filled) else list(RUNGS).index(method.rung)
    engine = list(ENGINES).index(getattr(method, "engine", "numpy64"))
    trim = ("none", "conic", "corners").index(method.trim or "none")  # the last may cut what is seen
    depth = (method.depth or 0) if isinstance(method, PathTraced) else 0
    return light, depth, method.samples, method.step, engine, trim
