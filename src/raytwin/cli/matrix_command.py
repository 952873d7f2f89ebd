"""raytwin matrix: several renderers on several scenes. Imported by cli/__init__.py."""

from functools import partial
from pathlib import Path

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, say_wrapped, worst_code
from raytwin.workflows.settings import CompareSettings


def matrix_command(
    settings: CompareSettings, scenes: list[Path] | None = None, subjects: list[str] | None = None,
    listed: Path | None = None, references: Path | None = None, history: Path | None = None,
    jobs: int = 1, dask: str = "", shard: str = "", again: bool = False, json: Path | None = None,
    junit: Path | None = None, out: Path = Path("out/matrix"), allow: list[str] | None = None,
) -> None:  # fmt: skip
    """Compare several renderers with the twin on several scenes.

    One page shows all results. Run it again to continue an interrupted run. Exit code 1: a comparison failed; 2: none
    failed, but one is undecided or could not be made.
    """
    from raytwin import report
    from raytwin.parallel import Stored, parse_workers
    from raytwin.report import matrix_page
    from raytwin.workflows import matrix, matrix_history

    check_outputs(folders=(out,), files=(history, json, junit))
    workers = parse_workers(jobs, dask, shard)
    asked, named = [str(s) for s in scenes or ()], list(subjects or ())
    if listed is not None:
        more, others, chosen = matrix.read_list(listed)
        asked, named = [*asked, *more], [*named, *others]
        settings = matrix.with_settings(settings, chosen, listed)
    found = matrix.jobs_of(asked, named, settings, references)
    if history is not None:
        matrix_history.read_history(history)  # for its checks
    store = Stored(out / "results", matrix.Cell)
    with show_progress() as progress:
        cells = store.run(
            partial(matrix_page.make_cell, folder=str(out.absolute())), found, workers, failed=matrix.failed,
            redo=lambda cell: cell.verdict == "error", again=again, progress=progress, stage="matrix",
        )  # fmt: skip
    for cell in cells:
        why = "" if cell.verdict == "pass" else f": {cell.cause or cell.reason}"
        say_wrapped(f"{cell.verdict.upper():<10} {cell.scene}: {cell.subject}{why}")
    done = store.collect(found)
    if len(done) < len(found):
        say(f"{len(done)} of {len(found)} done; run it again without --shard once all are, for the page")
        raise typer.Exit(worst_code(cell.exit_code for cell in cells))
    past = matrix_history.pasts(matrix_history.add_to_history(history, done)) if history is not None else {}
    matrix_page.write_matrix(done, out, past)
    if json is not None:
        json.write_text((out / "matrix.json").read_text(encoding="utf-8"), encoding="utf-8")
    if junit is not None:
        report.write_junit(map(matrix_page.case_of, done), junit, "raytwin matrix")
    say(f"{len(done)} comparisons; report: {out / 'index.html'}")
    raise typer.Exit(worst_code(cell.exit_code for cell in done))
