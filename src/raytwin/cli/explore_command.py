"""raytwin explore: a scene to play with, in the browser."""

import os
import sys
from pathlib import Path

from raytwin.cli.options import Size
from raytwin.cli.progress_bar import show_progress
from raytwin.cli.terminal import say

WIDEST = 800
"""Pixels: as large as pictures are unless asked otherwise."""


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
            from raytwin import files
            from raytwin.calib.find_camera import find_camera
            from raytwin.contract.subject import find_subject
            from raytwin.live import Server, opening_page
            from raytwin.live.progressive import Session
            from raytwin.live.view_state import from_link
        base = files.read_scene(scene)
        found, *_ = find_camera(base, photo, progress)
        camera = found.camera
        scale = min(1, WIDEST / camera.width)
        camera = camera.resized(*(size or (round(camera.width * scale), max(1, round(camera.height * scale)))))
        session = Session(base.with_camera(camera), find_subject(subject, "shadow") if subject else None)
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
