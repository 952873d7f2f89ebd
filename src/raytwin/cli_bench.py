"""raytwin bench: speed against accuracy. Imported by cli.py, which holds the other commands."""

import time
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from raytwin.errors import InputError

CALIBRATIONS = 7
"""Most timed calls of a calibration or a frame of --paper."""


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
    paper: Annotated[
        bool, typer.Option("--paper", help="The figures 10 to 12 of the paper again, with their errors: paper.html.")
    ] = False,
    calibration: Annotated[
        bool, typer.Option("--calibration", help="Also time calibrations, over image scale and detector settings.")
    ] = False,
    photos: Annotated[
        list[Path] | None, typer.Option(metavar="DIR", help="Real photos to calibrate from, besides synthetic ones.")
    ] = None,
    board: Annotated[
        list[Path] | None, typer.Option(metavar="BOARD", help="The board of each DIR (by default its board.toml).")
    ] = None,
    photo_count: Annotated[int, typer.Option(metavar="N", help="How many synthetic photos.")] = 15,
    photo_size: Annotated[
        str, typer.Option(metavar="WxH", help="Of synthetic photos, and with --paper of the frames.")
    ] = "4032x3024",
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
    if photos and not (paper or calibration):
        raise InputError("--photos", "it with --paper or --calibration", "neither")
    if paper:
        return paper_command(scene, photos, board, photo_count, photo_size, budget, repeats, json, out)
    if scene is None:
        raise InputError("SCENE", "a scene's folder, or its scene.toml", "none")
    from raytwin import bench, report

    counts = parse_numbers(spheres, "--spheres")
    if any(n != int(n) for n in counts):
        raise InputError("--spheres", "whole numbers", spheres)
    # An earlier run that cannot be read is better known before the measuring than after it.
    earlier = bench.read_bench(against) if against else None
    shoot, taken = shoot_of(scene, photo_count, photo_size), real_photos(photos, board)
    with progress_bars() as progress:
        start = time.perf_counter()
        found = bench.bench(
            scene,
            methods=globs,
            sizes=parse_numbers(sizes, "--sizes"),
            spheres=[int(n) for n in counts],
            crowd=crowd,
            budget=budget / 2 if calibration else budget,
            repeats=repeats,
            truth_samples=truth_samples,
            flip=flip,
            progress=progress,
        )
        if calibration:
            with bench.photographed(shoot, progress) as made:
                until = time.perf_counter() + budget / 2
                calibrated, without = bench.measure_calibrations(
                    bench.Taken(made, shoot.board), taken, until, min(repeats, CALIBRATIONS), progress
                )
            found = msgspec.structs.replace(
                found,
                budget=float(budget),
                seconds=time.perf_counter() - start,
                calibration=tuple(calibrated),
                left_out=(*found.left_out, *without),
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


def paper_command(scene, photos, board, photo_count, photo_size, budget, repeats, json, out) -> None:
    """raytwin bench --paper: paper.html with charts, SVG and PNG beside it, paper.json, paper.md."""
    from raytwin import bench, files, report
    from raytwin.cli import progress_bars

    shoot, taken = shoot_of(scene, photo_count, photo_size), real_photos(photos, board)
    with progress_bars() as progress:
        found = bench.paper(
            scene, shoot=shoot, taken=taken, budget=budget, repeats=min(repeats, CALIBRATIONS), progress=progress
        )  # fmt: skip
    if json:
        files.write_json(json, found)
    folder = out or Path("out") / "paper"
    report.write_paper_all(found, folder)
    typer.echo(report.paper_summary(found))
    typer.echo(f"report: {folder / 'paper.html'}")


def shoot_of(scene: Path | None, count: int, size: str):
    """The synthetic photos asked for, of the scene's own board where it has one."""
    from raytwin import bench, files, photos
    from raytwin.boards import read_board
    from raytwin.cli import parse_size
    from raytwin.scene import Camera

    shoot = bench.Shoot(count, parse_size(size, "--photo-size"))
    if count < photos.LEAST_VIEWS:
        raise InputError("--photo-count", f"at least {photos.LEAST_VIEWS}", count)
    if scene is None or isinstance((asked := files.read_scene(scene)).camera, Camera):
        return shoot
    return msgspec.structs.replace(shoot, board=read_board(Path(asked.folder) / asked.camera.board))


def real_photos(folders: list[Path] | None, boards: list[Path] | None) -> list:
    """Each folder with its board: the one named at the same place, the only one named, or the folder's own."""
    from raytwin import bench, pipeline
    from raytwin.boards import read_board

    folders, boards = folders or [], boards or []
    if len(boards) not in (0, 1, len(folders)):
        raise InputError("--board", f"one, or one for each of {len(folders)} --photos", len(boards))
    found = []
    for i, folder in enumerate(folders):
        pipeline.list_photos(folder)
        board = boards[i] if len(boards) > 1 else boards[0] if boards else folder / "board.toml"
        found.append(bench.Taken(folder, read_board(board)))
    return found
