"""raytwin bench: speed against accuracy. Imported by cli.py, which holds the other commands."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.errors import InputError


def bench_command(
    scene: Annotated[Path | None, typer.Argument(help="A scene's folder, or its scene.toml.")] = None,
    methods: Annotated[
        str, typer.Option(metavar="GLOB,...", help="Which methods: patterns of their names, see --list.")
    ] = "*",
    sizes: Annotated[str, typer.Option(metavar="MP,...", help="Megapixels of the picture.")] = "0.2",
    spheres: Annotated[
        str, typer.Option(metavar="N,...", help="Also time pictures of so many small spheres, at the first size.")
    ] = "",
    crowd: Annotated[
        int | None, typer.Option(metavar="N", help="So many small spheres in the place of the scene's objects.")
    ] = None,
    budget: Annotated[float, typer.Option(metavar="SECONDS", help="For all; methods that do not fit are named.")] = 300,
    repeats: Annotated[int, typer.Option(help="Most timed calls of each method.")] = 15,
    truth_samples: Annotated[int, typer.Option(help="Most samples a pixel of the converged truth.")] = 4096,
    flip: Annotated[bool, typer.Option("--flip", help="Add NVIDIA's perceptual metric FLIP (slow).")] = False,
    json: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the numbers as JSON.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Where charts go (out/bench-SCENE by default).")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep this run, every repeat of it, for --against.")
    ] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Compare with a run that was saved on this machine.")
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="Name every method, and measure nothing.")] = False,
) -> None:
    """Measure every method's seconds and its error: bench.html with charts, SVG and PNG beside it, bench.json.

    With --against, exit code 1 says that a method became slower or less accurate.
    """
    from raytwin.cli import parse_numbers, progress_bars

    globs = tuple(part.strip() for part in methods.split(",") if part.strip())
    if list_:
        from raytwin import bench

        for method in bench.choose(globs):
            typer.echo(f"{method.name:<28} {method.family}: {method.label}")
        return
    if scene is None:
        raise InputError("SCENE", "a scene's folder, or its scene.toml", "none")
    from raytwin import bench, report

    counts = parse_numbers(spheres, "--spheres")
    if any(n != int(n) for n in counts):
        raise InputError("--spheres", "whole numbers", spheres)
    # An earlier run that cannot be read is better known before the measuring than after it.
    earlier = bench.read_bench(against) if against else None
    with progress_bars() as progress:
        found = bench.bench(
            scene,
            methods=globs,
            sizes=parse_numbers(sizes, "--sizes"),
            spheres=[int(n) for n in counts],
            crowd=crowd,
            budget=budget,
            repeats=repeats,
            truth_samples=truth_samples,
            flip=flip,
            progress=progress,
        )
    if save:
        bench.write_bench(found, save)
    if json:
        bench.write_bench(found, json, repeats=False)
    changes = bench.against(found, earlier) if earlier else None
    folder = out or Path("out") / f"bench-{found.scene}"
    report.write_bench_all(found, folder, changes)
    typer.echo(report.bench_summary(found, changes))
    typer.echo(f"report: {folder / 'bench.html'}")
    raise typer.Exit(1 if changes and changes.worse else 0)
