"""What grading a class costs: `nice python -m measure.class_cost FOLDER [N] [JOBS]`.

N (100) submissions, five scenes, JOBS (2) at a time.

A third are correct, most of the others have a mistake each, one in ten crashes, hangs, floods or is none. In seconds of
computing, since the clock tells of the machine's other work: the grader's own, and that of the submissions' processes.
"""

import resource
from functools import partial
from pathlib import Path

import submitted_tracers as tracers
from measure import record
from tracers_by_students import CORRECT, MISTAKES, mistaken

from raytwin.parallel import Workers, map_parallel
from raytwin.teach.grade.class_run import Job, jobs_of, run
from raytwin.teach.sandbox.sandbox import Code, Sandbox

RUBRIC = """
title = "A hundred tracers"
seed = 7
[[exercises]]
name = "image"
stage = "render"
scenes = ["single", "overlap"]
rung = "lambert"
points = 40
[[exercises]]
name = "shadows"
stage = "render"
drawn = 3
points = 60
[limits]
seconds = 60
seconds_a_call = 10
"""
BROKEN = (
    "",
    "def render(:",
    "import nothing_of_mine",
    "import os\nos._exit(1)",
    "def render(scene):\n    while True: pass",
    "def render(scene):\n    while True: print('x' * 100_000)",
    "def render(scene):\n    x = []\n    while True: x.append(bytearray(10**7))",
    "import os, time\ndef render(scene):\n    for _ in range(60): os.fork()\n    time.sleep(600)",
    "import ctypes\ndef render(scene): ctypes.string_at(0)",
    "def render(scene): return None",
)
SWAP = "\nfrom numpy import indices, minimum\ndef SWAP(img):\n    h, w = img.shape[:2]\n    v, u = indices((h, w))\n"
SWAP += "    return img[minimum(u, h - 1), minimum(v, w - 1)]\n"


def submissions(count: int) -> list[str]:
    right = [mistaken(*one) for one in CORRECT] + [tracers.RIGHT + f"\n# by {k}\n" for k in range(count)]
    wrong = [mistaken(text, old, new) + SWAP for _, text, old, new in MISTAKES[:: max(1, 100 // count)]]
    wrong = [*wrong, *(tracers.tracer(name) for name in ("pi", "gamma", "nan", "shape", "raises"))]
    broken = [text + f"\n# by {k}\n" for k in range(count) for text in BROKEN]
    chosen = [right[: count // 3], broken[: count // 10]]
    return [text for part in (*chosen, wrong[: count - sum(map(len, chosen))]) for text in part]


def cpu() -> tuple[float, float]:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return used[0].ru_utime + used[0].ru_stime, used[1].ru_utime + used[1].ru_stime


def measured(job: Job, out: str) -> tuple[float, ...]:
    before = cpu()
    run([job], Path(out), Workers())
    return tuple(b - a for a, b in zip(before, cpu(), strict=True))


def main(folder: Path, count: int = 100, jobs: int = 2) -> None:
    (folder / "in").mkdir(parents=True, exist_ok=True)
    (folder / "rubric.toml").write_text(RUBRIC)
    for number, text in enumerate(submissions(count)):
        (folder / "in" / f"student {number:03}.py").write_text(text)
    asked = jobs_of(folder / "in", folder / "rubric.toml")
    before = cpu()
    with Sandbox(Code(source="import numpy\ndef f(): pass", asked=("f",))):
        pass
    start = cpu()[1] - before[1]
    done = {
        d.thing.key: d.result for d in map_parallel(partial(measured, out=str(folder / "out")), asked, Workers(jobs))
    }
    results = run(asked, folder / "out", Workers())
    weight = sum(path.stat().st_size for path in (folder / "out").rglob("*") if path.is_file())
    rows = [
        ["submissions with a result", f"{len(done)} of {count}"],
        ["pages and results", f"{weight / 1e6:.0f} MB"],
    ]
    for name, chosen in (
        ("right", [r for r in results if r.all_passed]),
        ("wrong", [r for r in results if any(e.status == "fail" for e in r.exercises)]),
        ("neither", [r for r in results if not r.all_passed and all(e.status != "fail" for e in r.exercises)]),
    ):
        spent = [done[r.key] for r in chosen]
        own, theirs = (sum(s[k] for s in spent) / max(1, len(spent)) for k in (0, 1))
        rows.append([f"CPU time of the grader, {name} ({len(chosen)})", f"{own:.2f} s"])
        rows.append([f"CPU time of the submission's processes, {name}", f"{theirs:.2f} s"])
    rows.append(["CPU time to start one sandboxed process", f"{start:.2f} s"])
    command = f"python -m measure.class_cost FOLDER {count} {jobs}"
    record.table("class", "cost", ["", "all together, or per submission"], rows, command)


if __name__ == "__main__":
    folder, *counts = record.arguments()
    main(Path(folder), *map(int, counts))
