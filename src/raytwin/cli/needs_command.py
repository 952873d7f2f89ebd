"""raytwin needs: the cheapest way to a scene's image that meets a tolerance."""

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
) -> None:
    """Find the cheapest light level, depth, engine and sampling for a tolerance, and what can be dropped."""
    check_outputs(files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin import files
            from raytwin.analysis.recommend import needs_of
            from raytwin.report.recommend_page import needs_summary
        asked = parse_size(size, "--size") if size else None
        found = needs_of(scene, tolerance, metric, photo=photo, size=asked, progress=progress)
    if json:
        files.write_json(json, found)
    say(needs_summary(found))
    raise typer.Exit(0 if found.choice else 2)
