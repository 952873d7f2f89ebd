"""raytwin reference make | accept | check | show | merge: references that renders are compared with."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say, worst_code
from raytwin.errors import InputError, check_one_of
from raytwin.study.settings import ReferenceSettings

if TYPE_CHECKING:
    from raytwin.scene import MitsubaScene, Scene

    Case = tuple[Path, str, Scene | MitsubaScene]


REFERENCES = Path("reference")
VERDICTS = ("PASS", "FAIL", "?   ")
"""Exit code of a check -> the first word of its line."""


def make_command(
    settings: ReferenceSettings, scenes: list[Path] | None = None, rung: list[str] | None = None,
    folder: Path = REFERENCES, yes: bool = False,
) -> None:  # fmt: skip
    """Render references with Mitsuba. Show what changes before replacing an old one.

    Run it again to continue an interrupted run.
    """
    from raytwin.renderers import references
    from raytwin.study import make_reference

    check_outputs(folders=(folder,))
    refused = []
    for scene, one, found in _cases(scenes, rung):
        with show_progress() as progress:
            change = make_reference.make(scene, one, folder.absolute(), settings, found=found, progress=progress)
        say("\n".join(change.lines()))
        if change.kind == "same":
            continue
        if change.kind == "new" or yes or _asked(f"Replace {change.new.path}?"):
            references.save(change.new)
            say(f"  written: {change.new.path}")
        else:
            refused.append(change.new.path)
    if refused and not _terminal():
        raise InputError(_count(refused), "would be replaced, and there is no terminal to ask. --yes replaces them.")


def accept_command(new: Path, because: str = "", folder: Path = REFERENCES) -> None:
    """Take one new image or reference, with the reason why.

    An image that a test run kept (its summary.md names the file), or SCENE/RUNG, which is rendered anew, in the old
    one's size. To replace an old one takes --because.
    """
    from raytwin.renderers import references
    from raytwin.rungs import RUNGS
    from raytwin.scene_folders import find_scene
    from raytwin.study import make_reference

    check_outputs(folders=(folder,))
    if new.suffix == ".exr":
        found = references.load(new)
        old = references.path_of(folder, found.header["scene"], found.header["rung"])
        if found.golden and not old.exists():
            raise InputError(old, "the reference that the image replaces", "no such file. --folder says where it is")
    else:
        check_one_of(f"{new}: the light level", new.name, RUNGS)
        scene = find_scene(new.parent)
        old = references.path_of(folder, _name(scene), new.name)
    if old.exists() and not because:
        raise InputError("--because", f"the reason why {old} is replaced", "none")
    if new.suffix != ".exr":
        with show_progress() as progress:
            found = make_reference.make(scene, new.name, folder.absolute(), progress=progress).new
    change = make_reference.accept(found, folder.absolute(), because)
    references.save(change.new)
    say("\n".join((*change.lines(), f"  written: {change.new.path}")))


def merge_command(folders: list[Path], out: Path = Path("out/merged")) -> None:
    """Merge the reports of several machines.

    Each folder is what `pytest --raytwin-report` wrote on one. The page has a row per test and a column per machine,
    and says which machine is the odd one. Exit code 1: a comparison failed, or is missing, on any of them.
    """
    from raytwin.show import merged_page

    check_outputs(folders=(out,))
    rows = merged_page.merge(folders)
    merged_page.write_merged(rows, folders, out)
    for sentence in merged_page.sentences(rows, merged_page.machines(folders)):
        say(sentence)
    say(f"report: {out / 'index.html'}")
    raise typer.Exit(0 if all(row.good for row in rows) else 1)


def check_command(
    scenes: list[Path] | None = None, rung: list[str] | None = None, folder: Path | None = None, budget: str = "256",
    detectable_bias: float | None = None, detectable_tile_bias: float | None = None,
) -> None:  # fmt: skip
    """Check that references agree with their scene and with Mitsuba.

    Renders stop as soon as the verdict is certain. Exit with 1 if one fails, otherwise with 2 if one is missing or
    damaged.
    """
    from raytwin.compare import Judging
    from raytwin.study import make_reference
    from raytwin.study.rounds import parse_budget

    judging = Judging(detectable_bias=detectable_bias, detectable_tile_bias=detectable_tile_bias)
    folder, checked, most = _source(folder), [], parse_budget(budget)
    for scene, one, found in _cases(scenes, rung, placed=False):
        with show_progress() as progress:
            done = make_reference.check(
                scene, one, folder, budget=most, judging=judging, found=found, progress=progress
            )
        checked.append(done)
        say(f"{VERDICTS[done.exit_code]}  {done.path.parent.name}/{done.path.stem}")
        for problem in done.problems:
            say(f"  {problem}")
    codes = [c.exit_code for c in checked]
    unknown = f", {codes.count(2)} could not be checked" if 2 in codes else ""
    say(f"{_count(checked)}, {codes.count(1)} failed{unknown}")
    raise typer.Exit(worst_code(codes))


def show_command(scenes: list[Path] | None = None, rung: list[str] | None = None, folder: Path | None = None) -> None:
    """Print a line per reference, or all details of a single one. Exit with 2 if one is damaged."""
    from raytwin.renderers import references
    from raytwin.rungs import RUNGS

    folder, known = _source(folder), RUNGS
    for one in rung or ():
        check_one_of("--rung", one, known)
    paths = [path for path in scenes or () if path.suffix == ".exr"]
    cases = references.listed(folder)
    names = [_name(path) for path in scenes or () if path.suffix != ".exr"] or ([] if paths else [n for n, _ in cases])
    for name in names:
        check_one_of(folder, name, dict(cases))
    paths += [references.path_of(folder, *case) for case in cases if case[0] in names and case[1] in (rung or known)]
    if not paths:
        raise InputError(folder, "references", "none of these light levels" if cases else "none")
    alone, damaged = len(paths) == 1, False
    if not alone:
        say(references.OUTLINE)
    for path in paths:
        try:
            found = references.load(path)
        except InputError as error:
            damaged = True
            say(f"{path.parent.name}/{path.stem}  {error}")
        else:
            say("\n".join(references.show(found)) if alone else references.outline(found))
    if damaged:
        raise typer.Exit(2)


def _cases(scenes: list[Path] | None, rungs: list[str] | None, placed: bool = True) -> "Iterator[Case]":
    """Yield (scene's path, rung, scene) for every reference asked for. `placed`: calibrate photographed scenes."""
    from raytwin.rungs import RUNGS
    from raytwin.scene import MitsubaScene
    from raytwin.scene_folders import all_scenes, find_scene
    from raytwin.study import make_reference

    for rung in rungs or ():
        check_one_of("--rung", rung, RUNGS)
    chosen = [find_scene(s) for s in scenes or ()] or all_scenes()
    for scene in chosen:
        with show_progress() as progress:
            found = make_reference.find_scene(scene, progress) if placed else make_reference.read_scene(scene)
        levels = (make_reference.LEVEL_OF_FILES,) if isinstance(found, MitsubaScene) else RUNGS
        for rung in rungs or levels:
            yield scene, rung, found


def _name(scene: Path) -> str:
    """The name that a scene's references are stored under. The scene itself may be gone."""
    if not scene.is_file():
        return scene.resolve().name
    from raytwin.study.make_reference import read_scene

    return read_scene(scene).name


def _source(folder: Path | None) -> Path:
    from raytwin import scene_folders

    return folder or (REFERENCES if REFERENCES.is_dir() else scene_folders.REFERENCES)


def _terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def _asked(question: str) -> bool:
    return _terminal() and typer.confirm(question, default=False)


def _count(things: Sequence[object]) -> str:
    return f"{len(things)} reference{'s' * (len(things) != 1)}"
