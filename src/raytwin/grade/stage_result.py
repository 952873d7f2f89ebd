"""What came of one stage: the record that is written, read, shown and scored."""

import msgspec


class CaseResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One call: what it `shows`, whether it passed; its `error`, None where there is no number; `wrong`: of its values,
    the share that is off by more than the tolerance."""

    shows: str
    passed: bool
    error: float | None = None
    wrong: float = 1.0


class StageResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`error`: the worst case's, in `unit`, None where there is no number (it raised, another shape, NaN).

    `sentence`: for the student. `causes`: names of the variants that explain all cases, empty where none does or all is
    right; more than one: they explain it equally. `inputs`, `expected`, `got`: of the worst value, in short. `wrong`:
    the share of all values that are off by more than the tolerance.
    """

    stage: str
    passed: bool
    error: float | None
    tolerance: float
    unit: str
    sentence: str
    causes: tuple[str, ...] = ()
    inputs: str = ""
    expected: str = ""
    got: str = ""
    wrong: float = 0.0
    cases: tuple[CaseResult, ...] = ()

    def __str__(self) -> str:
        return f"{'PASS' if self.passed else 'FAIL'}  {self.stage}: {self.sentence}"
