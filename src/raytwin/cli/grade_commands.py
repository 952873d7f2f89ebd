"""raytwin grade SUBMISSIONS --rubric R | gradescope-zip: students' tracers, graded. Imported by cli/__init__.py."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from raytwin.cli.options import Dask, Jobs, Shard, check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of

if TYPE_CHECKING:
    from raytwin.grade.result import Result
    from raytwin.grade.rubric import Rubric


class _Submissions(TyperGroup):
    """`raytwin grade FOLDER ...` is `raytwin grade class FOLDER ...`: what is no command's name is a folder; so is
    `class` itself, where there is one and no other is told."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        alone = args[1:2] != ["-h"] and args[1:2] != ["--help"] and all(word.startswith("-") for word in args[1:2])
        its_name = args[:1] == ["class"] and alone and Path("class").is_dir()
        if args and (its_name or args[0] not in (*self.commands, "-h", "--help")):
            args = ["class", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    help="Grade students' tracers: `raytwin grade SUBMISSIONS --rubric RUBRIC`.",
    no_args_is_help=True,
    cls=_Submissions,
)


@app.command("class")
def class_command(
    submissions: Annotated[
        Path, typer.Argument(help="Folder with a file or folder per student; or a single submission.")
    ],
    rubric: Annotated[
        Path, typer.Option("--rubric", "-r", metavar="FILE", help="TOML file with exercises and points.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for pages and results.")] = Path(
        "out/grades"
    ),
    jobs: Jobs = 1,
    dask: Dask = "",
    shard: Shard = "",
    again: Annotated[bool, typer.Option("--again", help="Grade again what is already graded.")] = False,
    whole: Annotated[bool, typer.Option("--whole", help="Treat the folder as one submission.")] = False,
    gradescope: Annotated[Path | None, typer.Option(metavar="FILE", help="Write Gradescope's results.json.")] = None,
    prairielearn: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write PrairieLearn's results.json.")
    ] = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write JUnit XML.")] = None,
) -> None:
    """Grade submissions by a rubric, each in a sandbox; write pages, CSV and JSON.

    Run it again to continue an interrupted run.
    """
    from raytwin.grade.class_run import collect, jobs_of, run
    from raytwin.grade.rubric import read_rubric
    from raytwin.parallel import parse_workers
    from raytwin.report import autograder_sites as sites
    from raytwin.report import class_page as pages
    from raytwin.sandbox import sandbox

    check_outputs(folders=(out,), files=(gradescope, prairielearn, junit))
    workers = parse_workers(jobs, dask, shard)
    read = read_rubric(rubric)
    if gradescope is not None:  # whatever becomes of this process, there is a result
        sites.write_unfinished(gradescope)
    found = jobs_of(submissions, rubric, whole)
    if len(found) > 1 and (gradescope or prairielearn):
        raise InputError("--gradescope, --prairielearn", "one submission", len(found))
    lacking = [f"{name}: {state}" for name, state in sandbox.told(sandbox.probe()) if not state.startswith("holds")]
    say("sandbox: every lock holds" if not lacking else f"sandbox: {'; '.join(lacking)}")
    with show_progress() as progress:
        results = run(found, out, workers, again, progress)
    for result in results if len(results) <= 20 else ():
        say(_line(result, read))
    failed = [result.student for result in results if result.grader_fault]
    for path, write in ((gradescope, sites.write_gradescope), (prairielearn, sites.write_prairielearn)):
        if path is not None:
            write(results[0], read, path)
    if gradescope or prairielearn:  # whoever asks for these has no use for pages
        raise typer.Exit(1 if failed else 0)
    done = collect(found, out)
    if len(done) < len(found):
        say(f"{len(done)} of {len(found)} graded; run it again without --shard once all are, for the pages")
        raise typer.Exit(1 if failed else 0)
    failed += pages.write_class(results, read, out)
    if junit is not None:
        sites.write_grade_junit(results, junit)
    say(f"{len(results)} graded; report: {out / 'index.html'}")
    if failed:
        say(f"the grader itself failed on {', '.join(dict.fromkeys(failed))}: grade again once that is mended")
        raise typer.Exit(1)


def _line(result: "Result", rubric: "Rubric") -> str:
    from raytwin.report.class_page import of_points

    said = result.problem or result.first_problem
    first = said.splitlines()[0] if said else "all right"
    return f"{of_points(result.points):>7} of {of_points(rubric.points)}  {result.student}: {first[:100]}"


@app.command("starter")
def starter_command(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="File to write (tracer.py or rubric.toml).")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    rubric: Annotated[bool, typer.Option("--rubric", help="Write a complete rubric to edit instead.")] = False,
    stage: Annotated[
        list[str] | None,
        typer.Option(help="Function to include; repeatable (default: the six)."),
    ] = None,
) -> None:
    """Write the file that students start from: six empty functions that check themselves, and an example."""
    from raytwin import files
    from raytwin.contract.stage_table import CONTRACT, LESSONS
    from raytwin.contract.starter import starter
    from raytwin.grade.rubric import READY

    for name in stage or ():
        check_one_of("--stage", name, LESSONS)
    out = out or Path("rubric.toml" if rubric else "tracer.py")
    check_outputs(files=(out,))
    if out.is_file() and not force:
        raise InputError(out, "a file that is not there yet, or --force", "one that may hold a student's work")
    files.write_text(out, READY.read_text(encoding="utf-8") if rubric else starter(out.name, stage or tuple(CONTRACT)))
    if rubric:
        say(f"{out}: change it, then raytwin grade SUBMISSIONS --rubric {out}")
        return
    say(f"{out}: to check what is written, run it: python {out}")


@app.command("gradescope-zip")
def gradescope_zip_command(
    rubric: Annotated[Path, typer.Argument(help="The rubric, TOML.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Zip to write.")] = Path("autograder.zip"),
    wheel: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Install this wheel of raytwin instead of the released version."),
    ] = None,
) -> None:
    """Make the autograder zip for Gradescope, with the rubric and its references."""
    from raytwin.grade.gradescope import write_zip

    check_outputs(files=(out,))
    names = write_zip(rubric, out, wheel)
    say(f"{out}: {len(names)} files, {out.stat().st_size / 1e6:.1f} MB")
