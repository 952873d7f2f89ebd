"""raytwin compare, raytwin diff: compare two images."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from raytwin.cli.options import Allow, AnyScene, JsonFile, check_outputs
from raytwin.cli.progress_bar import print_seconds, show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError
from raytwin.workflows.compare_settings import CompareSettings
from raytwin.workflows.diff_settings import DiffSettings


def compare_command(
    scene: AnyScene,
    settings: CompareSettings,
    json: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the report (out/SCENE).")
    ] = None,
    allow: Allow = None,
) -> None:
    """Compare a tracer with Mitsuba on a scene; write report.html, comparison.json and EXRs."""
    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin import report
            from raytwin.workflows.compare_scene import compare_scene
        result = compare_scene(scene, settings, progress=progress)
        folder = out or Path("out") / result.scene.name
        report.write_all(result, folder, json, progress=progress)
    say(report.summary(result))
    print_seconds(progress, tuple(t.stage for t in result.times))
    say(f"report: {folder / 'report.html'}")
    raise typer.Exit(result.comparison.exit_code)


def diff_command(
    a: Annotated[
        Path,
        typer.Argument(
            metavar="A", help="Image to test: EXR, PFM, HDR, PNG, JPEG; several renders as a folder or 'x_*.exr'."
        ),
    ],
    b: Annotated[Path, typer.Argument(metavar="B", help="Reference, likewise; two folders are compared name by name.")],
    settings: DiffSettings,
    fail: Annotated[float | None, typer.Option("--fail", help="Largest error of a pixel (1e-6), as in idiff.")] = None,
    fail_relative: Annotated[
        float | None, typer.Option("--failrelative", "--fail-relative", help="Or this share of its value (0).")
    ] = None,
    fail_percent: Annotated[
        float | None,
        typer.Option("--failpercent", "--fail-percent", help="Percentage of pixels that may exceed it (0)."),
    ] = None,
    hard_fail: Annotated[
        float | None, typer.Option("--hardfail", "--hard-fail", help="Largest error of any pixel (no limit).")
    ] = None,
    allow_failures: Annotated[
        int | None,
        typer.Option("--allowfailures", "--allow-failures", help="Pixels exempt from all limits (0)."),
    ] = None,
    warn: Annotated[float | None, typer.Option("--warn", help="Like --fail, but only warns.")] = None,
    warn_relative: Annotated[
        float | None, typer.Option("--warnrelative", "--warn-relative", help="Like --failrelative.")
    ] = None,
    warn_percent: Annotated[
        float | None, typer.Option("--warnpercent", "--warn-percent", help="Like --failpercent.")
    ] = None,
    hard_warn: Annotated[float | None, typer.Option("--hardwarn", "--hard-warn", help="Like --hardfail.")] = None,
    variance_a: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Image with the variance of A's mean.")
    ] = None,
    variance_b: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Image with the variance of B's mean.")
    ] = None,
    samples_a: Annotated[int, typer.Option(min=0, help="A's samples per pixel, if the file does not say.")] = 0,
    samples_b: Annotated[int, typer.Option(min=0, help="B's samples per pixel.")] = 0,
    json: JsonFile = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the verdict as JUnit XML.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for report.html, heatmap.png, comparison.json."),
    ] = None,
) -> None:
    """Compare any two images: verdict, metrics, heat map. The --fail... options work as in idiff."""
    from raytwin import files, report
    from raytwin.workflows import diff_files

    check_outputs(folders=(out,), files=(json, junit))
    settings = replace(
        settings,
        limits=diff_files.limits("--fail", fail, fail_relative, fail_percent, hard_fail, allow_failures),
        warn=diff_files.limits("--warn", warn, warn_relative, warn_percent, hard_warn),
        variances=(variance_a, variance_b),
        samples=(samples_a, samples_b),
    )
    if a.is_dir() and b.is_dir():
        if variance_a or variance_b:
            raise InputError("--variance-a, --variance-b", "two images, not two folders", a)
        diff_folders(a, b, settings, json, junit, out)
    name = f"{a.name} against {b.name}"
    try:
        found = diff_files.compare(a, b, settings)
    except InputError as error:
        if junit:
            report.write_junit([report.Case(name, "raytwin.diff", error)], junit)
        raise
    text = report.diff_summary(found)
    if json:
        files.write_json(json, found.numbers())
    if junit:
        report.write_junit([report.Case(name, "raytwin.diff", found.report, text)], junit)
    if out:
        with show_progress() as progress:
            report.write_diff(found, out, progress)
    say(text)
    if out:
        say(f"report: {out / 'report.html'}")
    raise typer.Exit(found.comparison.exit_code)


def diff_folders(
    a: Path, b: Path, settings: DiffSettings, json: Path | None, junit: Path | None, out: Path | None
) -> NoReturn:
    """Each image of A against that of the same name in B: a line each, one index, one JSON, one JUnit."""
    from raytwin import files, report
    from raytwin.report import check_page
    from raytwin.workflows import diff_files

    cases: list[Any] = []
    pairs: dict[str, Any] = {}
    codes = []
    if out:
        check_page.clear(out)
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
            cases.append(report.Case(name, "raytwin.diff", error))
            pairs[name] = {"error": str(error)}
            codes.append(2)
            continue
        cases.append(report.Case(name, "raytwin.diff", made))
        codes.append(made.comparison.exit_code)
        say(f"{made.comparison.verdict.upper()}  {name}: {made.comparison.reasons[0]}")
        if out:
            check_page.write_check(out, name, number, made, (), *pictures)
    worst = 1 if 1 in codes else max(codes)
    verdict = {0: "pass", 1: "fail", 2: "undecided"}[worst]
    if json:
        files.write_json(json, {"verdict": verdict, "pairs": pairs})
    if junit:
        report.write_junit(cases, junit)
    if out:
        check_page.write_index(out)
        say(f"report: {out / check_page.INDEX}")
    say(f"{verdict.upper()}  {len(codes)} pairs, {codes.count(1)} failed, {codes.count(2)} undecided or unreadable")
    raise typer.Exit(worst)
