"""How well the ready rubric sees and names slips in students' texts: `python -m measure.planted_slips [N] [SEED]`.

Slips of the operators, as the textbook gets them, are planted in two students' texts, N (16) in each, drawn by SEED
(0), equally many of each operator. What does not run, or changes nothing in cases and scenes that the rubric does not
have, is left out and counted. Each is graded with the ready rubric. What a student reads first is correct if it is

- a change of the line that the slip is on, which makes everything correct: the slip undone, or an equivalent of it;
- or a mistake of the part of the tracer that the slip is in, proved.
"""

import ast
import difflib
import re
import resource
import signal
import sys
import tempfile
import types
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from measure import record
from starter_submissions import PLAIN
from tracers_by_students import BOARD_FRAME

from raytwin.explain.catalogue import FAULTS
from raytwin.explain.draw_scene import LARGER, draw_scene
from raytwin.explain.edit import Edit
from raytwin.explain.edits import edits
from raytwin.explain.parametric_faults import FAMILIES
from raytwin.explain.repair import kind_of
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.teach.contract.check_function import call_stage
from raytwin.teach.contract.stage import Case
from raytwin.teach.contract.stage_table import CONTRACT
from raytwin.teach.grade.grade_submission import grade_submission, job_of
from raytwin.teach.grade.result import Result
from raytwin.teach.grade.rubric import READY, read_rubric

MOST = 1.35
"""Weight: what is more far-fetched is left out."""
RARER = {
    "a square root is missing": 0.6, "a square is missing": 0.3, "the absolute value is missing": 0.6,
    "a bound of 0 is missing": 0.6, "it is not made unit": 0.6, "it is not transposed": 0.6,
    "a division by pi is missing": 0.3, "remove a division by pi": 0.3, "there are too few steps": 9.0,
    "this should be NaN": 9.0, "the factor ... is missing": 9.0,
    "the divisor ... is missing": 9.0, "the term ... is missing": 9.0,
}  # fmt: skip
"""Kind of repair -> weight that is added where its reverse is a mistake: few take a root that is not wanted."""
SAME = 1e-9
"""Of the scale: what changes less changes nothing."""
FIX = re.compile(r"line (\d+): (.*); `(.*)` in place of `(.*)` makes everything correct$")
"""The third level of hints."""

TEXTS = {"arrays": PLAIN, "render alone": BOARD_FRAME}
CAMERA, SOLVER, NORMALS, LIGHT, REST = (
    {"camera"}, {"solver"}, {"normals"}, {"light"}, {"order", "normals", "light", "shadow", "output", "solver"},
)  # fmt: skip
STAGES: dict[str, set[str]] = {
    **dict.fromkeys(("undo_lens", "back_project", "camera_rays", "directions"), CAMERA),
    **dict.fromkeys(("intersect_sphere", "intersect_plane", "hit"), SOLVER | {"order", "shadow"}),
    **dict.fromkeys(("normal", "normalize"), NORMALS | {"solver", "camera"}),
    "shade": LIGHT, "hit_points": {"order", "solver"}, "in_shadow": {"shadow"},
    "render": REST | {"camera"},
}  # fmt: skip
"""Function or method -> stages of the mistakes that may be told of a slip in it."""


@dataclass(frozen=True)
class Planted:
    """`before`, in a function of a text, became `after`; `lines`: those that differ, `source`: the text with it."""

    text: str
    function: str
    operator: str
    before: str
    after: str
    lines: range
    source: str

    def __str__(self) -> str:
        return f"{self.text}, {self.function}, line {self.lines[0]}: `{self.before}` -> `{self.after}`"


# ------------------------------------------------------------------------------------------ planting


def slips_of(name: str) -> list[tuple[str, Edit]]:
    """All slips of a text: (function, edit)."""
    return [
        (function, edit)
        for unit, function in _functions(ast.parse(TEXTS[name]))
        for edit in edits(unit)
        if edit.weight + RARER.get(kind_of(edit.operator), 0.0) <= MOST
    ]


