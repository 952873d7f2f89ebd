"""Why pictures are wrong: the causes that are named, how certain they are, and the sentences of a report."""

from dataclasses import dataclass
from typing import Literal

from raytwin.compare.finding import Finding, notes

Certainty = Literal["correct", "proved", "likely", "unknown"]


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
class Explanation:
    """`causes`: the one that is named, then others that explain as much; `sentences`: the cause's, and what else is
    said; `where`: where the pictures are wrong; `explained`: share of the squared error.
    """

    certainty: Certainty
    causes: tuple[Cause, ...] = ()
    sentences: tuple[str, ...] = ()
    where: str = ""
    explained: float = 0.0

    @property
    def cause(self) -> Cause | None:
        """The one that is named."""
        return self.causes[0] if self.causes else None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """For a report: the cause, what else is said, and what it explains; or where the pictures are wrong."""
        if self.certainty == "correct":
            return ()
        if not self.causes:
            return Finding("unknown", self.where), *notes(self.sentences)
        percent = 100 * min(self.explained, 0.9999 if self.explained < 1 - 1e-9 else 1)
        share = (f"this explains {percent:.4g} % of the squared error",) if self.explained > 0 else ()
        first, *others = self.sentences
        return Finding(self.certainty, first), *notes([*share, *others, *filter(None, [self.where])])
