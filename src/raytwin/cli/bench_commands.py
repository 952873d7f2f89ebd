"""raytwin bench: speed against accuracy; its kin `paper`, `calibration`, `verdict` and `list`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from raytwin.cli.options import Flip, JsonFile, ScenePath, check_outputs, parse_counts, parse_numbers, parse_size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say
from raytwin.errors import InputError

if TYPE_CHECKING:
    from raytwin.bench.calibration_cost import Shoot, Taken

DEFAULT = "scene"
"""The command that `raytwin bench SCENE` means."""

CALIBRATIONS = 7
"""Most timed calls of a calibration, or of a frame of the paper's, by default."""


class OrDefault(TyperGroup):
    """A group whose first word may be left out: what is no command begins DEFAULT's arguments."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = [DEFAULT, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=OrDefault,
    no_args_is_help=True,
    help="Measure speed against accuracy. `raytwin bench SCENE` means `raytwin bench scene SCENE`.",
)

ListedMethods = Annotated[
    str, typer.Option("--methods", metavar="GLOB,...", help="Patterns of method names; see `raytwin bench list`.")
]
OwnScene = Annotated[Path | None, typer.Argument(metavar="[SCENE]", help="Scene whose board is photographed.")]
Photos = Annotated[
    list[Path] | None, typer.Option("--photos", metavar="DIR", help="Real photos, besides the synthetic ones.")
]
Boards = Annotated[
    list[Path] | None, typer.Option("--board", metavar="BOARD", help="The board of each DIR (its board.toml).")
]
PhotoCount = Annotated[int, typer.Option(metavar="N", help="Number of synthetic photos.")]
PhotoSize = Annotated[str, typer.Option(metavar="WxH", help="Size of synthetic photos and of the frames.")]
Budget = Annotated[float, typer.Option(metavar="SECONDS", help="Total time; what does not fit is listed.")]
Repeats = Annotated[int, typer.Option(help="At most this many timed calls per method.")]
Out = Annotated[Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for page and charts (in out/).")]


@app.command(DEFAULT)
def scene_command(
    scene: ScenePath,
    methods: ListedMethods = "*",
    sizes: Annotated[str, typer.Option(metavar="MP,...", help="Picture sizes in megapixels.")] = "0.2",
    spheres: Annotated[
        str, typer.Option(metavar="N,...", help="Also time pictures of N small spheres, at the first size.")
    ] = "",
    crowd: Annotated[
        int | None, typer.Option(metavar="N", help="Replace the scene's objects by N small spheres.")
    ] = None,
    budget: Budget = 300,
    repeats: Repeats = 15,
    truth_samples: Annotated[int, typer.Option(help="At most this many samples per pixel of the reference.")] = 4096,
    flip: Flip = False,
    json: JsonFile = None,
    out: Out = None,
    save: Annotated[Path | None, typer.Option(metavar="FILE", help="Save this run for a later --against.")] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Compare with a run saved on this machine.")
    ] = None,
) -> None:
    """Measure each method's time and error; write bench.html, bench.json and charts.

    With --against, exit code 1 means that a method became slower or less accurate.
    """
    from raytwin import report
    from raytwin.bench import against as compared
    from raytwin.bench import bench, read_bench, write_bench

    check_outputs(folders=(out or Path("out"),), files=(json, save))
    megapixels, counts = parse_numbers(sizes, "--sizes"), parse_counts(spheres, "--spheres")
    earlier = read_bench(against) if against else None
    with show_progress() as progress:
        found = bench(
            scene,
            methods=split(methods),
            sizes=megapixels,
            spheres=counts,
            crowd=crowd,
            budget=budget,
            repeats=repeats,
            truth_samples=truth_samples,
            flip=flip,
            progress=progress,
        )
    if save:
        write_bench(found, save)
    if json:
        write_bench(found, json, repeats=False)
    changes = compared(found, earlier) if earlier else None
    folder = out or Path("out") / f"bench-{found.scene}"
    report.write_bench_all(found, folder, changes)
    say(report.bench_summary(found, changes))
    say(f"report: {folder / 'bench.html'}")
    raise typer.Exit(1 if changes and changes.worse else 0)


@app.command("calibration")
def calibration_command(
    scene: OwnScene = None,
    photos: Photos = None,
    board: Boards = None,
    photo_count: PhotoCount = 15,
    photo_size: PhotoSize = "4032x3024",
    budget: Budget = 300,
    repeats: Repeats = CALIBRATIONS,
    json: JsonFile = None,
    out: Out = None,
) -> None:
    """Measure calibration time against error in unseen photos, over image scale and detector settings."""
    from raytwin import report
    from raytwin.bench import calibration_cost, write_bench

    check_outputs(folders=(out or Path("out"),), files=(json,))
    shoot, taken = shoot_of(scene, photo_count, photo_size), real_photos(photos, board)
    with show_progress() as progress:
        found = calibration_cost.bench_calibration(shoot, taken, budget=budget, repeats=repeats, progress=progress)
    if json:
        write_bench(found, json)
    folder = out or Path("out") / "bench-calibration"
    report.write_bench_all(found, folder)
    say(report.bench_summary(found))
    say(f"report: {folder / 'bench.html'}")


@app.command("paper")
def paper_command(
    scene: OwnScene = None,
    photos: Photos = None,
    board: Boards = None,
    photo_count: PhotoCount = 15,
    photo_size: PhotoSize = "4032x3024",
    budget: Budget = 300,
    repeats: Repeats = CALIBRATIONS,
    json: JsonFile = None,
    out: Out = None,
) -> None:
    """Measure the paper's figures 10 to 12 again, with their errors; write paper.html, paper.json and paper.md."""
    from raytwin import files
    from raytwin import paper as figures

    check_outputs(folders=(out or Path("out"),), files=(json,))
    shoot, taken = shoot_of(scene, photo_count, photo_size), real_photos(photos, board)
    with show_progress() as progress:
        found = figures.paper(scene, shoot=shoot, taken=taken, budget=budget, repeats=repeats, progress=progress)
    if json:
        files.write_json(json, found)
    folder = out or Path("out") / "paper"
    figures.write_paper_all(found, folder)
    say(figures.paper_summary(found))
    say(f"report: {folder / 'paper.html'}")


