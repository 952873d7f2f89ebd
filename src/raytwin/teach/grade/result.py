"""What came of one submission: the record that is written, shown, scored and handed to Gradescope and others."""

from typing import Literal

from raytwin.scene import Record
from raytwin.teach.grade.rubric import Visibility

Status = Literal["pass", "fail", "error", "missing", "limit", "broken"]
"""`fail`: other numbers than expected; `error`: it raised, or gave no array of the correct kind; `missing`: no such
function; `limit`: too much time, memory or output; `broken`: its process ended."""


class Again(Record, frozen=True):
    """What came of a picture that was asked for once more, with correct functions in place of the failed ones.

    `own`: of the functions that it is made of, the share that was the submission's own.
    """

    passed: bool
    error: float | None
    wrong: float | None
    own: float = 1.0


class MarkedPart(Record, frozen=True):
    """A case or scene: what it `shows`; `error`: in the exercise's unit, None where there is no number; `wrong`: the
    share of values that are off; `share`: of its points; `problem`: in words, where there are no numbers."""

    shows: str
    passed: bool
    share: float = 0.0
    error: float | None = None
    wrong: float | None = None
    seconds: float = 0.0
    problem: str = ""
    again: Again | None = None


class CodeLine(Record, frozen=True):
    """A line of the submission's text; `here`: the one to look at."""

    number: int
    text: str
    here: bool


class Marked(Record, frozen=True):
    """An exercise, marked. `sentences`: for the student, the first is the cause where one is named (`causes`, by name).

    `faults`: (name, sentence) of each mistake that was made; `causes` has those, too, that explain it as well.
    `code`: lines of the submission that the sentences speak of.
    `inputs`, `expected`, `got`: of the worst value of a stage's cases.
    `repair`: what was wrong where one change of the text makes all right, in an operator's words. `mistakes`: what each
    explains all that is wrong here, and shows elsewhere, too. `because`: functions that failed on their own, with
    correct ones of which this picture is correct. `same_as`: the exercise that pays for the same mistake. `followed`:
    of the points, those that are kept since it is paid for.
    `judged_by`: the statistical test that decides in place of a tolerance.
    """

    name: str
    stage: str
    status: Status
    points: float = 0.0
    of: float = 0.0
    visibility: Visibility = "visible"
    unit: str = ""
    tolerance: float = 0.0
    judged_by: str = ""
    sentences: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    sureness: str = ""
    faults: tuple[tuple[str, str], ...] = ()
    repair: str = ""
    mistakes: tuple[str, ...] = ()
    because: tuple[str, ...] = ()
    same_as: str = ""
    followed: float = 0.0
    code: tuple[CodeLine, ...] = ()
    inputs: str = ""
    expected: str = ""
    got: str = ""
    parts: tuple[MarkedPart, ...] = ()

    @property
    def error(self) -> float | None:
        """The worst part's; None where one has no number."""
        errors = [p.error for p in self.parts]
        return None if None in errors or not errors else max(e for e in errors if e is not None)

    @property
    def named(self) -> dict[str, str]:
        """Name -> sentence of what is wrong. A line that one change repairs is surer than names that are not proved."""
        proved = {name: sentence for name, sentence in self.faults if name in self.mistakes}
        return proved or ({f"{self.stage}: {self.repair}": ""} if self.repair else dict(self.faults))

    @property
    def follows(self) -> bool:
        """Whether it is wrong only by a mistake that another exercise pays for."""
        return bool(self.because or self.same_as)

    @property
    def said(self) -> tuple[str, ...]:
        """The sentences, and what is kept."""
        if not self.followed:
            return self.sentences
        payer = " and ".join(f"`{name}`" for name in self.because) or f"The same mistake in {self.same_as}"
        have = "have" if len(self.because) > 1 else "has"
        kept = f"{self.followed:.2f}".rstrip("0").rstrip(".")
        return (*self.sentences, f"{payer} {have} cost you points already, so you keep {kept} here.")

    @property
    def seconds(self) -> float:
        """Seconds per part, on average."""
        return sum(p.seconds for p in self.parts) / max(1, len(self.parts))


class Picture(Record, frozen=True):
    """A picture that is wrong. `thumb`: expected, got and error side by side, a PNG as a data URL.

    `planes`: as the viewer takes them, JSON, empty where others are worse. `full`: the error of full colour, 0: none.
    """

    exercise: str
    shows: str
    thumb: str
    planes: str = ""
    stops: float = 0.0
    share: float = 1e-5
    scale: float = 1.0
    full: float = 0.0


class Result(Record, frozen=True):
    """`student`: the name of what was handed in. `key`: of the content, the rubric and the seed. `problem`: why nothing
    ran. `grader_fault`: the grader failed, not the submission; it is graded again next time.
    `own_seconds`: what the submission itself took, of `seconds` in all. `open_locks`: those of the sandbox that did not
    hold. `graded`: when, to the minute, UTC."""

    student: str
    key: str
    title: str
    exercises: tuple[Marked, ...]
    problem: str = ""
    seed: int = 0
    own_seconds: float = 0.0
    seconds: float = 0.0
    printed: str = ""
    notes: tuple[str, ...] = ()
    open_locks: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    grader_fault: bool = False
    graded: str = ""

    @property
    def points(self) -> float:
        return round(sum(e.points for e in self.exercises), 4)

    @property
    def of(self) -> float:
        return sum(e.of for e in self.exercises)

    @property
    def causes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(c for e in self.exercises for c in e.causes))

    @property
    def faults(self) -> dict[str, str]:
        """Name -> sentence of each mistake, once."""
        return {name: sentence for e in self.exercises if not e.follows for name, sentence in e.named.items()}

    @property
    def to_mend(self) -> int:
        """Exercises with a mistake of their own."""
        return sum(e.status != "pass" and not e.follows for e in self.exercises)

    @property
    def all_passed(self) -> bool:
        return not self.problem and all(e.status == "pass" for e in self.exercises)

    @property
    def worst(self) -> Marked | None:
        """The exercise to look at first: one that ended the process, then the surest cause, what is not there, and last
        what follows from others."""
        bad = [e for e in self.exercises if e.status != "pass"]
        return min(bad, key=lambda e: (e.follows, WORST.index(e.status), SUREST.index(e.sureness)), default=None)

    @property
    def first_problem(self) -> str:
        """In words, of the exercise to look at first."""
        return self.worst.sentences[0] if self.worst and self.worst.sentences else self.problem


WORST: tuple[Status, ...] = ("limit", "broken", "error", "fail", "missing")
SUREST = ("proved", "likely", "")
"""`sureness`, from the surest; proved: by a repair, or by predictions that leave nothing."""
