"""raytwin stability: where each numerical method fails, beside what theory predicts."""

from pathlib import Path

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, say_wrapped


def stability_command(
    experiments: list[str] | None = None, thorough: bool = False, listed: bool = False, json: Path | None = None,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Drive each numerical method until it fails.

    The folder gets atlas.html, atlas.json and charts.
    """
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
        with progress.stage("page"):
            report.write_atlas(found, folder)
    if json:
        files.write_json(json, found)
    say_wrapped(report.atlas_summary(found))
    say(f"report: {folder / 'atlas.html'}")
