"""Every option and argument of the command line: one table. A command's parameters say which of them it has."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from raytwin.cli.option_values import parse_size
from raytwin.cli.terminal import say
from raytwin.study.settings import CompareSettings

Size = tuple[int, int] | None
"""Width and height in pixels, as `--size` gives them."""


class Row(NamedTuple):
    """What typer knows of an option or argument; `kind`: its type, where that is not its parameter's."""

    info: Any
    kind: Any = None


def _known_scene(value: Path | list[Path] | None) -> Path | list[Path] | None:
    """Refuse a wrong name before anything heavy is imported."""
    from raytwin.scene_folders import find_scene

    for path in value if isinstance(value, list) else [value] if value else []:
        find_scene(path)
    return value


def _flip(asked: bool) -> bool:
    if asked:
        from raytwin.compare.metrics import flip_is_installed

        if not flip_is_installed():
            say("raytwin: FLIP is left out, since it is not installed: pip install 'raytwin[flip]'", err=True)
    return asked


def _size(text: str | None) -> Size:
    return parse_size(text, "--size") if text else None


def _opt(text: str, metavar: str | None = None, *names: str, kind: Any = None, **more: Any) -> Row:
    return Row(typer.Option(*names, metavar=metavar, help=text, **more), kind)


def _arg(text: str, metavar: str | None = None, **more: Any) -> Row:
    return Row(typer.Argument(metavar=metavar, help=text, **more))


OUT = "--out", "-o"
SCENE: dict[str, Any] = {"callback": _known_scene}
SIZE: dict[str, Any] = {"metavar": "WxH", "callback": _size, "kind": str | None}

TRACER, CERTAINTY, PLACE, FILES = "raytwin's own tracer", "How certain a verdict is", "Camera and light", "Files"
SHARED_OPTIONS: dict[str, dict[str, Row]] = {
    "Options": {
        "scene": _arg("A scene's folder, its scene.toml, or its name.", **SCENE),
        "subject": _opt(
            "Renderer: a method (`raytwin bench list`), FILE.py:FUNCTION, an image, a folder of images, or a command"
            " with {scene} and {out}.", "WHAT", kind=str | None,
        ),
        "rung": _opt("Light level: surface, lambert, shadow, sky or path."),
        "samples": _opt("Samples per pixel (until the verdict is certain)."),
        "size": _opt("Size of the pictures (the camera's, or less where that is enough).", **SIZE),
        "seed": _opt("Seed of the samples."),
        "out": _opt("Folder to write.", "DIR", *OUT),
        "jobs": _opt("Number of local processes.", "N", "--jobs", "-j"),
        "dask": _opt("Dask scheduler (extra `cluster`); its workers share the disk.", "ADDRESS"),
        "verbose": _opt("Print the seconds of every stage.", None, "--verbose", "-v"),
    },
    CERTAINTY: {
        "budget": _opt("Samples per pixel (1024) or time (30s) after which the verdict is undecided.", "N|TIME"),
        "detectable_bias": _opt(
            'Report "undecided" if a larger bias of the whole image could go unnoticed (0.1; 0.01 within budget).',
            "SHARE",
        ),
        "detectable_tile_bias": _opt(
            'Report "undecided" if a larger bias of 24 x 24 pixels could go unnoticed.', "SHARE"
        ),
        "flip": _opt("Add the perceptual metric FLIP (slow; extra `flip`).", None, "--flip", callback=_flip),
    },
    TRACER: {
        "tracer_rung": _opt(
            "Light level of the tracer (the highest up to --rung that needs no sampling).", "RUNG",
        ),
        "engine": _opt("Tracer's engine: numpy64, numpy32, drjit32, drjit64, cuda32, cuda64."),
        "solver": _opt("Sphere solver: robust, stable, paper or textbook."),
        "sampling": _opt("Rays through the pixel's center, or spread over its area.", "center|area"),
        "trim": _opt("Trim boxes: conic, corners or none."),
    },
    PLACE: {
        "photo": _opt("Photo whose camera pose is used.", "NAME"),
        "light": _opt("light.toml to use instead of the scene's sun and sky.", "FILE", kind=Path | None),
    },
    FILES: {
        "json": _opt("Write the numbers as JSON.", "FILE", "--json"),
        "junit": _opt("Write the verdict as JUnit XML.", "FILE"),
        "cache": _opt("Reuse stored renders."),
    },
}  # fmt: skip
"""Heading in `--help` -> parameter -> the option that commands share."""
for heading, shared in SHARED_OPTIONS.items():
    for row in shared.values():
        row.info.rich_help_panel = None if heading == "Options" else heading


def _only(*kept: str) -> dict[str, None]:
    """Return rows that leave out all of compare's settings but these."""
    return {field.name: None for field in dataclasses.fields(CompareSettings) if field.name not in kept}