@app.command("verdict")
def verdict_command(
    scenes: Annotated[
        list[Path] | None, typer.Argument(metavar="[SCENE]...", help="Scenes (overlap wedge ball).")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Runs of each scene, with seeds of their own.")] = 3,
    samples: Annotated[int, typer.Option(help="Samples per pixel of a run, a multiple of 4.")] = 256,
    json: JsonFile = None,
    out: Out = None,
) -> None:
    """Measure how many samples and seconds a verdict takes, by the size of the fault, beside other tools.

    Write verdict.json, and verdict-samples.svg and verdict-seconds.svg of the first scene.
    """
    from raytwin import files
    from raytwin.bench import bench_verdict
    from raytwin.report.verdict_chart import verdict_lines, write_verdict_charts

    check_outputs(folders=(out or Path("out"),), files=(json,))
    names = [str(scene) for scene in scenes or ()] or list(bench_verdict.SCENES)
    with show_progress() as progress:
        found = bench_verdict.bench_verdict(names, repeats=repeats, most=samples, progress=progress)
    folder = out or Path("out") / "bench-verdict"
    files.write_json(folder / "verdict.json", found)
    if json:
        files.write_json(json, found)
    write_verdict_charts(found, folder)
    say("\n".join(verdict_lines(found)))
    say(f"charts: {folder}")


@app.command("list")
def list_command(methods: ListedMethods = "*") -> None:
    """List all methods."""
    from raytwin.bench import choose

    for method in choose(split(methods)):
        say(f"{method.name:<28} {method.family}: {method.label}")


def split(globs: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in globs.split(",") if part.strip())


def shoot_of(scene: Path | None, count: int, size: str) -> "Shoot":
    """The synthetic photos asked for, of the scene's own board where it has one."""
    import msgspec

    from raytwin import files
    from raytwin.bench import calibration_cost
    from raytwin.calib import photos
    from raytwin.calib.boards import read_board

    shoot = calibration_cost.Shoot(count, parse_size(size, "--photo-size"))
    if count < photos.LEAST_VIEWS:
        raise InputError("--photo-count", f"at least {photos.LEAST_VIEWS}", count)
    if scene is None or (asked := (written := files.read_scene(scene)).photos) is None:
        return shoot
    return msgspec.structs.replace(shoot, board=read_board(Path(written.folder) / asked.board))


def real_photos(folders: list[Path] | None, boards: list[Path] | None) -> "list[Taken]":
    """Each folder with its board: the one named at the same place, the only one named, or the folder's own."""
    from raytwin import files
    from raytwin.bench import calibration_cost
    from raytwin.calib.boards import read_board

    folders, boards = folders or [], boards or []
    if len(boards) not in (0, 1, len(folders)):
        raise InputError("--board", f"one, or one for each of {len(folders)} --photos", len(boards))
    found = []
    for i, folder in enumerate(folders):
        files.list_photos(folder)
        board = boards[i] if len(boards) > 1 else boards[0] if boards else folder / "board.toml"
        found.append(calibration_cost.Taken(folder, read_board(board)))
    return found
