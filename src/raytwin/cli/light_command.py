"""raytwin light: sun and sky of photos, from what stands beside the board."""

from pathlib import Path

from raytwin.cli.option_values import check_outputs, parse_ball, parse_stand
from raytwin.cli.progress_bar import print_seconds, show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError


def light_command(
    photos: list[Path], board: Path, camera: Path, out: Path, ball: list[str] | None = None, stand: str | None = None,
    json: Path | None = None,
) -> None:  # fmt: skip
    """Estimate sun and sky from photos.

    A mirror ball, a matt ball or a pin beside the board shows them; each number comes with its uncertainty.
    """
    from raytwin import files, report
    from raytwin.calib.lighting.light_file import write_light
    from raytwin.workflows.estimate_light import estimate_light

    if out.suffix.lower() != ".toml":
        raise InputError(out, "a name that ends in .toml", out.suffix or "no ending")
    check_outputs(files=(out, out.with_suffix(".exr"), out.with_suffix(".html"), json))
    balls = [parse_ball(text, "--ball") for text in ball or ()]
    upright = parse_stand(stand, "--stand") if stand else None
    taken = [path for named in photos for path in files.list_photos(named)]
    with show_progress() as progress:
        found = estimate_light(taken, board, camera, balls=balls, stand=upright, progress=progress)
    write_light(out, found.light, found.paper, f"The light of {len(taken)} photos: {found.trials[found.taken].name}.")
    if json:
        files.write_json(json, found.numbers())
    say(report.light_summary(found))
    report.write_light_page(found, out.with_suffix(".html"))
    print_seconds(progress)
    say(f"{out}, report: {out.with_suffix('.html')}")
