"""Images that others make, by whatever function of a scene."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.errors import InputError, check_one_of
from raytwin.image import Image
from raytwin.image_input import as_image
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.scene_exchange import as_arrays, as_file
from raytwin.rungs import RUNGS
from raytwin.scene import MitsubaScene, Scene


@dataclass(frozen=True)
class UserRenderer(Renderer):
    """`render`, known as `title`, called with `describe(scene, rung)`; it returns radiance (H, W, 3), or an Image.

    One that takes a `seed` is `seeded`: it is called with that many `renders`, whose spread gives the noise. One that
    takes `samples` too is asked for that many (0: it is not). `rays`: where they go, through the pixel's center or over
    its area.
    """

    NAME = "{0.title}"
    title: str = ""
    render: Callable[..., Any] | None = None
    describe: Callable[[Scene, str], Any] = as_arrays
    stages: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """The functions of single stages that the same file has."""
    seeded: bool = False
    renders: int = 1
    rays: str = "center"
    samples: int = 0
    library = "python"

    @property
    def sampling(self) -> str:
        return self.rays

    @property
    def noisy(self) -> bool:
        return self.seeded

    def prepare(self, scene: Scene | MitsubaScene) -> Call:
        width, height = scene.image_size

        def call(seed: int) -> Image:
            if not self.seeded or self.renders == 1:
                return once(seed)
            return as_image([once(seed * self.renders + i) for i in range(self.renders)]).image

        def once(seed: int) -> Image:
            given = self.describe(scene, self.rung) if isinstance(scene, Scene) else as_file(scene)
            also = ({"seed": seed} if self.seeded else {}) | ({"samples": self.samples} if self.samples else {})
            try:
                made = self.render(given, **also) if self.render else None
                if made is None:
                    raise InputError(self.name, "returned None: is there a return?")
                taken = made if isinstance(made, Image) else as_image(np.asarray(made)).image
            except InputError:
                raise
            except (Exception, SystemExit) as error:  # theirs, whatever it is: the program that runs it goes on
                raise InputError(self.name, "an image (H, W, 3)", f"{type(error).__name__}: {error}") from error
            if taken.mean.dtype.kind not in "fiu" or taken.shape != (height, width, 3):
                wanted = f"an image ({height}, {width}, 3)"
                raise InputError(self.name, wanted, f"{taken.mean.dtype} {taken.shape}")
            if isinstance(made, Image) and (taken.variance is not None or not self.samples):
                return taken
            alone = Image(taken.mean.astype(np.float32), surface=taken.surface)
            return replace(alone, samples=self.samples, batches=1) if self.samples else alone

        return call


def method(
    function: Callable[..., Any],
    name: str = "",
    *,
    rung: str = "shadow",
    sampling: str = "center",
    renders: int = 1,
    records: bool = False,
) -> UserRenderer:
    """Return a function of your own as a method: for `compare_scene(subject=...)` and `bench(methods=[...])`.

    `function(scene)` returns linear radiance (H, W, 3), row 0 on top, or an Image. `scene` is a dict of plain values
    and arrays, in metres, as programs of `--subject` read it; with `records`, the Scene itself. A function that also
    takes `seed` has noise: of `renders` seeds the mean is taken, and their spread gives its noise (4 or more). `name`:
    what charts call it, by default the function's own. `rung`: the light level that it renders. `sampling`: whether its
    rays go through the pixel's "center" or over its "area". An image of another size raises InputError when it is made.

    >>> import numpy as np
    >>> def grey(scene):
    ...     return np.full((scene["height"], scene["width"], 3), 0.5)
    >>> method(grey).name
    'grey'
    """
    check_one_of("rung", rung, RUNGS)
    check_one_of("sampling", sampling, ("center", "area"))
    title = name or getattr(function, "__name__", type(function).__name__)
    if not callable(function):
        raise InputError("method", "a function of a scene", repr(function))
    takes = takes_of(function)
    describe = _itself if records else as_arrays
    few = FEW if takes >= {"seed", "samples"} else 0
    return UserRenderer(rung, title, function, describe, {}, "seed" in takes, renders, sampling, few)


FEW = 16
"""Samples per pixel that a function is asked for, where nothing else is said."""


def takes_of(function: Callable[..., Any]) -> set[str]:
    """Return which of `seed` and `samples` a function takes, or says so itself (`takes`); none if it is compiled."""
    try:
        names = getattr(function, "takes", None) or inspect.signature(function).parameters
    except (TypeError, ValueError):
        return set()
    return {"seed", "samples"} & set(names)


def _itself(scene: Scene, rung: str) -> Scene:
    return scene
