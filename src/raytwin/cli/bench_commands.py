"""raytwin bench and `bench list`: speed against accuracy; raytwin stability."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from raytwin.cli.option_values import check_outputs, parse_numbers
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, worst_code
from raytwin.errors import check_one_of
from raytwin.rungs import RUNGS

if TYPE_CHECKING:
    from raytwin.images.image import Image


def scene_command(
    scenes: list[Path], methods: str = "*", subject: list[str] | None = None, rung: str = "shadow",
    sizes: str = "0.2", budget: float = 300, json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Measure time and error of each method, and judge each picture.

    The folder gets bench.html, bench.json and charts. Exit code 1: a --subject fails; 2: none fails, but one is
    undecided or could not be measured.
    """
    from raytwin.show import bench_page
    from raytwin.study.bench import bench_scenes, write_bench
    from raytwin.teach.contract.subject import find_subject

    check_one_of("--rung", rung, RUNGS)
    check_outputs(folders=(out or Path("out"),), files=(json,))
    megapixels = parse_numbers(sizes, "--sizes")
    images: dict[str, Image] = {}
    with show_progress() as progress:
        found = bench_scenes(
            scenes,
            methods=[*split(methods), *(find_subject(what, rung) for what in subject or ())],
            sizes=megapixels,
            budget=budget,
            progress=progress,
            picture=images.__setitem__,
        )
        folder = out or Path("out") / (f"bench-{found[0].scene}" if len(found) == 1 else "bench")
        with progress.stage("page"):
            bench_page.write_bench_all(found, folder, images)
    if json:
        write_bench(found, json)
    for of_scene in found:
        say(bench_page.bench_summary(of_scene))
    say(f"report: {folder / 'bench.html'}")
    raise typer.Exit(worst_code(of_scene.exit_code for of_scene in found))


def list_command(methods: str = "*") -> None:
    """List all methods."""
    from raytwin.study.bench import renderers_of

    for method in renderers_of(split(methods)):
        say(method.name)


def stability_command(
    experiments: list[str] | None = None, listed: bool = False, json: Path | None = None,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Drive each numerical method until it fails.

    The folder gets atlas.html, atlas.json and charts.
    """
    from raytwin.scene.toml_json import write_json
    from raytwin.show import atlas_page
    from raytwin.study import atlas as stability

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
        write_json(json, found)
    say(atlas_page.atlas_summary(found))
    say(f"report: {folder / 'atlas.html'}")


def split(globs: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in globs.split(",") if part.strip())
