"""How often the correct cause is named: `python -m measure.named_causes students | pairs [N]`.

Mistakes in tracers that students wrote, and correct tracers, which must not be blamed; or faults of the catalogue
planted by two. Drawn scenes as a rubric has them: three with shadows, one without.
"""

import time
from collections.abc import Sequence
from itertools import count, islice

import numpy as np
from measure import record
from tracers_by_students import CORRECT, MISTAKES, mistaken, run

from raytwin.explain.catalogue import FAULTS
from raytwin.explain.changes import Fault, chain
from raytwin.explain.diagnosis import FEWEST_PIXELS, SubmittedImage, diagnose
from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.explanation import Explanation
from raytwin.explain.predict import Pipeline, planted, written
from raytwin.renderers.scene_exchange import as_arrays

SCENES = [(draw_scene(seed), "shadow" if seed < 3 else "lambert") for seed in range(4)]


def pictures_with(ways: Sequence[Pipeline]) -> list[SubmittedImage]:
    """What a tracer with these mistakes makes of every scene."""
    return [SubmittedImage(scene, planted(scene, *ways, shadows=rung == "shadow"), rung=rung) for scene, rung in SCENES]


class Tally:
    """Counts, and a line for each that is not named first."""

    def __init__(self) -> None:
        self.counts = dict.fromkeys(
            ("all", "hidden", "detected", "named first", "first three", "false though proved"), 0
        )
        self.seconds = 0.0

    def take(self, wanted: set[str], label: str, made: Explanation, seconds: float) -> None:
        """`wanted`: names of which one must come first."""
        first = made.cause.name if made.cause else "unknown"
        others = [cause.name for cause in made.causes[1:3]]
        self.seconds += seconds
        self.counts["all"] += 1
        self.counts["hidden"] += made.certainty == "correct"
        self.counts["detected"] += made.certainty != "correct"
        near = bool(wanted & {first, *others})
        self.counts["named first"] += first in wanted
        self.counts["first three"] += near
        self.counts["false though proved"] += made.certainty == "proved" and not near
        if first not in wanted and made.certainty != "correct":
            print(f"{label}: {first} or {others}, {made.certainty} {made.sentences[:1]}", flush=True)

    def report(self, what: str, added: dict[str, str] | None = None) -> None:
        """Print the counts as the table `what`, rows `added` below them."""
        rows = [*self.counts.items(), *(added or {}).items()]
        each = f"{self.seconds / max(self.counts['all'], 1):.2f}"
        command = f"python -m measure.named_causes {' '.join(record.arguments())}"
        record.table("causes", what, ["", "count"], [*rows, ("CPU seconds each", each)], command)


def timed(views: list[SubmittedImage]) -> tuple[Explanation, float]:
    start = time.process_time()
    return diagnose(views), time.process_time() - start


def pictures(text: str) -> list[SubmittedImage]:
    made = run(text, [as_arrays(scene, rung) for scene, rung in SCENES])
    return [SubmittedImage(scene, picture, rung=rung) for (scene, rung), picture in zip(SCENES, made, strict=True)]


def of_students() -> None:
    tally, blamed = Tally(), 0
    for variation in CORRECT:
        blamed += bool(timed(pictures(mistaken(*variation)))[0].cause)
    for wanted, text, old, new in MISTAKES:
        made, seconds = timed(pictures(mistaken(text, old, new)))
        tally.take(set(wanted), wanted[0], made, seconds)
    tally.report("students", {"correct tracers that were blamed": f"{blamed} of {len(CORRECT)}"})


def seen_of(faults: Sequence[tuple[Fault, Pipeline]]) -> list[Fault]:
    """Those without which the pictures would be others."""
    whole = pictures_with([way for _, way in faults])
    kept = []
    for fault in faults:
        without = pictures_with([way for other, way in faults if other is not fault[0]])
        with np.errstate(invalid="ignore"):
            pairs = zip(whole, without, strict=True)
            if any((~(np.abs(a.shown - b.shown) <= 1e-5)).any(axis=-1).sum() >= FEWEST_PIXELS for a, b in pairs):
                kept.append(fault[0])
    return kept


def can_be_made(faults: Sequence[tuple[Fault, Pipeline]]) -> bool:
    """Whether the textbook can have all of these."""
    try:
        written(chain(*(way for _, way in faults)))
    except ValueError:
        return False
    return True


def of_pairs(number: int) -> None:
    """Diagnose pairs of planted faults. Of two, one that shows beside the other has to come first."""
    rng, tally = np.random.default_rng(0), Tally()
    direct = [f for f in FAULTS if f.ways]
    drawn = (rng.choice(len(direct), 2, replace=False) for _ in count())
    two = ([(direct[i], direct[i].ways[0]) for i in pair] for pair in drawn)
    for faults in islice(filter(can_be_made, two), number):
        names = {f.name for f in seen_of(faults)}
        made, seconds = timed(pictures_with([way for _, way in faults]))
        tally.take(names, " + ".join(f.name if f.name in names else f"({f.name})" for f, _ in faults), made, seconds)
    tally.report("pairs")


def main(what: str, number: str = "60") -> None:
    of_students() if what == "students" else of_pairs(int(number))


if __name__ == "__main__":
    main(*record.arguments())
