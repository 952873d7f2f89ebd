"""The command line. Heavy imports happen inside the commands, so that `raytwin --help` answers at once.

Exit codes: 0 pass, 1 the comparison failed, 2 the input or the machine is at fault.
"""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from raytwin import cli_reference
from raytwin.cli_bench import bench_command
from raytwin.cli_board import board_command
from raytwin.errors import InputError

app = typer.Typer(
    help="A hand-written ray tracer beside its Mitsuba twin: compare the two and explain the difference.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(cli_reference.app, name="reference")

ScenePath = Annotated[Path, typer.Argument(help="A scene's folder, or its scene.toml.")]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the numbers as JSON.")]


def main() -> None:
    """The entry point: an InputError becomes one line on standard error and exit code 2."""
    try:
        app()
    except InputError as error:
        print(f"raytwin: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:
        sys.exit(141)
    except KeyboardInterrupt:
        print("raytwin: interrupted", file=sys.stderr)
        sys.exit(130)


@app.command("compare")
def compare_command(
    scene: ScenePath,
    rung: Annotated[
        str, typer.Option(help="surface, lambert, shadow; or sky, path for what the tracer lacks.")
    ] = "shadow",
    engine: Annotated[str, typer.Option(help="numpy64, numpy32, drjit32, drjit64, cuda32 or cuda64.")] = "numpy64",
    solver: Annotated[str, typer.Option(help="robust, stable, paper or textbook.")] = "robust",
    sampling: Annotated[str, typer.Option(help="center: through the pixel's centre; area: over the pixel.")] = "center",
    samples: Annotated[int | None, typer.Option(help="The twin's samples per pixel.")] = None,
    seed: Annotated[int, typer.Option(help="Of the twin's samples.")] = 0,
    photo: Annotated[str | None, typer.Option(metavar="NAME", help="Which photo's camera to stand at.")] = None,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Render at another size than the camera's.")] = None,
    cache: Annotated[bool, typer.Option(help="Reuse the twin's renders of the same content.")] = True,
    flip: Annotated[bool, typer.Option("--flip", help="Add NVIDIA's perceptual metric FLIP (slow).")] = False,
    json: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Where the report goes (out/SCENE by default).")
    ] = None,
) -> None:
    """Compare the tracer with its twin: report.html, EXRs of both images and of the error, comparison.json."""
    from raytwin import pipeline, report

    with progress_bars() as progress:
        result = pipeline.run(
            scene,
            rung=rung,
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
    typer.echo(report.summary(result))
    typer.echo(f"report: {folder / 'report.html'}")
    raise typer.Exit(0 if result.comparison.verdict == "pass" else 1)


@app.command("diff")
def diff_command(
    a: Annotated[Path, typer.Argument(metavar="A", help="The image to test: EXR, PFM, HDR, PNG or JPEG.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The reference.")],
    part: Annotated[str | None, typer.Option(metavar="NAME", help="An EXR's part: name or number.")] = None,
    layer: Annotated[str | None, typer.Option(metavar="NAME", help="diffuse for diffuse.R...; or one channel.")] = None,
    tolerance: Annotated[float, typer.Option(help="99.9 % of noise-free values may err by this.")] = 1e-5,
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
        int | None, typer.Option("--allowfailures", "--allow-failures", help="Pixels that may err at will (0).")
    ] = None,
    warn: Annotated[float | None, typer.Option("--warn", help="As --fail, for a warning that passes.")] = None,
    warn_relative: Annotated[float | None, typer.Option("--warnrelative", "--warn-relative")] = None,
    warn_percent: Annotated[float | None, typer.Option("--warnpercent", "--warn-percent")] = None,
    hard_warn: Annotated[float | None, typer.Option("--hardwarn", "--hard-warn")] = None,
    flip: Annotated[bool, typer.Option("--flip", help="Add NVIDIA's perceptual metric FLIP (slow).")] = False,
    json: JsonFile = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the verdict as JUnit XML.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="report.html, heatmap.png, comparison.json.")
    ] = None,
) -> None:
    """Compare any two images of any renderers: metrics, verdict, heat map. With --fail... as idiff does."""
    from raytwin import diff, files, report

    name = f"{a.name} against {b.name}"
    try:
        found = diff.diff(
            a,
            b,
            part=part,
            layer=layer,
            tolerance=tolerance,
            false_alarm_rate=false_alarm_rate,
            limits=diff.limits("--fail", fail, fail_relative, fail_percent, hard_fail, allow_failures),
            warn=diff.limits("--warn", warn, warn_relative, warn_percent, hard_warn),
            flip=flip,
        )
    except InputError as error:
        if junit:
            report.write_junit([report.Case(name, "raytwin.diff", error)], junit)
        raise
    text = report.diff_summary(found)
    if json:
        files.write_json(json, found.numbers())
    if junit:
        report.write_junit([report.Case(name, "raytwin.diff", found.comparison, text)], junit)
    if out:
        with progress_bars() as progress:
            report.write_diff(found, out, progress)
    typer.echo(text)
    if out:
        typer.echo(f"report: {out / 'report.html'}")
    raise typer.Exit(0 if found.passed else 1)


