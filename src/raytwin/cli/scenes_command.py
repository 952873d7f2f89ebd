"""raytwin scenes: what there is to render, and a copy of one to change."""

from pathlib import Path

import typer

from raytwin.cli.options import register
from raytwin.cli.terminal import say

app = typer.Typer()


@app.callback(invoke_without_command=True)
def list_command(context: typer.Context) -> None:
    if context.invoked_subcommand:
        return
    from raytwin import files

    for row in files.scenes():
        say(f"{row['name']:<12} {row['shows']}")


def copy_command(scene: Path, out: Path | None = None) -> None:
    """Copy a scene's folder with its photos, as a start for your own."""
    from raytwin import files

    say(files.copy_scene(scene, out or Path(files.find_scene(scene).parent.name)))


register(app, {"copy": copy_command}, within="scenes")
