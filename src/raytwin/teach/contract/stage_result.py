"""What came of one stage: the record that is written, read, shown and scored."""

import msgspec

from raytwin.explain.catalogue import FACTS

Faults = tuple[tuple[str, str], ...]
"""(name, sentence) of each mistake."""


class CaseResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One call: what it `shows`, whether it passed; its `error`, None where there is no number; `wrong`: of its values,
    the share that is off by more than the tolerance."""

    shows: str
    passed: bool
    error: float | None = None
    wrong: float = 1.0


class StageResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`error`: the worst case's, in `unit`, None where there is no number (it raised, another shape, NaN).

    `sentence`: for the student. `hint`: the line of theirs to look at. `causes`: names of the faults that explain all
    cases, empty where none does or all is correct; more than one: they explain it equally. `faults`: name and
    sentence of the first. `inputs`, `expected`, `got`: of the worst value, in short. `wrong`: the
    share of all values that are off by more than the tolerance. `exact`: whether the causes leave nothing unexplained.
    """

    stage: str
    passed: bool
    error: float | None
    tolerance: float
    unit: str
    sentence: str
    causes: tuple[str, ...] = ()
    faults: Faults = ()
    hint: str = ""
    inputs: str = ""
    expected: str = ""
    got: str = ""
    wrong: float = 0.0
    cases: tuple[CaseResult, ...] = ()
    exact: bool = True

    @property
    def sureness(self) -> str:
        """`proved` for the one known fault that gives these numbers in all cases, of which two at least are wrong, so
        that each confirms what the other selects. `likely` for several."""
        if not self.causes:
            return ""
        one = len(self.causes) == 1 and self.exact
        return "proved" if one and sum(not case.passed for case in self.cases) > 1 else "likely"

    @property
    def said(self) -> tuple[str, ...]:
        """What is wrong, the surest first."""
        return with_hint((self.sentence,), self.hint, self.sureness, self.faults, raised=not self.got)

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        return f"{'PASS' if self.passed else 'FAIL'}  {self.stage}: " + "\n      ".join(self.said)


def says_why(sureness: str, faults: Faults) -> bool:
    """Whether a cause is proved, and not only what is seen."""
    return sureness == "proved" and not any(name in FACTS for name, _ in faults)


def with_hint(said: tuple[str, ...], hint: str, sureness: str, faults: Faults, raised: bool) -> tuple[str, ...]:
    """Sentences, with the line to look at behind an error and a cause that is proved, and before what is likely.

    It replaces what names no cause.
    """
    if not hint:
        return said
    if says_why(sureness, faults):
        return (*said[:1], f"{MEND} {hint}", *said[1:])
    if raised:
        return (*said, hint)
    return (hint, *said) if faults else (hint,)


MEND = "a place to mend it:"
"""Stands before a repair where the mistake is known."""