OPTIONS: dict[str, dict[str, Row | None]] = {
    "compare": {
        "scene": _arg("A scene's folder, its scene.toml or its name; or a Mitsuba file (XML).", **SCENE),
        "out": _opt("Folder for the report (out/SCENE).", "DIR", *OUT),
    },
    "diff": {
        "a": _arg("Image to test: EXR, PFM, a picture of 8 bits; several renders as a folder or 'x_*.exr'.", "A"),
        "b": _arg("Reference, likewise; two folders are compared name by name.", "B"),
        "layer": _opt("Layer (diffuse of diffuse.R), channel or part; of one side: A.exr:diffuse.", "NAME"),
        "tolerance": _opt("Largest error of 99.9 % of the noise-free values, relative to B.", kind=float),
        "false_alarm_rate": _opt("Share of correct noisy pairs that fail by chance."),
        "noise": _opt("Whose variance to believe: both, reference (not A's), or none.", kind=str),
        "variance_a": _opt("Image with the variance of A's mean.", "FILE"),
        "variance_b": _opt("Image with the variance of B's mean.", "FILE"),
        "scene": _opt(
            "Scene that both images show, so that a failure names its cause (B's).", "SCENE", kind=Path | None, **SCENE
        ),
        "samples": None,
        "samples_a": _opt("A's samples per pixel, if the file does not say.", min=0),
        "samples_b": _opt("B's samples per pixel.", min=0),
        "out": _opt("Folder for report.html, heatmap.png, comparison.json (none).", "DIR", *OUT),
    },
    "levels": {
        "tolerance": _opt("Largest error (RMSE in radiance, unless --metric says otherwise)."),
        "metric": _opt("rmse, relmse, mae, max_abs, p999_abs or p999_rel."),
    },
    "laws": {
        "renderer": _arg("A method, FILE.py:FUNCTION, tracer.py, or a command with {scene} and {out}.", "WHAT"),
        "scene": _opt("Scene to change.", "SCENE", kind=Path | None, **SCENE),
        "without": _opt("Leave out `planes`, for a renderer that has no rectangles.", "planes"),
        **_only("rung", "sampling", "size", "budget"),
    },
    "shrink": {
        "time_limit": _opt("Try no further step after this time.", "SECONDS"),
        **_only("subject", "rung", "samples", "seed", "size", "light"),
    },
    "explore": {
        "view": _opt("Open a view copied from the page.", "LINK"),
        "port": _opt("Port of the page's address; 0: any free one."),
        "browser": _opt("Open the page in a browser.", None, "--browser/--no-browser"),
    },
    "walk": {
        "notebook": _opt("Write a Jupyter notebook instead of a script.", None, "--notebook"),
    },
    "scenes export": {
        "mitsuba_xml": _opt("Write a Mitsuba 3 scene.", None, "--mitsuba-xml"),
        "rung": _opt("Light level: in JSON (shadow) or of the XML, sky or path (path)."),
        "out": _opt("File to write (standard output).", "FILE", *OUT),
    },
    "scenes copy": {
        "out": _arg("Folder to write (./NAME).", "[DIR]"),
    },
    "photo": {
        "board": _opt("TOML file of the board.", "BOARD", kind=Path | None),
        "photos": _arg("Photos of the board, or their folder.", "PHOTOS..."),
    },
    "photo calibrate": {
        "board": _opt("TOML file of the board (board.toml beside the photos).", "BOARD"),
        "model": _opt("Lens model: auto, none, k1k2 or full5."),
        "photo": _opt("Photo whose pose is written (the first).", "NAME"),
        "out": _opt("Write the camera, as TOML, and a page beside it.", "FILE", *OUT),
    },
    "photo light": {
        "photo": _arg("A photo of the board.", "PHOTO"),
        "camera": _opt("camera.toml, as `raytwin photo calibrate -o` writes it.", "FILE"),
        "out": _opt("light.toml to write; a map and a page go beside it.", "FILE", *OUT),
        "ball": _opt("A mirror ball's rough center and its radius, metres or 20mm.", "X,Y,Z,R"),
        "stand": _opt("Foot and height of a pin or pen that stands upright, metres or 20mm.", "X,Y,H"),
    },
    "photo draw": {
        "scene": _opt("Scene whose objects are drawn.", "SCENE", **SCENE),
        "camera": _opt("camera.toml (default: calibrate the scene's own photos).", "FILE", kind=Path | None),
        "boxes": _opt("Outline each sphere's trim box.", None, "--boxes"),
        "exposure": _opt("The photo's linear value of radiance 1 (1; with --light, from its paper).", min=0.0),
    },
    "photo simulate": {
        "scene": _opt("Scene that gives sun, sky and table (its planes).", "SCENE", **SCENE),
        "board": _opt("TOML file of the board.", "BOARD"),
        "count": _opt("Number of photos.", min=1, max=1000),
        "size": _opt("Size of a photo in pixels (2016x1512).", **SIZE),
        "samples": _opt("Light paths per pixel.", min=1),
        "with_objects": _opt("Put the scene's objects there, too.", None, "--with-objects"),
    },
    "photo board": {
        "out": _opt("PDF to write, with a TOML beside it.", "FILE", *OUT),
        "tag": _opt("Edge of a tag's black square, with its unit.", "LENGTH"),
        "columns": _opt("Tags in a row.", "N"),
        "rows": _opt("Rows of tags.", "N"),
        "pitch": _opt("Distance between tag centres.", "LENGTH"),
        "paper": _opt("a4 or letter.", "NAME"),
    },
    "reference": {
        "scenes": _arg("Scenes: folders, names, Mitsuba files (XML). Default: all."),
        "rung": _opt("Light level: surface, lambert, shadow, sky or path; repeatable."),
        "folder": _opt("Folder of the references (reference/).", "DIR", "--folder"),
        "samples": _opt("Samples per pixel where there is noise (4096), a multiple of 64."),
        "sampling": _opt("Rays through the pixel's center (default), or spread over its area.", "center|area"),
        "size": _opt("Size in pixels (about 336x252).", **SIZE),
        "again": _opt("Render even what is up to date.", None, "--again"),
        "yes": _opt("Replace old references without asking.", None, "--yes", "-y"),
    },
    "reference accept": {
        "new": _arg("Image that a test run kept, or SCENE/RUNG.", "NAME"),
        "because": _opt("Why, for the file's header.", "REASON"),
    },
    "reference merge": {
        "folders": _arg("Reports, one per machine.", "FOLDER..."),
    },
    "grade": {
        "submissions": _arg("Folder with a file or folder per student; or a single submission."),
        "rubric": _opt("TOML file with exercises and points.", "FILE", "--rubric", "-r"),
        "again": _opt("Grade finished submissions again.", None, "--again"),
        "whole": _opt("Treat the folder as one submission.", None, "--whole"),
        "gradescope": _opt("Write Gradescope's results.json.", "FILE"),
        "for_students": _opt("Also write a page per student to hand out, to for-students/.", None, "--for-students"),
        "force": _opt("Overwrite an existing file.", None, "--force"),
        "stage": _opt("Functions to include: names with commas between, or repeat it (default: the six)."),
        "wheel": _opt("Install this wheel of raytwin; a development version needs one.", "FILE"),
    },
    "grade starter": {
        "out": _opt("File to write (tracer.py or rubric.toml).", "FILE", *OUT),
        "rubric": _opt("Write a complete rubric instead, to edit.", None, "--rubric"),
    },
    "grade zip": {"rubric": _arg("The rubric, TOML."), "out": _opt("Zip to write.", "FILE", *OUT)},
    "bench": {
        "methods": _opt("Patterns of method names, which `raytwin bench list` prints.", "GLOB,...", "--methods"),
        "scenes": _arg("Scenes: folders, scene.toml or names.", "SCENE", **SCENE),
        "subject": _opt("Renderer to judge and measure, as in compare; repeatable. Decides the exit code.", "WHAT"),
        "sizes": _opt("Picture sizes in megapixels.", "MP,..."),
        "budget": _opt("Time for all scenes; methods that do not fit are listed.", "SECONDS"),
    },
    "stability": {
        "experiments": _arg("Names from --list; all by default.", "[EXPERIMENT]..."),
        "listed": _opt("List all experiments.", None, "--list"),
    },
}  # fmt: skip
"""Command -> parameter -> its own option; None: it has none. A subcommand's own rows come before its group's."""


