"""Which slips the ready rubric does not see: `nice python -m measure.undetected_slips [EVERY]`, in tests/.

Every slip of the operators (or each EVERY-th) is put into every function of the textbook. It is seen if a case of the
function's own fails, or a picture or the points of a drawn scene, as the ready rubric draws them. Of the others those
are told that change something in scenes that the rubric did not draw: these would pass unseen.
"""

import ast
import signal
import sys
import warnings
from collections import Counter
from functools import lru_cache

import numpy as np
from measure import record

from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.edit import Edit
from raytwin.explain.edits import edits
from raytwin.explain.predict import RIGHT, Pipeline, predictor, slip
from raytwin.explain.textbook import FUNCTIONS, Changes
from raytwin.teach.contract.check_function import call_stage, is_right
from raytwin.teach.contract.stage import PARTS_OF, wrong
from raytwin.teach.contract.stage_table import CONTRACT
from raytwin.teach.grade.questions import LARGER
from raytwin.teach.grade.rubric import READY, read_rubric

MOST = 1.5
"""Weight: what is more far-fetched is left out."""
OFF, SHARE = 1e-4, 1e-3
"""A picture is wrong where more than this share of its values is off by more than so much of its scale."""
STAGE = {part: stage for stage in CONTRACT for part in PARTS_OF.get(stage, (stage,))}
SEED = 0
PASSED_BY = 12
"""Scenes beside those of the rubric."""


@lru_cache(maxsize=64)
def looked_at(seed: int, rung: str, scale: float, points: bool):
    scene = predictor(draw_scene(seed, scale=scale), rung == "shadow", 3)
    return scene, scene.points(RIGHT) if points else scene.picture(RIGHT)


def shows(way: Pipeline, seed: int, rung: str, scale: float, points: bool = False) -> bool:
    """Whether the picture, or the points, of a drawn scene are wrong."""
    scene, right = looked_at(seed, rung, scale, points)
    try:
        signal.setitimer(signal.ITIMER_VIRTUAL, 5)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            made = scene.points(way) if points else scene.picture(way)
            same = (made == right) | (np.isnan(made) & np.isnan(right))
            return bool((~(same | (np.abs(made - right) <= OFF * scene.brightest))).mean() > SHARE)
    except Exception:  # what does not run is seen
        return True
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def fails_a_case(function: str, changes: Changes) -> bool:
    stage = CONTRACT[STAGE[function]]
    try:
        signal.setitimer(signal.ITIMER_VIRTUAL, 5)
        made = wrong(stage.name, changes)
        return any(not is_right(stage, c, call_stage(stage, made, [c])[0]) for c in stage.cases(SEED))
    except Exception:
        return True
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def drawn() -> list[tuple[int, str, float, bool]]:
    """What the ready rubric draws: (seed, rung, scale, points)."""
    return [
        (SEED + 1000 * number + i, e.rung, LARGER if e.stage == "render" and i % 2 else 1.0, e.stage == "hit_points")
        for number, e in enumerate(read_rubric(READY).exercises) for i in range(e.drawn)
    ]  # fmt: skip


def stop(number: int, frame: object) -> None:
    raise TimeoutError


def changed(function: str, statement: ast.FunctionDef, edit: Edit) -> Changes:
    """The function's whole text, and the same with the edit."""
    return ((FUNCTIONS[function], ast.unparse(edit.applied(statement)) + "\n"),)


def main(every: str = "1") -> int:
    signal.signal(signal.SIGVTALRM, stop)
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    for function, text in FUNCTIONS.items():
        (statement,) = ast.parse(text).body
        assert isinstance(statement, ast.FunctionDef)
        for edit in [e for e in edits(statement) if e.weight <= MOST][:: int(every)]:
            changes = changed(function, statement, edit)
            way = slip(function, *changes)
            counts["slips"] += 1
            if function in STAGE and fails_a_case(function, changes):
                counts["seen by a case"] += 1
            elif any(shows(way, *one) for one in drawn()):
                counts["seen in a picture"] += 1
            elif any(shows(way, 70_000 + k, "shadow", (1.0, LARGER)[k % 2]) for k in range(PASSED_BY)):
                counts["unseen"] += 1
                print(f"unseen: {function}: {edit.before} -> {edit.after}", flush=True)
            else:
                counts["change nothing"] += 1
    command = f"python -m measure.undetected_slips {' '.join(record.arguments())}"
    record.table("causes", "undetected", ["", "count"], list(counts.items()), command)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
