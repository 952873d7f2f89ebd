"""Samplers: alarms on correct ones, and at how many draws wrong ones are seen, under which name.

`python -m measure.samplers [alarms|wrong] [COUNT]` prints the tables of docs/measured.md: COUNT seeds of each correct
sampler (1000).
Each seed draws 16384 directions of one of the two cases. Wrong ones take the two numbers the other way round.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from correct_samplers import CORRECT, PLAIN
from measure import record

from raytwin.teach.contract.check_function import judge_function
from raytwin.teach.contract.loading import arrays_of
from raytwin.teach.contract.stage import Case
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.contract.stages.samplers import ALARMS_PER_CASE, DRAWS, SAMPLER_TOLERANCE, SAMPLERS, Drawn, faults

SEEDS = 20
"""Sets of numbers for each number of draws."""
OFTEN = 0.9
"""Share of them in which a mistake has to fail to be seen."""

Wrong = Callable[..., Any]
KNOWN = {stage: LESSONS[stage].cases(0) for stage in PLAIN}
"""The two cases of each stage."""


def planted(stage: str, name: str) -> tuple[str, str, Wrong]:
    """The first way of a mistake that has a name."""
    way = next(ways[0] for fault, _, ways in faults(stage) if fault == name)
    return stage, name, lambda u, *parameters: way(u[:, ::-1], *parameters)


WRONG: tuple[tuple[str, str, Wrong], ...] = (
    planted("sample_cosine", "even over the hemisphere"),
    planted("sample_cosine", "even over the sphere"),
    planted("sample_cosine", "root missing"),
    planted("sample_cosine", "Jacobian missing"),
    planted("sample_cosine", "half a turn"),
    planted("sample_hemisphere", "Lambert's density"),
    planted("sample_hemisphere", "1 / π for 1 / 2π"),
    planted("sample_cone", "even over the disk"),
    planted("sample_cone", "not divided by the pdf"),
    planted("sample_phong", "n for n + 1"),
    planted("sample_phong", "n + 2 for n + 1"),
    planted("sample_phong", "pdf of the lobe"),
    ("sample_cosine", "one number for both", lambda u: PLAIN["sample_cosine"](u[:, [0, 0]])),
    ("sample_cosine", "u to the power 1.05", lambda u: PLAIN["sample_cosine"](u ** [1.05, 1])),
    ("sample_cosine", "numbers in steps of 1 / 64", lambda u: PLAIN["sample_cosine"](np.floor(64 * u) / 64)),
)
"""Stage, what is wrong, and the function; the last three have no name in the textbook."""


def drawn_by(stage: str, function: Wrong, draws: int, seed: int) -> list[Drawn]:
    """What a function draws in each case, from so many random numbers."""
    made = []
    for number, case in enumerate(KNOWN[stage]):
        u = np.random.default_rng([seed, number]).uniform(size=(draws, 2))
        args = u, *case.args[1:]
        made.append(Drawn(SAMPLERS[stage], Case(case.shows, args, ()), arrays_of(function(*args))))
    return made


def alarms(count: int) -> list[list[str]]:
    """A row per correct sampler: seeds that alarm, and p-values below 1 %."""
    rows = []
    for name, (stage, function) in CORRECT.items():
        p, failed = [], 0
        for seed in range(count):
            one = drawn_by(stage, function, DRAWS, seed)[seed % 2]
            p.append(one.p_value(one.sampler))
            failed += (one.errors() > SAMPLER_TOLERANCE).any()
        rows.append([name, stage, f"{failed} of {count}", f"{sum(one < 0.01 for one in p)} of {len(p)}"])
    return rows


def seen_at(stage: str, function: Wrong) -> str:
    """The fewest draws, of powers of two, with which a case fails in most sets of numbers."""
    for draws in (1 << k for k in range(21)):
        failed = [any((one.errors() > SAMPLER_TOLERANCE).any() for one in drawn_by(stage, function, draws, seed))
                  for seed in range(SEEDS)]  # fmt: skip
        if np.mean(failed) >= OFTEN:
            return str(draws)
    return "not by 1048576"


def main(part: str = "", count: str = "1000") -> None:
    if part != "wrong":
        columns = ["correct sampler", "function", f"alarms at {ALARMS_PER_CASE:g}", "chi-square p below 0.01"]
        record.table("teach", "samplers-alarms", columns, alarms(int(count)), "python -m measure.samplers alarms")
    if part != "alarms":
        rows = []
        for stage, wrong, function in WRONG:
            named = judge_function(LESSONS[stage], function, 3).causes
            rows.append([stage, wrong, seen_at(stage, function), " or ".join(named) or "no name"])
        columns = ["function", "what is wrong", "draws until it is seen", "name it gets"]
        record.table("teach", "samplers-wrong", columns, rows, "python -m measure.samplers wrong")


if __name__ == "__main__":
    main(*record.arguments())
