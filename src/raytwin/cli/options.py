"""Every option and argument of the command line: one table. A command's parameters say which of them it has."""

import dataclasses
import inspect
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from raytwin.cli.examples import EXAMPLES
from raytwin.cli.option_values import parse_size
from raytwin.cli.terminal import say
from raytwin.rungs import SAMPLINGS
from raytwin.study.settings import CompareSettings

Size = tuple[int, int] | None
"""Width and height in pixels, as `--size` gives them."""


def _known_scene(path: Path | None) -> Path | None:
    """Refuse a wrong name before anything heavy is imported."""
    from raytwin.scene_folders import find_scene

    if path is not None:
        find_scene(path)
    return path


def _known_scenes(paths: list[Path]) -> list[Path]:
    return [path for path in paths if _known_scene(path)]


def _flip(asked: bool) -> bool:
    if asked:
        from raytwin.compare.metrics import flip_is_installed

        if not flip_is_installed():
            say("raytwin: FLIP is left out, since it is not installed: pip install 'raytwin[flip]'", err=True)
    return asked


def _size(text: str | None) -> Size:
    return parse_size(text, "--size") if text else None


def _scenes() -> Iterable[str]:
    from raytwin.scene_folders import scene_folders

    return scene_folders()


def _among(words: Iterable[str] | Callable[[], Iterable[str]] | None) -> Any:
    """Return what completes a value from `words`, for a shell; None without any."""
    if words is None:
        return None
    return lambda incomplete: [w for w in (words() if callable(words) else words) if w.startswith(incomplete)]


def _opt(text: str, metavar: str | None = None, *names: str, among: Any = None, kind: Any = None, **more: Any) -> Any:
    """Return an option; `among`: what its values are; `kind`: its type, where that is not its parameter's."""
    info = typer.Option(*names, metavar=metavar, help=text, autocompletion=_among(among), **more)
    return info if kind is None else Annotated[kind, info]


def _info(row: Any) -> Any:
    """Return what typer knows of an option, with its type or without."""
    return row.__metadata__[0] if hasattr(row, "__metadata__") else row


def _arg(text: str, metavar: str | None = None, among: Any = None, **more: Any) -> Any:
    return typer.Argument(metavar=metavar, help=text, autocompletion=_among(among), **more)


OUT = "--out", "-o"
LEVELS = "surface", "lambert", "shadow", "sky", "path"
ENGINES = "numpy64", "numpy32", "drjit32", "drjit64", "cuda32", "cuda64"
SOLVERS = "robust", "stable", "paper", "textbook"
TRIMS = "conic", "corners", "none"
MODELS = "auto", "none", "k1k2", "full5"
ANY_SCENE = "A scene's folder, its scene.toml or its name; or a Mitsuba file (XML)."
METRICS = "rmse", "relmse", "mae", "max_abs", "p999_abs", "p999_rel"
OF_SHRINK = "subject", "rung", "samples", "seed", "size", "light"
"""Settings of `compare` that `shrink` has, too."""
OF_LAWS = "subject", "rung", "sampling", "size", "budget"
"""Settings of `compare` that `laws` has, too."""

