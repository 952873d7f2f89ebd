"""raytwin compare, raytwin diff: compare two images."""

from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from raytwin.cli.options import Flip, JsonFile, ScenePath, check_outputs, parse_size
from raytwin.cli.progress_bar import show_progress, tell_seconds
from raytwin.cli.terminal import say
from raytwin.errors import InputError, check_one_of
from raytwin.rungs import RUNGS


def compare_command(
    scene: ScenePath,
    rung: Annotated[str, typer.Option(help="The twin's: surface, lambert, shadow, sky or path.")] = "shadow",
    tracer_rung: Annotated[
        str | None,
        typer.Option(metavar="RUNG", help="The tracer's, by default the highest up to --rung that a formula gives."),
    ] = None,
    subject: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="In the tracer's place: a method's name (`raytwin bench list`), FILE.py:FUNCTION, an image, a folder"
            " of images, or a command with {scene} and {out}.",
        ),
    ] = None,
    engine: Annotated[str, typer.Option(help="numpy64, numpy32, drjit32, drjit64, cuda32 or cuda64.")] = "numpy64",
    solver: Annotated[str, typer.Option(help="robust, stable, paper or textbook.")] = "robust",
    sampling: Annotated[str, typer.Option(help="center: through the pixel's centre; area: over the pixel.")] = "center",
    samples: Annotated[int | None, typer.Option(help="The twin's samples per pixel.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the twin's samples.")] = 0,
    photo: Annotated[str | None, typer.Option(metavar="NAME", help="Photo whose camera pose is used.")] = None,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Render at another size than the camera's.")] = None,
    cache: Annotated[
        bool, typer.Option(help="Reuse the twin's renders, and the tags in photos, of the same content.")
    ] = True,
    flip: Flip = False,
    json: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Where the report goes (out/SCENE by default).")
    ] = None,
) -> None:
    """Compare the tracer with its twin: report.html, EXRs of both images and of the error, comparison.json."""
    check_outputs(folders=(out or Path("out"),), files=(json,))
    check_one_of("--rung", rung, RUNGS)
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin import report
            from raytwin.contract.subject import find_subject
            from raytwin.workflows.compare_scene import compare_scene
        result = compare_scene(
            scene,
            rung=rung,
            tracer_rung=tracer_rung,
            subject=find_subject(subject, tracer_rung or rung) if subject else None,
            engine=engine,
            solver=solver,
            sampling=sampling,
            samples=samples,
            seed=seed,
            photo=photo,
            size=parse_size(size, "--size") if size else None,
            cache=cache,
            flip=flip,
            progress=progress,
        )
        folder = out or Path("out") / result.scene.name
        report.write_all(result, folder, json, progress=progress)
    say(report.summary(result))
    tell_seconds(progress, tuple(t.stage for t in result.times))
    say(f"report: {folder / 'report.html'}")
    raise typer.Exit(result.comparison.exit_code)


def diff_command(
    a: Annotated[
        Path,
        typer.Argument(
            metavar="A", help="The image to test: EXR, PFM, HDR, PNG, JPEG; renders as a folder or 'x_*.exr'."
        ),
    ],
    b: Annotated[
        Path, typer.Argument(metavar="B", help="The reference, alike; two folders are compared name by name.")
    ],
    part: Annotated[str | None, typer.Option(metavar="NAME", help="An EXR's part: name or number.")] = None,
    layer: Annotated[str | None, typer.Option(metavar="NAME", help="diffuse for diffuse.R...; or one channel.")] = None,
    tolerance: Annotated[float, typer.Option(help="99.9 % of noise-free values may err by it, relative to B.")] = 1e-5,
    false_alarm_rate: Annotated[float, typer.Option(help="Share of noisy pairs that fail by chance.")] = 1e-3,
    fail: Annotated[float | None, typer.Option("--fail", help="A pixel may err by this (1e-6); as idiff.")] = None,
    fail_relative: Annotated[
        float | None, typer.Option("--failrelative", "--fail-relative", help="And by this share of its value (0).")
    ] = None,
    fail_percent: Annotated[
        float | None, typer.Option("--failpercent", "--fail-percent", help="Percentage that may err more (0).")
    ] = None,
    hard_fail: Annotated[
        float | None, typer.Option("--hardfail", "--hard-fail", help="No pixel may err by more (infinite).")
    ] = None,
    allow_failures: Annotated[
        int | None,
        typer.Option("--allowfailures", "--allow-failures", help="Pixels exempt from all limits (0)."),
    ] = None,
    warn: Annotated[float | None, typer.Option("--warn", help="As --fail, for a warning that passes.")] = None,
    warn_relative: Annotated[
        float | None, typer.Option("--warnrelative", "--warn-relative", help="As --failrelative.")
    ] = None,
    warn_percent: Annotated[
        float | None, typer.Option("--warnpercent", "--warn-percent", help="As --failpercent.")
    ] = None,
    hard_warn: Annotated[float | None, typer.Option("--hardwarn", "--hard-warn", help="As --hardfail.")] = None,
    variance_a: Annotated[Path | None, typer.Option(metavar="FILE", help="The variance of A's mean, an image.")] = None,
    variance_b: Annotated[Path | None, typer.Option(metavar="FILE", help="The variance of B's mean.")] = None,
    samples_a: Annotated[int, typer.Option(min=0, help="A's samples per pixel, if the file does not say.")] = 0,
    samples_b: Annotated[int, typer.Option(min=0, help="B's samples per pixel.")] = 0,
    noise: Annotated[
        str, typer.Option(help="both; reference: believe no variance that A claims; none: neither has any.")
    ] = "both",
    must_see: Annotated[
        float, typer.Option(min=0, help='Report "undecided" if a bias larger than this could go unnoticed.')
    ] = 0.1,
    flip: Flip = False,
    json: JsonFile = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the verdict as JUnit XML.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="report.html, heatmap.png, comparison.json.")
    ] = None,
) -> None:
    """Compare any two images of any renderers: metrics, verdict, heat map. With --fail... as idiff does."""
    from raytwin import files, report
    from raytwin.workflows import diff_files

    check_outputs(folders=(out,), files=(json, junit))
    options: dict[str, Any] = {
        "part": part,
        "layer": layer,
        "tolerance": tolerance,
        "false_alarm_rate": false_alarm_rate,
        "limits": diff_files.limits("--fail", fail, fail_relative, fail_percent, hard_fail, allow_failures),
        "warn": diff_files.limits("--warn", warn, warn_relative, warn_percent, hard_warn),
        "flip": flip,
        "samples": (samples_a, samples_b),
        "noise": noise,
        "must_see": must_see,
    }
    if a.is_dir() and b.is_dir():
        if variance_a or variance_b:
            raise InputError("--variance-a, --variance-b", "two images, not two folders", a)
        diff_folders(a, b, options, json, junit, out)
    name = f"{a.name} against {b.name}"
    try:
        found = diff_files.diff(a, b, variances=(variance_a, variance_b), **options)
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
    a: Path, b: Path, options: dict[str, Any], json: Path | None, junit: Path | None, out: Path | None
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
                found = diff_files.diff(mine, theirs, **options)
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
