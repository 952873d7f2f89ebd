"""Options that several commands share, and what their texts mean. Everything here is checked before work begins."""

import dataclasses
import inspect
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from raytwin.cli.terminal import say
from raytwin.errors import InputError

if TYPE_CHECKING:
    from raytwin.scene import Material, Sphere


def _known_scene(path: Path) -> Path:
    """Refuse a wrong name before anything heavy is imported."""
    from raytwin.files import find_scene

    find_scene(path)
    return path


ScenePath = Annotated[
    Path, typer.Argument(callback=_known_scene, help="A scene's folder, its scene.toml, or its name.")
]
AnyScene = Annotated[
    Path,
    typer.Argument(
        callback=_known_scene, help="A scene's folder, its scene.toml or its name; or a Mitsuba file (XML)."
    ),
]


def _allow(names: list[str] | None) -> list[str] | None:
    """Put the names where every reader of a Mitsuba file sees them, and every process that is started."""
    from raytwin.files import ALLOW, allowed

    if names:
        os.environ[ALLOW] = os.pathsep.join((*allowed(), *names))
    return names


Allow = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        callback=_allow,
        is_eager=True,
        help="File or folder outside a Mitsuba file's own, or plugin, that it may use; repeatable.",
    ),
]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the numbers as JSON.")]
Photo = Annotated[str | None, typer.Option(metavar="NAME", help="Photo whose camera pose is used.")]

Jobs = Annotated[int, typer.Option("--jobs", "-j", metavar="N", help="Number of local processes.")]
Dask = Annotated[
    str, typer.Option(metavar="ADDRESS", help="Dask scheduler (extra `cluster`); its workers share the disk.")
]
Shard = Annotated[str, typer.Option(metavar="K/N", help="Do only the K-th of N shares: one task of a Slurm array.")]


def _flip(asked: bool) -> bool:
    if asked:
        from raytwin.compare.metrics import flip_is_installed

        if not flip_is_installed():
            say("raytwin: FLIP is left out, since it is not installed: pip install 'raytwin[flip]'", err=True)
    return asked


Flip = Annotated[
    bool, typer.Option("--flip", callback=_flip, help="Add NVIDIA's perceptual metric FLIP (slow; extra `flip`).")
]

MOST_PIXELS = 400_000_000
"""As much as a file may have."""
MOST_SIDE = 100_000
"""Pixels of a picture's width or height that are taken for meant."""


def _size(text: str | None) -> tuple[int, int] | None:
    return parse_size(text, "--size") if text else None


DetectableBias = Annotated[
    float | None,
    typer.Option(
        "--detectable-bias",
        "--must-see",
        min=0,
        metavar="SHARE",
        help='Report "undecided" if a larger bias of the whole image could go unnoticed (0.1; rounds seek 0.01).',
    ),
]
DetectableTileBias = Annotated[
    float | None,
    typer.Option(
        min=0, metavar="SHARE", help='Report "undecided" if a larger bias of 24 x 24 pixels could go unnoticed.'
    ),
]

OPTIONS: dict[str, Any] = {
    "rung": Annotated[str, typer.Option(help="Light level of the twin: surface, lambert, shadow, sky or path.")],
    "tracer_rung": Annotated[
        str | None,
        typer.Option(
            metavar="RUNG", help="Light level of the tracer (the highest up to --rung that needs no sampling)."
        ),
    ],
    "subject": Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="Renderer to compare: a method (`raytwin bench list`), FILE.py:FUNCTION, an image, a folder of"
            " images, or a command with {scene} and {out}. Default: raytwin's own tracer.",
        ),
    ],
    "engine": Annotated[
        str, typer.Option(help="Tracer's engine: numpy64, numpy32, drjit32, drjit64, cuda32 or cuda64.")
    ],
    "solver": Annotated[str, typer.Option(help="Sphere solver: robust, stable, paper or textbook.")],
    "sampling": Annotated[str, typer.Option(help="Rays through the pixel's center, or spread over its area.")],
    "samples": Annotated[
        int | None, typer.Option(help="Samples per pixel of both sides (default: until the verdict is certain).")
    ],
    "budget": Annotated[
        str | None,
        typer.Option(
            metavar="N|TIME", help="Most samples per pixel (1024), or time (30s), until the verdict is undecided."
        ),
    ],
    "seed": Annotated[int, typer.Option(help="Seed of the twin's samples.")],
    "photo": Photo,
    "size": Annotated[
        str | None, typer.Option(metavar="WxH", callback=_size, help="Render at another size than the camera's.")
    ],
    "cache": Annotated[bool, typer.Option(help="Reuse stored renders and tag detections.")],
    "flip": Flip,
    "part": Annotated[str | None, typer.Option(metavar="NAME", help="Part of the EXR: name or number.")],
    "layer": Annotated[
        str | None, typer.Option(metavar="NAME", help="Layer (diffuse for diffuse.R ...) or a single channel.")
    ],
    "tolerance": Annotated[
        float, typer.Option(help="Largest error of 99.9 % of the noise-free values, relative to B.")
    ],
    "false_alarm_rate": Annotated[float, typer.Option(help="Share of correct noisy pairs that fail by chance.")],
    "noise": Annotated[str, typer.Option(help="Whose variance to believe: both, reference (not A's), or none.")],
    "detectable_bias": DetectableBias,
    "detectable_tile_bias": DetectableTileBias,
    "camera": Annotated[
        Path | None, typer.Option(metavar="FILE", help="camera.toml (default: calibrate the scene's own photos).")
    ],
    "board": Annotated[Path | None, typer.Option(metavar="BOARD", help="TOML file of the board (the scene's).")],
    "against": Annotated[
        Path | None, typer.Option(metavar="DIR", help="True photos of the same names: report the error by region.")
    ],
    "shadows": Annotated[bool, typer.Option(help="Cast shadows on what the photo shows.")],
    "exposure": Annotated[float, typer.Option(min=0.0, help="The photo's linear value of radiance 1.")],
}
"""Field of a settings record -> its option."""


