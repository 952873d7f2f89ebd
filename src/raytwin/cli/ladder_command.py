"""raytwin ladder: the five rungs of light side by side."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import JsonFile, Photo, ScenePath, check_outputs, parse_size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say


def ladder_command(
    scene: ScenePath,
    samples: Annotated[int, typer.Option(help="Samples per pixel where light is followed.")] = 64,
    seed: Annotated[int, typer.Option(help="Of the samples.")] = 0,
    photo: Photo = None,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Of the pictures; 480 wide by default.")] = None,
    json: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Where page and chart go (in out/).")
    ] = None,
) -> None:
    """Render every light level on both sides: what each adds and costs; write ladder.html, ladder.json."""
    from raytwin import files, report
    from raytwin.analysis.ladder import ladder

    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        found = ladder(
            scene,
            size=parse_size(size, "--size") if size else None,
            samples=samples,
            seed=seed,
            photo=photo,
            progress=progress,
        )
    folder = out or Path("out") / f"{found.rungs.scene}-ladder"
    if json:
        files.write_json(json, found.rungs)
    report.write_ladder(found, folder)
    say(report.ladder_summary(found.rungs))
    say(f"report: {folder / 'ladder.html'}")