def planted(name: str, function: str, edit: Edit) -> Planted | None:
    """The text with the slip; None where it cannot be written into it."""
    text = TEXTS[name]
    if not (source := written_into(text, edit)):
        return None
    found = difflib.SequenceMatcher(None, text.split("\n"), source.split("\n"), False).get_opcodes()
    changed = [(first, end) for kind, _, _, first, end in found if kind != "equal"]
    if not changed:
        return None
    lines = range(changed[0][0] + 1, max(changed[-1][1], changed[0][0] + 1) + 1)
    return Planted(name, function, kind_of(edit.operator), edit.before, edit.after, lines, source)


def _functions(tree: ast.Module) -> Iterator[tuple[ast.FunctionDef, str]]:
    for one in tree.body:
        inner = one.body if isinstance(one, ast.ClassDef) else [one]
        yield from ((f, f.name) for f in inner if isinstance(f, ast.FunctionDef) and f.name != "estimate_pose")


def written_into(text: str, edit: Edit) -> str:
    """The text with the edit, every other character as it was; empty where a part has no place in the text."""
    parts = []
    for old, new in edit.parts:
        if getattr(old, "end_lineno", None) is None:
            return ""
        place: Any = old
        begin = _place(text, place.lineno, place.col_offset)
        end = _place(text, place.end_lineno, place.end_col_offset)
        whole = new if isinstance(new, list) else [new]
        words = "\n".join(ast.unparse(ast.fix_missing_locations(one)) for one in whole)
        fits = isinstance(whole[0], ast.stmt | ast.Name | ast.Constant | ast.Call | ast.Attribute | ast.Subscript)
        indented = words.replace("\n", "\n" + " " * place.col_offset)
        parts.append((begin, end, indented if fits or isinstance(old, ast.keyword) else f"({words})"))
    for begin, end, words in sorted(parts, reverse=True):
        text = text[:begin] + words + text[end:]
    try:
        ast.parse(text)
    except SyntaxError:
        return ""
    return text


def _place(text: str, line: int, column: int) -> int:
    return sum(len(one) + 1 for one in text.split("\n")[: line - 1]) + column


# ------------------------------------------------------------------------------------------ what changes nothing


def stop(number: int, frame: object) -> None:
    raise TimeoutError


