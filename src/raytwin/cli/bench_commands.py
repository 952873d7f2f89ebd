"""raytwin bench and `bench list`: speed against accuracy; raytwin stability."""

from collections.abc import Callable
from pathlib import Path

import typer

from raytwin.cli.option_values import check_outputs, parse_counts, parse_numbers
from raytwin.cli.options import group, register
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, say_wrapped
from raytwin.errors import check_one_of
from raytwin.rungs import RUNGS

app = group("scene")


def scene_command(
    scene: Path, methods: str = "*", subject: list[str] | None = None, rung: str = "shadow",
    sizes: str = "0.2", spheres: str = "",
    budget: float = 300, repeats: int = 15, truth_samples: int = 4096, json: Path | None = None,
    out: Path | None = None, save: Path | None = None, against: Path | None = None,
) -> None:  # fmt: skip
    """Measure each method's time and error.

    The folder gets bench.html, bench.json and charts.

    With --against, exit code 1 means that a method became slower or less accurate.
    """
    from raytwin.bench import against as compared
    from raytwin.bench import bench, read_bench, write_bench
    from raytwin.contract.subject import find_subject
    from raytwin.report import bench_page

    check_one_of("--rung", rung, RUNGS)
    check_outputs(folders=(out or Path("out"),), files=(json, save))
    megapixels, counts = parse_numbers(sizes, "--sizes"), parse_counts(spheres, "--spheres")
    earlier = read_bench(against) if against else None
    with show_progress() as progress:
        found = bench(
            scene,
            methods=[*split(methods), *(find_subject(what, rung) for what in subject or ())],
            sizes=megapixels,
            spheres=counts,
            budget=budget,
            repeats=repeats,
            truth_samples=truth_samples,
            progress=progress,
        )
        changes = compared(found, earlier) if earlier else None
        folder = out or Path("out") / f"bench-{found.scene}"
        with progress.stage("page"):
            bench_page.write_bench_all(found, folder, changes)
    if save:
        write_bench(found, save)
    if json:
        write_bench(found, json, repeats=False)
    say_wrapped(bench_page.bench_summary(found, changes))
    say(f"report: {folder / 'bench.html'}")
    raise typer.Exit(1 if changes and changes.worse else 0)


def list_command(methods: str = "*") -> None:
    """List all methods."""
    from raytwin.bench import choose

    for method in choose(split(methods)):
        say(f"{method.name:<28} {method.family}: {method.label}")


def stability_command(
    experiments: list[str] | None = None, listed: bool = False, json: Path | None = None,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Drive each numerical method until it fails.

    The folder gets atlas.html, atlas.json and charts.
    """
    from raytwin import atlas as stability
    from raytwin import files
    from raytwin.report import atlas_page

    if listed:
        for row in stability.EXPERIMENTS.values():
            say(f"{row.name:<20} {row.title}")
        return
    folder = out or Path("out") / "stability"
    check_outputs(folders=(folder,), files=(json,))
    with show_progress() as progress:
        found = stability.atlas(tuple(experiments or ()), progress)
        with progress.stage("page"):
            atlas_page.write_atlas(found, folder)
    if json:
        files.write_json(json, found)
    say_wrapped(atlas_page.atlas_summary(found))
    say(f"report: {folder / 'atlas.html'}")


def split(globs: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in globs.split(",") if part.strip())


COMMANDS: dict[str, Callable[..., None]] = {
    "scene": scene_command,
    "list": list_command,
}
register(app, COMMANDS, within="bench")
