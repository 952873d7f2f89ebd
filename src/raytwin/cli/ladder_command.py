"""raytwin ladder: the five rungs of light side by side."""

from pathlib import Path

from raytwin.cli.option_values import check_outputs
from raytwin.cli.options import Size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, say_wrapped


def ladder_command(
    scene: Path, samples: int = 64, seed: int = 0, photo: str | None = None, size: Size = None,
    json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Render every light level on both sides.

    The page shows what each level adds and costs. The folder gets ladder.html and ladder.json.
    """
    from raytwin import files, report
    from raytwin.analysis.ladder import ladder

    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        found = ladder(scene, size=size, samples=samples, seed=seed, photo=photo, progress=progress)
        folder = out or Path("out") / f"{found.rungs.scene}-ladder"
        with progress.stage("page"):
            report.write_ladder(found, folder)
    if json:
        files.write_json(json, found.rungs)
    say_wrapped(report.ladder_summary(found.rungs))
    say(f"report: {folder / 'ladder.html'}")
