"""raytwin scenes: what there is to render, and a copy of one to change."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.terminal import say

app = typer.Typer(help="List the built-in scenes, or copy one to edit.")


@app.callback(invoke_without_command=True)
def list_command(context: typer.Context) -> None:
    if context.invoked_subcommand:
        return
    from raytwin import files

    for name, folder in sorted(files.scene_folders().items()):
        say(f"{name:<12} {files.scene_sentence(folder)}")


@app.command("copy")
def copy_command(
    scene: Annotated[Path, typer.Argument(help="Name or folder of the scene.")],
    out: Annotated[Path | None, typer.Argument(metavar="[DIR]", help="Folder to write (./NAME).")] = None,
) -> None:
    """Copy a scene's folder with its photos, as a start for your own."""
    from raytwin import files

    say(files.copy_scene(scene, out or Path(files.find_scene(scene).parent.name)))
