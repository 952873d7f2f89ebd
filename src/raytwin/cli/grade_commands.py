"""raytwin grade SUBMISSIONS --rubric R | starter | zip, and walk: students' tracers, graded."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of

if TYPE_CHECKING:
    from raytwin.teach.grade.result import Result
    from raytwin.teach.grade.rubric import Rubric


def class_command(
    submissions: Path, rubric: Path, out: Path = Path("out/grades"), jobs: int = 1, dask: str = "",
    again: bool = False, whole: bool = False, for_students: bool = False, gradescope: Path | None = None,
    junit: Path | None = None,
) -> None:  # fmt: skip
    """Grade submissions by a rubric, each in a sandbox.

    The folder gets a page per student and one of the class, CSV and JSON. Run it again to continue an interrupted
    run, or to grade a late submission: what is graded already is not graded again.
    """
    from raytwin.parallel import parse_workers
    from raytwin.show import autograder_sites as sites
    from raytwin.show import class_page as pages
    from raytwin.teach.grade.class_run import jobs_of, run
    from raytwin.teach.grade.rubric import read_rubric
    from raytwin.teach.sandbox import sandbox

    check_outputs(folders=(out,), files=(gradescope, junit))
    workers = parse_workers(jobs, dask)
    read = read_rubric(rubric)
    if gradescope is not None:  # whatever becomes of this process, there is a result
        sites.write_unfinished(gradescope)
    found = jobs_of(submissions, rubric, whole)
    if len(found) > 1 and gradescope:
        raise InputError("--gradescope", "one submission", len(found))
    if lacking := [name for name, state in sandbox.probe().items() if state != sandbox.HOLDS]:
        say(f"sandbox without {', '.join(lacking)} on this machine (raytwin doctor says why, and what for)")
    with show_progress() as progress:
        results = run(found, out, workers, again, progress)
    for result in results:
        say(_line(result, read))
    failed = [result.student for result in results if result.grader_fault]
    if gradescope is not None:  # whoever asks for it has no use for pages
        sites.write_gradescope(results[0], read, gradescope)
        raise typer.Exit(1 if failed else 0)
    failed += pages.write_class(results, read, out, for_students)
    if junit is not None:
        sites.write_grade_junit(results, junit)
    say(f"{len(results)} graded; report: {out / 'index.html'}")
    if failed:
        say(f"the grader itself failed on {', '.join(dict.fromkeys(failed))}: grade again once that is mended")
        raise typer.Exit(1)


def _line(result: "Result", rubric: "Rubric") -> str:
    from raytwin.show.class_page import in_short
    from raytwin.show.student_page import of_points

    said = in_short(result) or "all right"
    short = said if len(said) <= 100 else f"{said[:99]}…"
    return f"{of_points(result.points):>7} of {of_points(rubric.points)}  {result.student}: {short}"


def starter_command(
    out: Path | None = None, force: bool = False, rubric: bool = False, stage: list[str] | None = None
) -> None:
    """Write the file that students start from, or a rubric.

    The file has six empty functions that check themselves, and an example.
    """
    from raytwin.safe_write import write_text
    from raytwin.teach.contract.stage_table import CONTRACT, LESSONS
    from raytwin.teach.contract.starter import starter
    from raytwin.teach.grade.rubric import READY

    stages = [name.strip() for some in stage or CONTRACT for name in some.split(",")]
    for name in stages:
        check_one_of("--stage", name, LESSONS)
    out = out or Path("rubric.toml" if rubric else "tracer.py")
    check_outputs(files=(out,))
    if out.is_file() and not force:
        raise InputError(out, "exists. --force overwrites it.")
    write_text(out, READY.read_text(encoding="utf-8") if rubric else starter(out.name, stages))
    if rubric:
        say(f"{out}: change it, then raytwin grade SUBMISSIONS --rubric {out}")
        return
    say(f"{out}: to check what is written, run it: python {out}")


def zip_command(rubric: Path, out: Path = Path("autograder.zip"), wheel: Path | None = None) -> None:
    """Make the autograder zip for Gradescope."""
    from raytwin.teach.grade.gradescope import write_zip

    check_outputs(files=(out,))
    names = write_zip(rubric, out, wheel)
    say(f"{out}: {len(names)} files, {out.stat().st_size / 1e6:.1f} MB")


def walk_command(notebook: bool = False, out: Path = Path()) -> None:
    """Write eight lessons, from photos to path tracing.

    Each has a function to fill in, a check in words, and the picture so far.
    """
    from raytwin.teach.walk import write_walk

    check_outputs(folders=(out,))
    path = write_walk(out, notebook)
    say(f"wrote {path}")
    say(f"jupyter lab {path}" if notebook else f"python {path}    # its pictures go to walk/; edit it, run it again")
