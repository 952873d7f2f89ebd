"""raytwin compare, raytwin diff: compare two images."""

from dataclasses import replace
from pathlib import Path

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import print_seconds, show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError
from raytwin.judging import DiffSettings
from raytwin.study.settings import CompareSettings


def compare_command(scene: Path, settings: CompareSettings, json: Path | None = None, out: Path | None = None) -> None:
    """Compare a tracer with Mitsuba on a scene.

    The folder gets report.html, comparison.json and both images as EXR. Exit code 0: they agree, or differ as expected;
    1: they do not; 2: undecided.
    """
    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin.show import report_folder, terminal_text
            from raytwin.study.compare_scene import compare_scene
        result = compare_scene(scene, settings, progress=progress)
        folder = out or Path("out") / result.scene.name
        report_folder.write_all(result, folder, json, progress=progress)
    say(terminal_text.summary(result))
    print_seconds(progress, result.worth)
    say(f"report: {folder / 'report.html'}")
    raise typer.Exit(result.comparison.exit_code)


def diff_command(
    a: Path, b: Path, settings: DiffSettings, variance_a: Path | None = None, variance_b: Path | None = None,
    samples_a: int = 0, samples_b: int = 0, json: Path | None = None, junit: Path | None = None,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Compare any two images: verdict, metrics, heat map."""
    from raytwin.scene.toml_json import write_json
    from raytwin.show import terminal_text
    from raytwin.show.junit import Case, write_junit
    from raytwin.study import diff_files

    check_outputs(folders=(out,), files=(json, junit))
    settings = replace(settings, variances=(variance_a, variance_b), samples=(samples_a, samples_b))
    if a.is_dir() and b.is_dir():
        removed = "was removed in 0.2.0. Use one `diff` per pair, or 'A/*.exr' for renders of one picture."
        raise InputError("`diff` of two folders, name by name,", removed)
    found = diff_files.compare(a, b, settings)
    text = terminal_text.diff_summary(found)
    if json:
        write_json(json, found.numbers())
    if junit:
        write_junit([Case(found.report.scene, "raytwin.diff", found.report, text)], junit)
    if out:
        from raytwin.show.report_folder import write_diff

        write_diff(found, out)
        text += f"\nreport: {out / 'report.html'}"
    say(text)
    raise typer.Exit(found.comparison.exit_code)
