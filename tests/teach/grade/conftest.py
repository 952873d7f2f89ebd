"""One class, graded once for all tests of this folder: the right, the wrong, the hostile and what is no submission."""

import os
from pathlib import Path
from typing import NamedTuple

import pytest
import submitted_tracers as tracers
from class_handed_in import HANDED_IN, HASTY, RUBRIC, STRANGE

from raytwin.parallel import Workers
from raytwin.safe_write import write_text
from raytwin.show import class_page as pages
from raytwin.teach.grade.class_run import jobs_of, run
from raytwin.teach.grade.grade_submission import Job
from raytwin.teach.grade.result import Marked, Result
from raytwin.teach.grade.rubric import Rubric, read_rubric


class Graded(NamedTuple):
    results: dict[str, Result]
    out: Path
    jobs: list[Job]
    rubric: Rubric

    def image(self, student: str) -> Marked:
        return self.results[student].exercises[2]

    def page(self, student: str) -> str:
        return (self.out / "students" / pages.page_name(self.results[student])).read_text()


@pytest.fixture(scope="session")
def graded(tmp_path_factory) -> Graded:
    folder = tmp_path_factory.mktemp("class")
    (folder / "rubric.toml").write_text(RUBRIC)
    (folder / "hasty.toml").write_text(HASTY)
    write_text(folder / "hasty" / "hangs.py", tracers.tracer("hangs"))
    for name, text in HANDED_IN.items():
        write_text(folder / "in" / name, text)
    with open(os.fsencode(folder / "in") + b"/" + STRANGE, "w") as file:  # noqa: PTH123 - a name that no str has
        file.write("def shade(:")
    write_text(folder / "in" / "many" / "tracer.py", tracers.RIGHT)
    for i in range(10_001):
        (folder / "in" / "many" / f"{i}.txt").touch()
    hasty, jobs = jobs_of(folder / "hasty", folder / "hasty.toml"), jobs_of(folder / "in", folder / "rubric.toml")
    results = [result for some in (hasty, jobs) for result in run(some, folder / "out", Workers())]
    rubric = read_rubric(folder / "rubric.toml")
    assert pages.write_class(results, rubric, folder / "out") == []
    return Graded({r.student: r for r in results}, folder / "out", jobs, rubric)
