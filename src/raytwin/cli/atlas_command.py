"""raytwin stability: where each numerical method fails, beside what theory predicts."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import JsonFile, check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say


def stability_command(
    experiments: Annotated[
        list[str] | None, typer.Argument(metavar="[EXPERIMENT]...", help="Names from --list; all by default.")
    ] = None,
    thorough: Annotated[
        bool, typer.Option("--thorough", help="Measure more values with more trials (minutes).")
    ] = False,
    listed: Annotated[bool, typer.Option("--list", help="List all experiments.")] = False,
    json: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for page and charts (out/stability).")
    ] = None,
) -> None:
    """Drive each numerical method until it fails; write atlas.html, atlas.json and charts."""
    from raytwin import atlas as stability
    from raytwin import files, report

    if listed:
        for row in stability.EXPERIMENTS.values():
            say(f"{row.name:<20} {row.title}")
        return
    folder = out or Path("out") / "stability"
    check_outputs(folders=(folder,), files=(json,))
    with show_progress() as progress:
        found = stability.atlas(tuple(experiments or ()), thorough, progress)
    if json:
        files.write_json(json, found)
    report.write_atlas(found, folder)
    say(report.atlas_summary(found))
    say(f"report: {folder / 'atlas.html'}")
