"""raytwin export: a scene for other renderers, everything resolved."""

from pathlib import Path
from typing import Annotated

import typer

from raytwin.cli.options import Photo, ScenePath, check_outputs, parse_size
from raytwin.cli.terminal import say
from raytwin.errors import InputError

SEEN = 0.01
"""Pixels: what a lens that is left out may move without a word."""


def export_command(
    scene: ScenePath,
    json: Annotated[bool, typer.Option("--json", help="Write JSON, as programs of --subject read it.")] = False,
    mitsuba_xml: Annotated[bool, typer.Option("--mitsuba-xml", help="Write a Mitsuba 3 scene.")] = False,
    rung: Annotated[
        str | None, typer.Option(help="Light level: in JSON (shadow) or of the XML, sky or path (path).")
    ] = None,
    photo: Photo = None,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Use another size than the camera's.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="File to write (standard output).")
    ] = None,
) -> None:
    """Write a scene for other renderers: camera, lens, objects, lights, in metres."""
    from raytwin import files
    from raytwin.errors import check_one_of
    from raytwin.renderers.mitsuba_xml import mitsuba_xml as as_xml
    from raytwin.renderers.mitsuba_xml import moved_by, too_large_for_mitsuba
    from raytwin.renderers.scene_exchange import as_arrays, as_json
    from raytwin.rungs import RUNGS

    if json == mitsuba_xml:
        raise InputError("--json, --mitsuba-xml", "one of them", "both" if json else "neither")
    check_outputs(files=(out,))
    written = files.read_scene(scene)
    if written.photos is None and photo is None:
        made = written.scene
    else:  # what a calibration needs is not in the light install
        from raytwin.calib.find_camera import find_camera

        made = find_camera(written, photo)[0]
    if size is not None:
        made = made.with_camera(made.camera.resized(*parse_size(size, "--size")))
    if json:
        check_one_of("--rung", rung or "shadow", RUNGS)
        text = files.json_text(as_json(as_arrays(made, rung or "shadow")))
    else:
        text = as_xml(made, rung or "path")
        if (moved := moved_by(made)) > SEEN:
            say(
                f"raytwin: the XML has neither distortion nor a second focal length: it sees up to {moved:.1f} px off",
                err=True,
            )
        if large := too_large_for_mitsuba(made):
            names = ", ".join(f"object-{i}" for i in large)
            say(f"raytwin: large beside their distance, Mitsuba's float32 may shade them falsely: {names}", err=True)
    if out is None:
        typer.echo(text, nl=False)
    else:
        files.write_text(out, text)