@app.command("calibrate")
def calibrate_command(
    photos: Annotated[Path, typer.Argument(help="A folder of photos of the board.")],
    board: Annotated[Path, typer.Option(metavar="BOARD", help="The board's TOML file.")],
    model: Annotated[str, typer.Option(help="auto, none, k1, k1k2, k1k2k3 or full5.")] = "auto",
    photo: Annotated[
        str | None, typer.Option(metavar="NAME", help="Whose pose the written camera gets (the first photo's).")
    ] = None,
    json: JsonFile = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write the camera, as TOML.")] = None,
    uncertainty: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw how far off each pixel may be.")
    ] = None,
) -> None:
    """Find the camera: detect the board's tags in the photos, fit K, distortion and a pose for each photo."""
    from raytwin import boards, files, pipeline, report
    from raytwin import photos as taken

    definition = boards.read_board(board)
    with progress_bars() as progress:
        paths = pipeline.list_photos(photos)
        calibration = taken.calibrate(paths, definition, model=model, progress=lambda d, n: progress("calibrate", d, n))
    if json:
        files.write_json(json, calibration.numbers())
    if out:
        names = [view.photo for view in calibration.views]
        if photo is not None and photo not in names:
            raise InputError("--photo", f"one of {', '.join(names)}", photo)
        pose = taken.pose_of_photo(calibration, photos / (photo or names[0]), definition)
        camera = taken.camera_at(calibration, pose.refined)
        files.write_camera(out, camera, f"Calibrated from {len(names)} photos, rms {calibration.rms_px:.3f} px.")
    if uncertainty:
        report.write_uncertainty(calibration, uncertainty)
    typer.echo(report.calibration_summary(calibration))


@app.command("photograph")
def photograph_command(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Where the photos and truth.toml go.")],
    board: Annotated[Path, typer.Option(metavar="BOARD", help="The board's TOML file.")],
    scene: Annotated[Path | None, typer.Option(help="Take sun, sky and table (its planes) from this scene.")] = None,
    count: Annotated[int, typer.Option(min=1, max=1000, help="How many photos.")] = 14,
    size: Annotated[str, typer.Option(metavar="WxH", help="Pixels of a photo.")] = "2016x1512",
    focal: Annotated[float, typer.Option(help="Focal length in pixels of a photo 2016 wide.")] = 1560.0,
    dist: Annotated[str, typer.Option(help="Distortion: k1,k2,p1,p2,k3 or a prefix.")] = "0.08,-0.16",
    samples: Annotated[int, typer.Option(min=1, help="Light paths per pixel.")] = 32,
    seed: Annotated[int, typer.Option(help="Of poses, light paths and sensor noise.")] = 1,
    with_objects: Annotated[
        bool, typer.Option("--with-objects", help="Put the scene's spheres really there: the truth for augment.")
    ] = False,
) -> None:
    """Photograph an AprilTag board that exists only in Mitsuba, and write down the true camera."""
    from raytwin import pipeline

    with progress_bars() as progress:
        pipeline.photograph_board(
            board,
            out,
            scene=scene,
            count=count,
            size=parse_size(size, "--size"),
            focal=focal,
            dist=parse_numbers(dist, "--dist"),
            samples=samples,
            seed=seed,
            with_objects=with_objects,
            progress=progress,
        )
    typer.echo(f"{count} photos, board.toml and truth.toml: {out}")


@app.command("augment")
def augment_command(
    photos: Annotated[list[Path], typer.Argument(metavar="PHOTO...", help="Photos that show the board.")],
    scene: Annotated[Path, typer.Option(metavar="SCENE", help="Whose spheres, planes and pyramids are drawn.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Where the drawn photos go.")],
    camera: Annotated[
        Path | None, typer.Option(metavar="FILE", help="camera.toml (by default, calibrate the scene's own photos).")
    ] = None,
    board: Annotated[Path | None, typer.Option(metavar="BOARD", help="The board's TOML (the scene's).")] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="DIR", help="True photos of the same names: report the error by region.")
    ] = None,
    shadows: Annotated[bool, typer.Option(help="Cast shadows on what the photo shows.")] = True,
    exposure: Annotated[float, typer.Option(min=0.0, help="The photo's linear value of radiance 1.")] = 1.0,
    json: JsonFile = None,
) -> None:
    """Draw a scene's objects into photos, with antialiased outlines and their shadows on the board."""
    from raytwin import files, pipeline, report

    with progress_bars() as progress:
        rows = pipeline.augment_photos(
            photos,
            scene,
            out,
            camera=camera,
            board=board,
            against=against,
            shadows=shadows,
            exposure=exposure,
            progress=progress,
        )
    if json:
        files.write_json(json, {"photos": rows})
    typer.echo(report.augment_summary(rows))
    typer.echo(f"{len(rows)} photos: {out}")


app.command("board")(board_command)
app.command("bench")(bench_command)


@app.command("doctor")
def doctor_command() -> None:
    """Show which backend the twin uses on this machine, what else was tried, and why."""
    from raytwin import twin

    for name, value in twin.doctor():
        typer.echo(f"{name:<24} {value}")


# ------------------------------------------------------------------------------------------ helpers


def parse_size(text: str, option: str) -> tuple[int, int]:
    """'640x480' as (640, 480)."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text)
    if not match or not (0 < int(match[1]) <= 100_000 and 0 < int(match[2]) <= 100_000):
        raise InputError(option, "WIDTHxHEIGHT in pixels, as 640x480", text)
    return int(match[1]), int(match[2])


def parse_numbers(text: str, option: str) -> tuple[float, ...]:
    """'0.1,-0.2' as (0.1, -0.2); the empty text as ()."""
    try:
        return tuple(float(part) for part in text.split(",")) if text.strip() else ()
    except ValueError:
        raise InputError(option, "numbers separated by commas", text) from None


@contextmanager
def progress_bars() -> Iterator:
    """Bars on standard error, one per stage; silent where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description:<12}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bars:
        tasks: dict[str, int] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield show