def option(command: str, name: str) -> Row | None:
    """Return the option of a command's parameter: its own, its group's, or the common one; None without one."""
    own = (OPTIONS.get(of, {}) for of in (command, command.partition(" ")[0]))
    tables: tuple[Mapping[str, Row | None], ...] = (*own, *SHARED_OPTIONS.values())
    return next((rows[name] for rows in tables if name in rows), None)


def with_options(command: Callable[..., None], name: str) -> Callable[..., None]:
    """Return `command` with its parameters' options; a parameter that is a settings record has one for each field.

    Fields without an option keep their default.
    """
    records: dict[str, tuple[Any, list[str]]] = {}
    parameters: dict[str, inspect.Parameter] = {}

    def add(parameter: str, annotation: Any, default: Any) -> None:
        row = option(name, parameter)
        assert row is not None, f"{name}: {parameter} has no option"
        kind: Any = Annotated[row.kind or annotation, row.info]
        parameters[parameter] = inspect.Parameter(
            parameter, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind
        )

    for p in inspect.signature(command).parameters.values():
        if dataclasses.is_dataclass(p.annotation):
            fields = [field for field in dataclasses.fields(p.annotation) if option(name, field.name)]
            records[p.name] = p.annotation, [field.name for field in fields]
            for field in fields:
                add(field.name, field.type, field.default)
        else:
            add(p.name, p.annotation, p.default)

    def run(**given: Any) -> None:
        for record, (kind, names) in records.items():
            given[record] = kind(**{field: given.pop(field) for field in names})
        command(**given)

    run.__doc__ = command.__doc__
    run.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {parameter: p.annotation for parameter, p in parameters.items()}
    return run
