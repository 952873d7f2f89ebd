"""How often each mistake was made: what is common is tried first, and named first of what explains as well.

`raytwin grade` adds the class's mistakes to those of its rubric and writes them to OUT/seen.toml. Copied beside a
rubric they are read with it. Only causes that were proved, or named by the instructor, count: a guess must
not feed on itself.
"""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from raytwin import files
from raytwin.grade.result import Result
from raytwin.grade.rubric import SEEN, Rubric

COUNTED = ("named", "proved")


def count_mistakes(results: Sequence[Result], rubric: Rubric) -> Counter[str]:
    """By name of the cause, or by what a repair put right, a student once each; with those of the rubric."""
    counts = Counter(rubric.seen)
    for result in results:
        sure = [e for e in result.exercises if e.sureness in COUNTED]
        counts.update({*(name for e in sure for name, _ in e.faults), *(e.repair for e in sure if e.repair)})
    return counts


def write_seen(results: Sequence[Result], rubric: Rubric, folder: Path) -> None:
    """Write `folder`/seen.toml, the most frequent first."""
    rows = [f"{json.dumps(name)} = {count}" for name, count in count_mistakes(results, rubric).most_common()]
    files.write_text(folder / SEEN, "\n".join(["[seen]", *rows, ""]))