@cache
def probes() -> dict[str, list[Case]]:
    """Cases and scenes that the rubric has not: function -> calls."""
    found = {name: stage.cases(77_001) for name, stage in CONTRACT.items() if name != "estimate_pose"}
    for k in range(4):
        scene = as_arrays(draw_scene(77_100 + k, (60, 44), scale=(1.0, LARGER)[k % 2]), ("shadow", "lambert")[k // 3])
        for name in ("hit_points", "render"):
            found[name].append(Case("", (scene,), (np.asarray(CONTRACT[name].reference(scene)),)))
    return found


def values(source: str) -> list[np.ndarray] | None:
    """What the text's functions return; None where one of them does not run."""
    module = types.ModuleType("planted")
    sys.modules["planted"] = module
    got: list[np.ndarray] = []
    try:
        signal.setitimer(signal.ITIMER_VIRTUAL, 20)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            exec(compile(source, "planted.py", "exec"), module.__dict__)
            for name, cases in probes().items():
                if hasattr(module, name):
                    for answer in call_stage(CONTRACT[name], getattr(module, name), cases):
                        if isinstance(answer, str):
                            return None
                        got += answer
    except Exception:
        return None
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    return got


@cache
def right_values(name: str) -> list[np.ndarray]:
    got = values(TEXTS[name])
    assert got is not None
    return got


def change(right: Sequence[np.ndarray], got: Sequence[np.ndarray]) -> float:
    """The largest difference, of the scale of the correct one; infinite where one is no number or the shape differs."""
    worst = 0.0
    for a, b in zip(right, got, strict=True):
        if a.shape != b.shape:
            return np.inf
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        with np.errstate(all="ignore"):
            off = np.where(same, 0.0, np.abs(a - b) / max(1e-300, float(np.abs(a[np.isfinite(a)]).max(initial=0))))
        worst = max(worst, float(np.where(np.isnan(off), np.inf, off).max(initial=0)))
    return worst


def drawn_slips(name: str, count: int, seed: int, counts: Counter[str]) -> Iterator[tuple[Planted, float]]:
    """So many slips of a text that change something, and by how much: of each operator one, then a second, ..."""
    rng = np.random.default_rng(seed)
    kinds: dict[str, list[tuple[str, Edit]]] = {}
    for function, edit in slips_of(name):
        kinds.setdefault(kind_of(edit.operator), []).append((function, edit))
    counts["slips of the operators"] += sum(map(len, kinds.values()))
    piles = [[pile[k] for k in rng.permutation(len(pile))] for _, pile in sorted(kinds.items())]
    piles = [piles[k] for k in rng.permutation(len(piles))]
    drawn: set[str] = set()
    for one in [one for some in zip_longest(*piles) for one in some if one is not None]:
        if count == 0:
            return
        slip = planted(name, *one)
        if slip is None or slip.source in drawn:
            continue
        drawn.add(slip.source)
        counts["drawn"] += 1
        made = values(slip.source)
        by = np.inf if made is None else change(right_values(name), made)
        if made is None:
            counts["do not run"] += 1
        elif by <= SAME:
            counts["change nothing"] += 1
        else:
            count -= 1
            yield slip, by


# ------------------------------------------------------------------------------------------ grading


def first_said(slip: Planted, result: Result) -> tuple[str, bool, bool]:
    """What a student with this result reads first, whether that is correct, and whether it is called proved."""
    worst = result.worst
    assert worst is not None
    first = worst.sentences[0] if worst.sentences else ""
    if told := FIX.match(first):
        return first, int(told[1]) in slip.lines, True
    if worst.status == "error":
        raised = re.search(r"\(line (\d+)", first)
        return first, raised is not None and int(raised[1]) in slip.lines, False
    proved = worst.sureness == "proved"
    names = {name for name, _ in worst.faults[:1]}
    stages = {fault.stage for fault in (*FAULTS, *FAMILIES) if fault.name in names}
    return first, proved and bool(names) and stages <= STAGES[slip.function], proved and bool(names)


ROWS = (
    "slips of the operators", "drawn", "do not run", "change nothing", "planted", "detected", "named first", "proved",
    "proved and correct",
)  # fmt: skip


def main(number: str = "16", seed: str = "0") -> int:
    """Print each slip, what is read of it first, and the counts."""
    resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))  # a slip may ask for arrays without end
    signal.signal(signal.SIGVTALRM, stop)
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        file, rubric = Path(folder, "submission.py"), Path(folder, "rubric.toml")
        ready = READY.read_text(encoding="utf-8")
        rubric.write_text(ready.replace("\nseed =", "\nhints = 3\nseed =", 1), encoding="utf-8")
        some = (drawn_slips(name, int(number), int(seed), counts) for name in TEXTS)
        for slip, by in (one for row in zip_longest(*some) for one in row if one is not None):
            file.write_text(slip.source, encoding="utf-8")
            result = grade_submission(job_of("a", file, rubric, read_rubric(rubric)))
            counts["planted"] += 1
            if all(e.status in ("pass", "missing") for e in result.exercises):
                print(f"UNSEEN {slip} ({slip.operator}): changes {by:.1e}", flush=True)
                continue
            first, correct, proved = first_said(slip, result)
            counts += Counter(detected=1)
            counts += Counter({"named first": correct, "proved": proved, "proved and correct": proved and correct})
            print(f"{'ok' if correct else 'WRONG'} {slip} ({slip.operator}): {first[:170]}", flush=True)
    rows = [(row, counts[row]) for row in ROWS]
    record.table("causes", "planted", ["", "count"], rows, f"python -m measure.planted_slips {number} {seed}")
    return 0


if __name__ == "__main__":
    sys.exit(main(*record.arguments()))
