"""raytwin bench and its kin `paper`, `calibration`, `list`: speed against accuracy; raytwin stability."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from raytwin.cli.option_values import check_outputs, parse_numbers, parse_size
from raytwin.cli.options import group, register
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, say_wrapped, worst_code
from raytwin.errors import InputError, check_one_of
from raytwin.rungs import RUNGS

if TYPE_CHECKING:
    from raytwin.bench.calibration_cost import Shoot

CALIBRATIONS = 7
"""Most timed calls of a calibration, or of a frame of the paper's, by default."""


app = group("scene")


def scene_command(
    scenes: list[Path], methods: str = "*", subject: list[str] | None = None, rung: str = "shadow",
    sizes: str = "0.2", budget: float = 300, repeats: int = 15, truth_samples: int = 4096, flip: bool = False,
    json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Measure time and error of each method, and judge each picture.

    The folder gets bench.html, bench.json and charts. Exit code 1: a --subject fails; 2: none fails, but one is
    undecided or could not be measured.
    """
    from raytwin.bench import bench_scenes, write_bench
    from raytwin.contract.subject import find_subject
    from raytwin.report import bench_page

    check_one_of("--rung", rung, RUNGS)
    check_outputs(folders=(out or Path("out"),), files=(json,))
    megapixels = parse_numbers(sizes, "--sizes")
    with show_progress() as progress:
        found = bench_scenes(
            scenes,
            methods=[*split(methods), *(find_subject(what, rung) for what in subject or ())],
            sizes=megapixels,
            budget=budget,
            repeats=repeats,
            truth_samples=truth_samples,
            flip=flip,
            progress=progress,
        )
        folder = out or Path("out") / (f"bench-{found[0].scene}" if len(found) == 1 else "bench")
        with progress.stage("page"):
            bench_page.write_bench_all(found, folder)
    if json:
        write_bench(found, json)
    for of_scene in found:
        say_wrapped(bench_page.bench_summary(of_scene))
    say(f"report: {folder / 'bench.html'}")
    raise typer.Exit(worst_code(of_scene.exit_code for of_scene in found))


@dataclass(frozen=True)
class CalibrationRun:
    """What `bench calibration` and `bench paper` measure, and for how long."""

    scene: Path | None = None
    photo_count: int = 15
    photo_size: str = "4032x3024"
    budget: float = 300
    repeats: int = CALIBRATIONS

    def options(self) -> dict[str, Any]:
        return {
            "shoot": shoot_of(self.scene, self.photo_count, self.photo_size),
            "budget": self.budget,
            "repeats": self.repeats,
        }


def calibration_command(run: CalibrationRun, json: Path | None = None, out: Path | None = None) -> None:
    """Measure calibration time against error in unseen photos."""
    from raytwin.bench import calibration_cost
    from raytwin.report import bench_page

    def write(found: Any, folder: Path) -> None:
        bench_page.write_bench_all((found,), folder)

    make = calibration_cost.bench_calibration
    _measured(run, make, write, bench_page.bench_summary, json, out, "bench-calibration/bench.html")


def paper_command(run: CalibrationRun, json: Path | None = None, out: Path | None = None) -> None:
    """Measure the paper's figures 10 to 12 again."""
    from raytwin import paper as figures

    make = partial(figures.paper, run.scene)
    _measured(run, make, figures.write_paper_all, figures.paper_summary, json, out, "paper/paper.html")


def _measured(
    run: CalibrationRun, make: Callable[..., Any], write: Callable[[Any, Path], None], summary: Callable[[Any], str],
    json: Path | None, out: Path | None, page: str,
) -> None:  # fmt: skip
    """Measure, write and print; `page`: in out/, where no folder is asked for."""
    from raytwin import files

    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        found = make(**run.options(), progress=progress)
        report = (out or Path("out", page).parent) / Path(page).name
        with progress.stage("page"):
            write(found, report.parent)
    if json:
        files.write_json(json, found)
    say_wrapped(summary(found))
    say(f"report: {report}")


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


def shoot_of(scene: Path | None, count: int, size: str) -> "Shoot":
    """The synthetic photos asked for, of the scene's own board where it has one."""
    from raytwin import files
    from raytwin.bench import calibration_cost
    from raytwin.calib import photos
    from raytwin.calib.boards import read_board

    shoot = calibration_cost.Shoot(count, parse_size(size, "--photo-size"))
    if count < photos.LEAST_VIEWS:
        raise InputError("--photo-count", f"at least {photos.LEAST_VIEWS}", count)
    if scene is None or (asked := (written := files.read_scene(scene)).photos) is None:
        return shoot
    return replace(shoot, board=read_board(Path(written.folder) / asked.board))


COMMANDS: dict[str, Callable[..., None]] = {
    "scene": scene_command,
    "calibration": calibration_command,
    "paper": paper_command,
    "list": list_command,
}
register(app, COMMANDS, within="bench")
