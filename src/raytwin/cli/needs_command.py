"""raytwin needs: the cheapest way to a scene's image that meets a tolerance."""

from pathlib import Path

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.options import Size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, say_wrapped


def needs_command(
    scene: Path, tolerance: float, metric: str = "rmse", photo: str | None = None, size: Size = None,
    json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Find the cheapest way to an image that meets a tolerance.

    The answer has light level, depth, engine and sampling, and what the scene does not need.
    """
    check_outputs(folders=(out,) if out else (), files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin import files, twin
            from raytwin.analysis.recommend import check_asked, needs, scene_of
            from raytwin.analysis.recommend.level_pictures import level_pictures
            from raytwin.renderers.subject_renderers import fast_engine
            from raytwin.report.recommend_page import needs_summary, write_needs
        check_asked(tolerance, metric)
        placed = scene_of(scene, photo, size, progress)
        found = needs(placed, tolerance, metric, progress=progress)
        if out:
            with progress.stage("pictures"):
                depth = found.choice.depth if found.choice else None
                write_needs(found, level_pictures(placed, fast_engine(twin.activate().variant), depth), out)
    if json:
        files.write_json(json, found)
    say_wrapped(needs_summary(found))
    if out:
        say(f"report: {out / 'needs.html'}")
    raise typer.Exit(0 if found.choice else 2)
