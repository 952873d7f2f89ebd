"""What `raytwin compare --subject` and `raytwin.method` take: a method by its name, or a renderer of any kind."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from raytwin.errors import InputError, check_one_of
from raytwin.images.exr import split_layer
from raytwin.images.image_input import RENDERS
from raytwin.removed import removed_renderer
from raytwin.renderers.renderer import Renderer
from raytwin.renderers.renderer_table import RENDERERS
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.renderers.subject_renderers import Traced
from raytwin.renderers.user_renderers import DEFAULT_SAMPLES, UserRenderer, of_function, takes_of
from raytwin.rungs import RUNGS, SAMPLINGS
from raytwin.safe_write import check_file
from raytwin.scene import Scene
from raytwin.teach.contract.composed_tracer import PARTS
from raytwin.teach.contract.subject_process import SubjectFunction, SubjectProcess
from raytwin.teach.contract.submission import Shown, load


def find_subject(what: str | Renderer | Callable[..., Any], rung: str, sampling: str = "center") -> Renderer:
    """Return the renderer that `what` names.

    A name of RENDERERS; FILE.py, FILE.ipynb, either with :FUNCTION; an image or a folder of images; a command. A
    Renderer stands for itself, a function for its `method` at `rung` and `sampling`. Python files and notebooks
    run in a process of their own.
    """
    if isinstance(what, Renderer):
        return what
    if not isinstance(what, str):
        return method(what, rung=rung, sampling=sampling, renders=RENDERS)
    text = what
    if text in RENDERERS:
        known = RENDERERS[text]
        return replace(known, surface=True) if isinstance(known, Traced) else known
    if gone := removed_renderer(text):
        raise InputError("--subject", "a renderer that raytwin has", gone)
    path = text.rpartition(":")[0] or text
    python = path.endswith((".py", ".ipynb"))
    if "{out}" not in text and not split_layer(path if python else text)[0].exists():
        images = "an image, a folder of images, or a command with {scene} and {out}"
        expected = f"a method's name (`raytwin bench list`), FILE.py:FUNCTION, {images}"
        raise InputError("--subject", expected, text + ", but no such file" * python)
    if Path(text).exists() and not Path(text).is_dir():
        check_file(text, "an image, a folder of images, or Python")
    if python:
        process = SubjectProcess(text)
        about = process.describe()
        found = {name: SubjectFunction(process, name, takes) for name, takes in about["functions"].items()}
        own: dict[str, Callable[..., Any]] = {name: f for name, f in found.items() if name in PARTS}
        render: Callable[..., Any] = found["render"]
        made = about["made"]
    else:
        own = {}
        render, made = load(text).picture()
    describe = _name if isinstance(render, Shown) else as_arrays
    takes = takes_of(render)
    return UserRenderer(
        rung, f"{text} ({made})" if made else text, render, describe, own, noisy="seed" in takes,
        renders=RENDERS if "seed" in takes else 1, samples=DEFAULT_SAMPLES if takes >= {"seed", "samples"} else 0,
    )  # fmt: skip


def method(
    what: Callable[..., Any] | str,
    name: str = "",
    *,
    rung: str = "shadow",
    sampling: str = "center",
    renders: int = 1,
    records: bool = False,
) -> Renderer:
    """Return a renderer of your own as a method: for `compare_scene(subject=...)` and `bench(methods=[...])`.

    `what` is a function, or a text as `--subject` takes it: "mine.py:render", a command with {scene} and {out}, an
    image, a folder of images, or a method's name. `function(scene)` returns linear radiance (H, W, 3), row 0 on top, or
    an Image. `scene` is a dict of plain values and arrays, in metres, as programs of `--subject` read it; with
    `records`, the Scene itself. A function that also takes `seed` has noise: of `renders` seeds the mean is taken, and
    their spread gives its noise (4 or more). `name`: what charts call it, by default the function's own. `rung`: the
    light level that it renders. `sampling`: whether its rays go through the pixel's "center" or over its "area". An
    image of another size raises InputError when it is made. `renders` and `records` hold for functions alone.

    >>> import numpy as np
    >>> def grey(scene):
    ...     return np.full((scene["height"], scene["width"], 3), 0.5)
    >>> method(grey).name, method("numpy32-shadow-conic").name
    ('grey', 'numpy32-shadow-conic')
    """
    check_one_of("rung", rung, RUNGS)
    check_one_of("sampling", sampling, SAMPLINGS)
    if isinstance(what, str):
        if renders != 1 or records:
            raise InputError("method", "a function beside `renders` or `records`", what)
        found = find_subject(what, rung)
        return replace(found, name=name or found.name, sampling=sampling) if isinstance(found, UserRenderer) else found
    return of_function(what, name, rung, sampling, renders, records)


def _name(scene: Scene, rung: str) -> dict[str, Any]:
    """Return all that an image needs, so that it may also be of a scene with a sky map or highlights."""
    return {"name": scene.name, "rung": rung}