def with_options(command: Callable[..., None], record: type, *, but: tuple[str, ...] = ()) -> Callable[..., None]:
    """Return `command` with an option for each field of `record` in the place of its parameter `settings`.

    A field's default is its option's; fields that are no row of OPTIONS, or named in `but`, keep their default.
    """
    fields = {f.name: f.default for f in dataclasses.fields(record) if f.name in OPTIONS and f.name not in but}

    def run(**given: Any) -> None:
        command(settings=record(**{name: given.pop(name) for name in fields}), **given)

    parameters = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name == "settings":
            parameters += [
                inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=OPTIONS[name])
                for name, default in fields.items()
            ]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    run.__doc__ = command.__doc__
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


def parse_size(text: str, option: str) -> tuple[int, int]:
    """
    >>> parse_size("640x480", "--size")
    (640, 480)
    """
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text)
    if not match or not all(0 < int(side) <= MOST_SIDE for side in match.groups()):
        raise InputError(option, "WIDTHxHEIGHT in pixels, as 640x480", text)
    width, height = int(match[1]), int(match[2])
    if width * height > MOST_PIXELS:
        gigabytes = 12e-9 * width * height
        raise InputError(option, f"at most {MOST_PIXELS / 1e6:.0f} megapixels", f"{text}, {gigabytes:.0f} GB an image")
    return width, height


def parse_numbers(text: str, option: str, most: int | None = None) -> tuple[float, ...]:
    """At most `most` finite numbers.

    >>> parse_numbers("0.1,-0.2", "--dist"), parse_numbers("", "--dist")
    ((0.1, -0.2), ())
    """
    try:
        numbers = tuple(float(part) for part in text.split(",")) if text.strip() else ()
    except ValueError:
        raise InputError(option, "numbers separated by commas", text) from None
    if not all(map(math.isfinite, numbers)):
        raise InputError(option, "finite numbers", text)
    if most is not None and len(numbers) > most:
        raise InputError(option, f"at most {most} numbers", len(numbers))
    return numbers


def parse_sphere(text: str, option: str, material: "Material") -> "Sphere":
    """A sphere of this material from its center and radius: 'x,y,z,r'."""
    from raytwin.scene import Sphere

    numbers = parse_numbers(text, option)
    if len(numbers) != 4 or not numbers[3] > 0:
        raise InputError(option, "x,y,z,r in metres, r > 0", text)
    return Sphere((numbers[0], numbers[1], numbers[2]), numbers[3], material)


def parse_stand(text: str, option: str) -> tuple[float, float, float]:
    """The foot (x, y) and the height of an upright: 'x,y,h'."""
    numbers = parse_numbers(text, option)
    if len(numbers) != 3 or not numbers[2] > 0:
        raise InputError(option, "x,y,h in metres, h > 0", text)
    return numbers[0], numbers[1], numbers[2]


def parse_counts(text: str, option: str) -> tuple[int, ...]:
    """'1,10,100' as (1, 10, 100)."""
    numbers = parse_numbers(text, option)
    if not all(n == n // 1 for n in numbers):
        raise InputError(option, "whole numbers", text)
    return tuple(int(n) for n in numbers)


def check_outputs(*, folders: tuple[Path | None, ...] = (), files: tuple[Path | None, ...] = ()) -> None:
    """InputError where an output cannot be written, before the work that it is to hold. Nothing is made."""
    kinds = {True: "a folder", False: "a file"}
    for path, folder in (*((p, True) for p in folders if p), *((p, False) for p in files if p)):
        if not _is_utf8(path):
            raise InputError("the name of an output", "UTF-8", ascii(str(path)))
        if path.exists():
            if path.is_dir() != folder:
                raise InputError(path, f"{kinds[folder]} to write", kinds[not folder])
            above = path
        else:
            above = next(p for p in path.absolute().parents if p.exists())
            if not above.is_dir():
                raise InputError(path, "a writable path", f"{above}, which is a file")
        if not os.access(above, os.W_OK):
            raise InputError(path, "a writable path", "one without write permission")


def _is_utf8(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True