TRACER, CERTAINTY, PLACE, FILES = "raytwin's own tracer", "How certain a verdict is", "Camera and light", "Files"
SHARED_OPTIONS: dict[str, dict[str, Any]] = {
    "": {
        "scene": _arg("A scene's folder, its scene.toml, or its name.", among=_scenes, callback=_known_scene),
        "subject": _opt(
            "Renderer to compare: a method (`raytwin bench list`), FILE.py:FUNCTION, an image, a folder of images, or a"
            " command with {scene} and {out} (raytwin's own tracer).", "WHAT", kind=str | None,
        ),
        "rung": _opt("Light level of the twin: surface, lambert, shadow, sky or path.", among=LEVELS),
        "samples": _opt("Samples per pixel (until the verdict is certain)."),
        "size": _opt("Render at another size than the camera's.", "WxH", callback=_size, kind=str | None),
        "jobs": _opt("Number of local processes.", "N", "--jobs", "-j"),
        "dask": _opt("Dask scheduler (extra `cluster`); its workers share the disk.", "ADDRESS"),
        "verbose": _opt("Print the seconds of every stage.", None, "--verbose", "-v"),
    },
    CERTAINTY: {
        "budget": _opt("Samples per pixel (1024) or time (30s) after which the verdict is undecided.", "N|TIME"),
        "detectable_bias": _opt(
            'Report "undecided" if a larger bias of the whole image could go unnoticed (0.1; 0.01 within budget).',
            "SHARE", "--detectable-bias", "--must-see", min=0,
        ),
        "detectable_tile_bias": _opt(
            'Report "undecided" if a larger bias of 24 x 24 pixels could go unnoticed.', "SHARE", min=0,
        ),
        "seed": _opt("Seed of the twin's samples."),
        "flip": _opt("Add the perceptual metric FLIP (slow; extra `flip`).", None, "--flip", callback=_flip),
    },
    TRACER: {
        "tracer_rung": _opt(
            "Light level of the tracer (the highest up to --rung that needs no sampling).", "RUNG", among=LEVELS,
        ),
        "engine": _opt(f"Tracer's engine: {', '.join(ENGINES)}.", among=ENGINES),
        "solver": _opt("Sphere solver: robust, stable, paper or textbook.", among=SOLVERS),
        "sampling": _opt("Rays through the pixel's center, or spread over its area.", "center|area", among=SAMPLINGS),
        "trim": _opt("Trim boxes: conic, corners or none.", among=TRIMS),
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
"""Heading in `--help` ("": Options) -> parameter -> the option that commands share."""
ORDER = [name for rows in SHARED_OPTIONS.values() for name in rows]
"""Of parameters in `--help`; those of one command alone stand beside `size`."""
for heading, shared in SHARED_OPTIONS.items():
    for name in shared:
        _info(shared[name]).rich_help_panel = heading

OPTIONS: dict[str, dict[str, Any]] = {
    "compare": {
        "scene": _arg(ANY_SCENE, among=_scenes, callback=_known_scene),
        "out": _opt("Folder for the report (out/SCENE).", "DIR", *OUT),
    },
    "diff": {
        "a": _arg("Image to test: EXR, PFM, a picture of 8 bits; several renders as a folder or 'x_*.exr'.", "A"),
        "b": _arg("Reference, likewise; two folders are compared name by name.", "B"),
        "part": _opt("Part of the EXR: name or number.", "NAME"),
        "layer": _opt("Layer (diffuse of diffuse.R) or channel; of one side: A.exr:diffuse.", "NAME"),
        "tolerance": _opt("Largest error of 99.9 % of the noise-free values, relative to B.", kind=float),
        "false_alarm_rate": _opt("Share of correct noisy pairs that fail by chance."),
        "noise": _opt("Whose variance to believe: both, reference (not A's), or none.", kind=str),
        "variance_a": _opt("Image with the variance of A's mean.", "FILE"),
        "variance_b": _opt("Image with the variance of B's mean.", "FILE"),
        "scene": _opt(
            "Scene that both images show, so that a failure names its cause (B's).", "SCENE", among=_scenes,
            callback=_known_scene, kind=Path | None,
        ),
        "rung": _opt("Light level that both show (shadow).", among=LEVELS),
        "samples": None,
        "samples_a": _opt("A's samples per pixel, if the file does not say.", min=0),
        "samples_b": _opt("B's samples per pixel.", min=0),
        "out": _opt("Folder for report.html, heatmap.png, comparison.json.", "DIR", *OUT),
    },
    "levels": {
        "tolerance": _opt("Largest error (RMSE in radiance, unless --metric says otherwise)."),
        "metric": _opt(f"{', '.join(METRICS[:-1])} or {METRICS[-1]}.", among=METRICS),
        "size": _opt("Size of the pictures; 320 wide by default.", "WxH", callback=_size, kind=str | None),
        "out": _opt("Folder for page and chart (in out/).", "DIR", *OUT),
    },
    "laws": {
        "renderer": _arg("What --subject takes, as tracer.py.", "[WHAT]"),
        "scene": _opt("Scene to change.", "SCENE", among=_scenes, callback=_known_scene, kind=Path | None),
        "subject": _opt("Renderer to judge; see `raytwin compare --subject`.", "WHAT", kind=str | None),
        "rung": _opt("Light level that it renders: lambert, shadow, sky or path.", among=LEVELS),
        "without": _opt("Leave out `planes`, for a renderer that has no rectangles.", "planes", among=("planes",)),
        "out": _opt("Folder for laws.html and laws.json (out/laws).", "DIR", *OUT),
        **{field.name: None for field in dataclasses.fields(CompareSettings) if field.name not in OF_LAWS},
    },
    "shrink": {
        "subject": _opt("Renderer that fails: a method, FILE.py:FUNCTION, or a command with {scene} and {out}.", "WHAT",
                        kind=str | None),
        "time_limit": _opt("Try no further step after this time.", "SECONDS"),
        "out": _opt("Folder for the small scene (out/shrink-SCENE).", "DIR", *OUT),
        **{field.name: None for field in dataclasses.fields(CompareSettings) if field.name not in OF_SHRINK},
    },
    "explore": {
        "subject": _opt("Renderer to show; see `raytwin compare --subject`.", "WHAT"),
        "size": _opt("Size of the pictures (the camera's, at most 800 wide).", "WxH", callback=_size, kind=str | None),
        "view": _opt("Open a view copied from the page.", "LINK"),
        "port": _opt("Port of the page's address; 0: any free one."),
        "browser": _opt("Open the page in a browser.", None, "--browser/--no-browser"),
    },
    "walk": {
        "notebook": _opt("Write a Jupyter notebook instead of a script.", None, "--notebook"),
        "out": _opt("Folder to write to.", "DIR", *OUT),
        "solved": _opt("Fill in every function.", None, "--solved"),
    },
    "scenes.export": {
        "json": _opt("Write JSON, as programs of --subject read it.", None, "--json"),
        "mitsuba_xml": _opt("Write a Mitsuba 3 scene.", None, "--mitsuba-xml"),
        "rung": _opt("Light level: in JSON (shadow) or of the XML, sky or path (path).", among=LEVELS),
        "out": _opt("File to write (standard output).", "FILE", *OUT),
    },
    "scenes.copy": {
        "scene": _arg("Name or folder of the scene.", among=_scenes),
        "out": _arg("Folder to write (./NAME).", "[DIR]"),
    },
    "photo.calibrate": {
        "photos": _arg("Photos of the board, or their folder.", "PHOTOS..."),
        "board": _opt("TOML file of the board (board.toml beside the photos).", "BOARD"),
        "model": _opt("Lens model: auto, none, k1k2 or full5.", among=MODELS),
        "photo": _opt("Photo whose pose is written (the first).", "NAME"),
        "out": _opt("Write the camera, as TOML, and a page beside it.", "FILE", *OUT),
    },
    "photo.light": {
        "photos": _arg("A photo of the board.", "PHOTO"),
        "board": _opt("TOML file of the board (board.toml beside the photos).", "BOARD", kind=Path | None),
        "camera": _opt("camera.toml, as `raytwin photo calibrate -o` writes it.", "FILE"),
        "out": _opt("light.toml to write; a map and a page go beside it.", "FILE", *OUT),
        "ball": _opt("A mirror ball's rough center and its radius, metres or 20mm.", "X,Y,Z,R"),
        "stand": _opt("Foot and height of a pin or pen that stands upright, metres or 20mm.", "X,Y,H"),
    },
    "photo.draw": {
        "photos": _arg("Photos that show the board, or their folder.", "PHOTO..."),
        "scene": _opt("Scene whose objects are drawn.", "SCENE", among=_scenes),
        "out": _opt("Folder for the drawn photos.", "DIR", *OUT),
        "camera": _opt("camera.toml (default: calibrate the scene's own photos).", "FILE", kind=Path | None),
        "board": _opt("TOML file of the board (the scene's).", "BOARD", kind=Path | None),
        "shadows": _opt("Cast shadows on what the photo shows."),
        "boxes": _opt("Outline each sphere's trim box.", None, "--boxes"),
        "exposure": _opt("The photo's linear value of radiance 1 (1; with --light, from its paper).", min=0.0),
    },
    "photo.simulate": {
        "out": _opt("Folder for the photos and truth.toml.", "DIR", *OUT),
        "board": _opt("TOML file of the board.", "BOARD"),
        "scene": _opt("Scene that gives sun, sky and table (its planes).", among=_scenes),
        "count": _opt("Number of photos.", min=1, max=1000),
        "size": _opt("Size of a photo in pixels (2016x1512).", "WxH", callback=_size, kind=str | None),
        "focal": _opt("Focal length in pixels of a photo 2016 wide."),
        "dist": _opt("Distortion: k1,k2,p1,p2,k3 or a prefix."),
        "samples": _opt("Light paths per pixel.", min=1),
        "seed": _opt("Seed of poses, light paths and sensor noise."),
        "with_objects": _opt("Put the scene's objects there, too.", None, "--with-objects"),
    },
    "photo.board": {
        "out": _opt("PDF to write, with a TOML beside it.", "FILE", *OUT),
        "tag": _opt("Edge of a tag's black square, with its unit.", "LENGTH"),
        "columns": _opt("Tags in a row.", "N"),
        "rows": _opt("Rows of tags.", "N"),
        "pitch": _opt("Distance between tag centres.", "LENGTH"),
        "paper": _opt("a4 or letter.", "NAME"),
        "first_id": _opt("Id of the lower left tag.", "N"),
        "family": _opt("tag36h11, tag25h9 or tag16h5.", among=("tag36h11", "tag25h9", "tag16h5")),
    },
    "reference": {
        "scenes": _arg("Scenes: folders, names, Mitsuba files (XML). Default: all.", among=_scenes),
        "rung": _opt("surface, lambert, shadow, sky or path; repeatable.", None, "--rung", among=LEVELS),
        "folder": _opt("Folder of the references (reference/, or the built-in ones).", "DIR", "--folder"),
        "samples": _opt("Samples per pixel where there is noise (4096), a multiple of 64."),
        "seed": _opt("Seed of the samples (0)."),
        "sampling": _opt("center (default) or area.", among=SAMPLINGS),
        "size": _opt("Size in pixels (about 336x252).", "WxH", callback=_size, kind=str | None),
        "again": _opt("Render even what is up to date.", None, "--again"),
        "yes": _opt("Replace old references without asking.", None, "--yes", "-y"),
        "whole": _opt("Print everything known of each.", None, "--all"),
    },
    "reference.check": {
        "budget": _opt("Most samples per pixel, or time (30s), per reference.", "N|TIME", "--budget", "--samples"),
    },
    "reference.accept": {
        "new": _arg("Image that a test run kept, or SCENE/RUNG.", "NAME"),
        "because": _opt("Why, for the file's header.", "REASON"),
        "folder": _opt("Folder of the references.", "DIR", "--folder"),
    },
    "reference.merge": {
        "folders": _arg("Reports, one per machine.", "FOLDER..."),
        "out": _opt("Folder for index.html and summary.md.", "DIR", *OUT),
    },
    "reference.make": {"folder": _opt("Folder of the references.", "DIR", "--folder")},
    "reference.show": {
        "scenes": _arg("Scenes, or references (EXR). Default: all.", among=_scenes),
    },
    "grade": {
        "submissions": _arg("Folder with a file or folder per student; or a single submission."),
        "rubric": _opt("TOML file with exercises and points.", "FILE", "--rubric", "-r"),
        "out": _opt("Folder for pages and results.", "DIR", *OUT),
        "again": _opt("Grade finished submissions again.", None, "--again"),
        "whole": _opt("Treat the folder as one submission.", None, "--whole"),
        "gradescope": _opt("Write Gradescope's results.json.", "FILE"),
        "junit": _opt("Write JUnit XML.", "FILE"),
        "for_students": _opt("Also write a page per student to hand out, to for-students/.", None, "--for-students"),
        "force": _opt("Overwrite an existing file.", None, "--force"),
        "stage": _opt("Functions to include: names with commas between, or repeat it (default: the six)."),
        "wheel": _opt("Install this wheel of raytwin instead of the released version.", "FILE"),
    },
    "grade.starter": {
        "out": _opt("File to write (tracer.py or rubric.toml).", "FILE", *OUT),
        "rubric": _opt("Write a complete rubric instead, to edit.", None, "--rubric"),
    },
    "grade.zip": {"rubric": _arg("The rubric, TOML."), "out": _opt("Zip to write.", "FILE", *OUT)},
    "bench": {
        "methods": _opt("Patterns of method names, which `raytwin bench list` prints.", "GLOB,...", "--methods"),
        "scenes": _arg("Scenes: folders, scene.toml or names.", "SCENE", among=_scenes, callback=_known_scenes),
        "subject": _opt(
            "Renderer to judge and measure, as in compare; repeatable. Decides the exit code.", "WHAT", "--subject"
        ),
        "rung": _opt("Light level of --subject.", among=LEVELS),
        "sizes": _opt("Picture sizes in megapixels.", "MP,..."),
        "budget": _opt("Time for all scenes; methods that do not fit are listed.", "SECONDS"),
        "repeats": _opt("At most this many timed calls per method."),
        "truth_samples": _opt("At most this many samples per pixel of the reference."),
        "out": _opt("Folder for page and charts (in out/).", "DIR", *OUT),
    },
    "stability": {
        "experiments": _arg("Names from --list; all by default.", "[EXPERIMENT]..."),
        "listed": _opt("List all experiments.", None, "--list"),
        "out": _opt("Folder for page and charts (out/stability).", "DIR", *OUT),
    },
}  # fmt: skip
"""Command -> parameter -> its own option, or None. A command within a group has its own row, then the group's."""


def option(command: str, name: str) -> Any:
    """Return the option of a command's parameter: its own, its group's, or the common one; None without one."""
    own = OPTIONS.get(command, {}), OPTIONS.get(command.partition(".")[0], {})
    return next((rows[name] for rows in (*own, *SHARED_OPTIONS.values()) if name in rows), None)


def with_options(command: Callable[..., None], name: str) -> Callable[..., None]:
    """Return `command` with its parameters' options; a parameter that is a settings record has one for each field.

    Fields without an option keep their default. A parameter that is Annotated stays as it is.
    """
    records: dict[str, tuple[Any, tuple[str, ...]]] = {}
    parameters = []
    for p in inspect.signature(command).parameters.values():
        if dataclasses.is_dataclass(p.annotation):
            fields = [f for f in dataclasses.fields(p.annotation) if _is_option(name, f)]
            records[p.name] = p.annotation, tuple(f.name for f in fields)
            parameters += [_parameter(name, f.name, f.type, f.default) for f in fields]
        else:
            parameters.append(_parameter(name, p.name, p.annotation, p.default))

    parameters.sort(key=lambda p: ORDER.index(p.name if p.name in ORDER else "size"))

    def run(**given: Any) -> None:
        for record, (kind, names) in records.items():
            given[record] = kind(**{field: given.pop(field) for field in names})
        command(**given)

    run.__doc__ = command.__doc__
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


def group(default: str, alone: bool = False) -> typer.Typer:
    """Return a group of commands; words that begin with no command's name go to `default`, which has no name itself.

    So a folder may have any name but a listed command's, and `--help` shows what the group does by itself first.
    `alone`: the default needs no words. Without it no words at all show the help.
    """

    class OrDefault(TyperGroup):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            named = {*self.listed(), *ctx.help_option_names}
            by_itself = args[0] not in named if args else alone
            return super().parse_args(ctx, [default, *args] if by_itself else args)

        def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
            name, command, rest = super().resolve_command(ctx, args)
            return name if name in self.listed() else None, command, rest

        def listed(self) -> list[str]:
            return [name for name in self.commands if name != default or alone]

        def format_help(self, ctx: Any, formatter: Any) -> None:
            command: Any = self.commands[default]
            own = command.context_class(command, info_name=ctx.info_name, parent=ctx.parent)
            command.format_usage(own, formatter)
            command.format_help_text(own, formatter)
            command.format_options(own, formatter)
            with formatter.section("Commands"):
                formatter.write_dl([(name, self.commands[name].get_short_help_str(80)) for name in self.listed()])
            command.format_epilog(own, formatter)

    return typer.Typer(cls=OrDefault, no_args_is_help=True)


class UnderHeadings(TyperCommand):
    """A command whose options stand under headings in `--help`."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        rows: dict[str, list[tuple[str, str]]] = {
            "Arguments": [],
            "Options": [],
            **{h: [] for h in SHARED_OPTIONS if h},
        }
        for param in self.get_params(ctx):
            if record := param.get_help_record(ctx):
                argument = param.param_type_name == "argument"
                rows["Arguments" if argument else getattr(param, "rich_help_panel", "") or "Options"].append(record)
        for title, shown in rows.items():
            if shown:
                with formatter.section(title):
                    formatter.write_dl(shown)


def register(app: typer.Typer, commands: Mapping[str, Callable[..., None]], *, within: str = "") -> None:
    """Add each command to `app`, with its options and its example; `within`: the group's name."""
    for name, command in commands.items():
        full = f"{within}.{name}" if within else name
        app.command(name, cls=UnderHeadings, epilog=f"Example: {EXAMPLES[full]}")(with_options(command, full))


def _is_option(command: str, field: "dataclasses.Field[Any]") -> bool:
    """Return whether a record's field has an option: a row with a type, its own or the field's."""
    row = option(command, field.name)
    return row is not None and (hasattr(row, "__metadata__") or not isinstance(field.type, str))


def _parameter(command: str, name: str, kind: Any, default: Any) -> inspect.Parameter:
    if not hasattr(kind, "__metadata__"):
        row = option(command, name)
        kind = row if hasattr(row, "__metadata__") else Annotated[kind, row]
    empty = inspect.Parameter.empty if default is dataclasses.MISSING else default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=empty, annotation=kind)
