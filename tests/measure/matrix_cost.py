"""raytwin matrix, 4 renderers on 6 scenes: seconds beyond the renders themselves, and what the page weighs.

python -m measure.matrix_cost    in tests/
"""

import os
import tempfile
from pathlib import Path

from raytwin.parallel import Stored, Workers
from raytwin.report.matrix_page import make_cell, write_matrix
from raytwin.workflows.matrix import Cell, failed, jobs_of
from raytwin.workflows.settings import CompareSettings

SCENES = "overlap", "single", "wedge", "ball", "grazing", "eclipse"
SUBJECTS = "numpy64-shadow-conic", "drjit32-shadow-conic", "numpy32-lambert-conic", "loop-shadow-conic"


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        jobs = jobs_of(SCENES, SUBJECTS, CompareSettings(size=(320, 240)))
        before = os.times()
        cells = Stored(folder / "results", Cell).run(
            lambda job: make_cell(job, str(folder)), jobs, Workers(), failed=failed
        )
        made = os.times()
        write_matrix(cells, folder)
        after = os.times()
        spent = [b.user + b.system - a.user - a.system for a, b in ((before, made), (made, after))]
        renders = sum((c.seconds or 0) + (c.twin_seconds or 0) for c in cells)
        verdicts = {v: sum(c.verdict == v for c in cells) for v in ("pass", "differs", "fail", "undecided", "error")}
        reports = [file.stat().st_size for file in (folder / "cells").glob("*.html")]
        print(f"{len(cells)} cells: {verdicts}")
        beyond = sum(c.other_seconds or 0 for c in cells)
        print(f"cells: {spent[0]:.1f} cpu s; by the clock {renders:.1f} s of renders, {beyond:.1f} s else")
        print(
            f"page and tables: {spent[1]:.2f} cpu s; index.html {(folder / 'index.html').stat().st_size / 1e3:.0f} kB"
        )
        print(f"reports: {len(reports)} of {sum(reports) / len(reports) / 1e3:.0f} kB in the mean")


if __name__ == "__main__":
    main()
