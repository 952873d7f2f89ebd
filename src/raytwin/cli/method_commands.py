"""raytwin levels, laws, shrink, explore: a scene by many methods."""

import os
import shlex
import sys
from pathlib import Path

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.options import Size
from raytwin.cli.terminal import say, show_progress
from raytwin.study.settings import CompareSettings


def levels_command(
    scene: Path, tolerance: float | None = None, metric: str = "rmse", photo: str | None = None, size: Size = None,
    light: Path | None = None, json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Find how much light a scene needs.

    Every light level is measured against all light, with its cost. With --tolerance the answer is the cheapest method
    that meets it, and what can be left out. Exit code 2 means that none does. The folder gets levels.html and
    levels.json.
    """
    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin.scene.toml_json import write_json
            from raytwin.show import levels_page
            from raytwin.study.levels import levels
        made = levels(scene, tolerance, metric, photo=photo, size=size, light=light, progress=progress)
        folder = out or Path("out") / f"{made.found.scene}-levels"
        with progress.stage("page"):
            levels_page.write_levels(made, folder)
    if json:
        write_json(json, made.found)
    say(levels_page.levels_summary(made.found))
    say(f"report: {folder / 'levels.html'}")
    raise typer.Exit(0 if made.found.choice or tolerance is None else 2)


def laws_command(
    renderer: str, settings: CompareSettings, scene: Path | None = None, without: str = "",
    json: Path | None = None, out: Path | None = None,
) -> None:  # fmt: skip
    """Judge a renderer without a reference.

    A scene is moved, turned, scaled, mirrored, cut and lit otherwise, so that each picture follows from another. The
    laws that break name the cause. Exit code 0: none is broken; 1: one is; 2: undecided.
    """
    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin.scene.scene_files import read_scene
            from raytwin.scene.toml_json import write_json
            from raytwin.show import laws_page
            from raytwin.study.laws import laws
            from raytwin.teach.contract.subject import find_subject
        subject = find_subject(renderer, settings.rung, settings.sampling)
        read = read_scene(scene) if scene else None
        found = laws(subject, read, size=settings.size, budget=settings.spending, without=without, progress=progress)
        folder = out or Path("out") / "laws"
        laws_page.write_laws(found, folder)
    if json:
        write_json(json, found.numbers())
    say(laws_page.laws_summary(found))
    say(f"report: {folder / 'laws.html'}")
    raise typer.Exit(found.exit_code)


def shrink_command(
    scene: Path, settings: CompareSettings, time_limit: float = 300, json: Path | None = None, out: Path | None = None
) -> None:
    """Find the smallest scene in which a renderer still fails.

    Each step keeps the kind of failure. The folder gets scene.toml for a bug report, which begins with what was found
    and how to reproduce it. Exit code 2 means that it does not fail.
    """
    from raytwin.scene.scene_files import write_scene
    from raytwin.scene.toml_json import write_json
    from raytwin.study.shrink import shrink

    check_outputs(folders=(out or Path("out"),), files=(json,))
    with show_progress() as progress:
        found = shrink(scene, settings, time_limit=time_limit, progress=progress)
    file = (out or Path("out") / f"shrink-{found.before.name}") / "scene.toml"
    samples = f" --samples {settings.samples}" if settings.samples else ""
    subject = f"--subject {shlex.quote(str(settings.subject))} --rung {found.rung}{samples}"
    command = f"raytwin compare {shlex.quote(str(file))} {subject}"
    said = (*found.sentences, f"To reproduce: {command}")
    write_scene(file, found.after, "\n".join((f"{found.before.name}, reduced by raytwin shrink.", *said)))
    if json:
        write_json(json, found.numbers() | {"scene": str(file), "command": command})
    for line in said:
        say(line)
    count = [len(scene.objects) for scene in (found.before, found.after)]
    say(f"{count[0]} objects to {count[1]}, {found.evaluations} comparisons, {found.seconds:.1f} s")
    say(f"scene: {file}")


MAX_WIDTH = 800
"""Pixels: width of the live page's pictures, at most, unless --size is given."""


def explore_command(
    scene: Path, subject: str | None = None, photo: str | None = None, size: Size = None, view: str | None = None,
    port: int = 0, browser: bool = True,
) -> None:  # fmt: skip
    """Open a live page: drag spheres, change light, choose methods.

    Tracer, twin, difference and error breakdown follow.
    """
    import asyncio
    import contextlib

    with show_progress() as progress:
        with progress.stage("imports"):
            from raytwin.photos.find_camera import find_camera
            from raytwin.scene_folders import find_scene
            from raytwin.show.live import Server, opening_page
            from raytwin.show.live.progressive import Session
            from raytwin.show.live.view_state import from_link
            from raytwin.teach.contract.subject import find_subject
        base, *_ = find_camera(scene, photo, progress)
        camera = base.camera
        scale = min(1, MAX_WIDTH / camera.width)
        camera = camera.resized(*(size or (round(camera.width * scale), max(1, round(camera.height * scale)))))
        session = Session(
            base.with_camera(camera),
            find_subject(subject, "shadow") if subject else None,
            find_scene(scene).parent,
        )
        server = Server(session, port, from_link(view) if view else None)
    say(f"{base.name} at {server.address}")
    say("Ctrl-C ends it.")
    with contextlib.ExitStack() as stack:
        if browser:
            import webbrowser

            webbrowser.open(stack.enter_context(opening_page(server.address)).as_uri())
        try:
            asyncio.run(server.serve())
        except KeyboardInterrupt:
            say("ended")
    if server.busy:  # no library may be unloaded beneath what still runs, and nothing can stop that
        sys.stdout.flush()
        os._exit(0)
