"""What is said of wrong pictures: the cause that is named, how sure it is, and the sentences of a report."""

from dataclasses import dataclass
from typing import Literal

from raytwin.compare.finding import Finding, notes

Sureness = Literal["proved", "likely", "unknown"]


@dataclass(frozen=True)
class Cause:
    """A fault of the catalogue or of a family: `name`, `stage`, and `sentence`, what a student is told.

    `numbers`: how many were fitted. Of two causes that explain as well, the one with fewer stands.
    """

    name: str
    stage: str
    sentence: str
    numbers: int = 0


@dataclass(frozen=True)
class Diagnosis:
    """`cause`: what is wrong, None where it is unknown; `alternatives`: other causes that explain as much.

    `explained`: share of the squared error; `held_out`: of the worst scene's. `where`: where the pictures are wrong.
    `nearest`: the best cause where none suffices; `light`: factors of the parts of light (sun, shadow, sky), where they
    explain one of the pictures. `untried`: that the search left something out for want of time.
    """

    right: bool
    cause: Cause | None = None
    alternatives: tuple[Cause, ...] = ()
    explained: float = 0.0
    held_out: float | None = None
    sureness: Sureness = "unknown"
    where: str = ""
    nearest: Cause | None = None
    light: str = ""
    untried: str = ""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """For a report: the cause with its alternatives, then what it explains; or where it is wrong."""
        if self.right:
            return ()
        stopped = (self.untried,) if self.untried else ()
        if self.cause is None:
            near = ""
            if self.nearest is not None and self.explained >= 0.5:
                near = (
                    f"; nearest, explaining {100 * self.explained:.0f} % of the squared error: {self.nearest.sentence}"
                )
            light = f"; as if {self.light}" if self.light else ""
            return Finding("unknown", f"{self.where}{light}{near}"), *notes(stopped)
        said = [f"or, with the same effect here: {other.sentence}" for other in self.alternatives]
        share = f"this explains {_percent(self.explained)} of the squared error" if self.explained > 0 else ""
        if share and self.held_out is not None:
            share += f", of the scene that it explains least {_percent(self.held_out)}"
        said += filter(None, ("; ".join(filter(None, (share, self.where))), *stopped))
        return Finding(self.sureness, self.cause.sentence), *notes(said)


def _percent(x: float) -> str:
    return f"{100 * min(x, 0.9999 if x < 1 - 1e-9 else 1):.4g} %"
