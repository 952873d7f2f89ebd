"""raytwin compare, raytwin diff: compare two images."""

from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import print_seconds, show_progress
from raytwin.cli.terminal import say, worst_code
from raytwin.errors import InputError
from raytwin.judging import DiffSettings
from raytwin.study.settings import CompareSettings


def compare_command(
    scene: Path, settings: CompareSettings, json: Path | None = None, out: Path | None = None,
    verbose: bool = False,
) -> None:  # fmt: skip
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
    print_seconds(progress, verbose, result.worth)
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
        if variance_a or variance_b:
            raise InputError("--variance-a, --variance-b", "two images, not two folders", a)
        diff_folders(a, b, settings, json, junit, out)
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


def diff_folders(
    a: Path, b: Path, settings: DiffSettings, json: Path | None, junit: Path | None, out: Path | None
) -> NoReturn:
    """Each image of A against that of the same name in B: a line each, one index, one JSON, one JUnit."""
    from raytwin.scene.toml_json import write_json
    from raytwin.show import check_page
    from raytwin.show.junit import Case, write_junit
    from raytwin.study import diff_files

    cases: list[Any] = []
    pairs: dict[str, Any] = {}
    codes = []
    if out:
        check_page.prepare(out)
    for number, (name, mine, theirs) in enumerate(diff_files.pairs(a, b)):
        pictures: tuple[Any, ...] = ()
        try:
            if mine is None or theirs is None:
                made = diff_files.lacking(name, a if mine is None else b)
                pairs[name] = made.numbers()
            else:
                found = diff_files.compare(mine, theirs, settings)
                made, pictures = found.report, (found.test, found.reference, found.tolerance)
                pairs[name] = found.numbers()
        except InputError as error:
            say(f"ERROR  {error}")
            cases.append(Case(name, "raytwin.diff", error))
            pairs[name] = {"error": str(error)}
            codes.append(2)
            continue
        cases.append(Case(name, "raytwin.diff", made))
        codes.append(made.comparison.exit_code)
        say(f"{made.comparison.verdict.upper()}  {name}: {made.comparison.reasons[0]}")
        if out:
            check_page.write_check(out, name, number, made, (), *pictures)
    worst = worst_code(codes)
    verdict = {0: "pass", 1: "fail", 2: "undecided"}[worst]
    if json:
        write_json(json, {"verdict": verdict, "pairs": pairs})
    if junit:
        write_junit(cases, junit)
    if out:
        check_page.write_index(out)
        say(f"report: {out / check_page.INDEX}")
    say(f"{verdict.upper()}  {len(codes)} pairs, {codes.count(1)} failed, {codes.count(2)} undecided or unreadable")
    raise typer.Exit(worst)
