"""raytwin scenes: what there is to render, a copy of one to change, one for other renderers."""

from pathlib import Path

import typer

from raytwin.cli.option_values import check_outputs
from raytwin.cli.options import Size
from raytwin.cli.terminal import say, show_progress


def list_command() -> None:
    """List the built-in scenes, and those in a folder scenes/ here."""
    from raytwin.scene_folders import scenes

    for row in scenes():
        say(f"{row['name']:<12} {row['shows']}")


def copy_command(scene: Path, out: Path | None = None) -> None:
    """Copy a scene's folder with its photos, as a start for your own."""
    from raytwin.scene_folders import copy_scene, find_scene

    say(copy_scene(scene, out or Path(find_scene(scene).parent.name)))


def export_command(
    scene: Path, mitsuba_xml: bool = False, rung: str | None = None, photo: str | None = None, size: Size = None,
    out: Path | None = None,
) -> None:  # fmt: skip
    """Write a scene for other renderers: as JSON, which programs of --subject read, or as Mitsuba XML.

    Camera, lens, objects and lights are resolved; lengths are metres.
    """
    from raytwin.errors import check_one_of
    from raytwin.renderers.scene_exchange import as_arrays, as_json
    from raytwin.rungs import RUNGS
    from raytwin.safe_write import write_text
    from raytwin.scene.scene_files import scene_and_photos
    from raytwin.scene.toml_json import json_text

    if rung is not None:
        check_one_of("--rung", rung, RUNGS)
    check_outputs(files=(out,))
    made, asked = scene_and_photos(scene)
    if asked is not None or photo is not None:  # what a calibration needs is not in the light install
        from raytwin.photos.find_camera import find_camera

        with show_progress() as progress:
            made = find_camera(scene, photo, progress)[0]
    if size is not None:
        made = made.with_(size=size)
    if mitsuba_xml:
        from raytwin.twin.mitsuba_xml import mitsuba_xml as as_xml
        from raytwin.twin.rounding import extreme_spheres

        text = as_xml(made, rung or "path")
        if any(made.camera.coefficients) or made.camera.fx != made.camera.fy:
            say("raytwin: the XML has no lens distortion and one focal length, so its image is another", err=True)
        if coarse := extreme_spheres(made):
            names = ", ".join(f"object-{i}" for i in coarse)
            say(f"raytwin: very large or very far away, Mitsuba's float32 may shade them falsely: {names}", err=True)
    else:
        text = json_text(as_json(as_arrays(made, rung or "shadow")))
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_text(out, text)
