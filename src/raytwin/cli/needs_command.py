"""raytwin needs: the cheapest way to a scene's image that meets a tolerance."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import JsonFile, Photo, ScenePath, check_outputs, parse_size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say


def needs_command(
    scene: ScenePath,
    tolerance: Annotated[float, typer.Option(help="The error that is allowed, in the metric's units.")],
    metric: Annotated[str, typer.Option(help="rmse, relmse, mae, max_abs, p999_abs or p999_rel.")] = "rmse",
    photo: Photo = None,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="At another size than the camera's.")] = None,
    json: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Write a page with each light level as a picture.")
    ] = None,
) -> None:
    """Find the cheapest light level, depth, engine and sampling for a tolerance, and what can be dropped."""
    check_outputs(folders=(out,) if out else (), files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin import files, twin
            from raytwin.analysis.recommend import check_asked, needs, scene_of
            from raytwin.analysis.recommend.level_pictures import level_pictures
            from raytwin.renderers.subject_renderers import fast_engine
            from raytwin.report.recommend_page import needs_summary, write_needs
        check_asked(tolerance, metric)
        placed = scene_of(scene, photo, parse_size(size, "--size") if size else None, progress)
        found = needs(placed, tolerance, metric, progress=progress)
        if out:
            with progress.stage("pictures"):
                depth = found.choice.depth if found.choice else None
                write_needs(found, level_pictures(placed, fast_engine(twin.activate().variant), depth), out)
    if json:
        files.write_json(json, found)
    say(needs_summary(found))
    if out:
        say(f"report: {out / 'needs.html'}")
    raise typer.Exit(0 if found.choice else 2)
