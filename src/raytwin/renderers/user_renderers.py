"""Images that others make, by whatever function of a scene."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.image_input import as_image
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.scene_exchange import as_arrays, as_file
from raytwin.scene import MitsubaScene, Scene


@dataclass(frozen=True)
class UserRenderer(Renderer):
    """`render`, known as `name`, called with `describe(scene, rung)`; it returns radiance (H, W, 3), or an Image.

    One that takes a `seed` is `noisy`: it is called with that many `renders`, whose spread gives the noise. One that
    takes `samples` too is asked for that many (0: it is not). `sampling`: whether its rays go through the pixel's
    center or over its area.
    """

    name: str = ""
    render: Callable[..., Any] | None = None
    describe: Callable[[Scene, str], Any] = as_arrays
    stages: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """The functions of single stages that the same file has."""
    noisy: bool = False
    renders: int = 1
    sampling: str = "center"
    samples: int = 0
    library = "python"

    def prepare(self, scene: Scene | MitsubaScene) -> Call:
        width, height = scene.image_size

        def call(seed: int) -> Image:
            if not self.noisy or self.renders == 1:
                return once(seed)
            return as_image([once(seed * self.renders + i) for i in range(self.renders)]).image

        def once(seed: int) -> Image:
            given = self.describe(scene, self.rung) if isinstance(scene, Scene) else as_file(scene)
            also = ({"seed": seed} if self.noisy else {}) | ({"samples": self.samples} if self.samples else {})
            try:
                made = self.render(given, **also) if self.render else None
                if made is None:
                    raise InputError(self.name, "returned None: is there a return?")
                taken = as_image(made).image
            except InputError:
                raise
            except (Exception, SystemExit) as error:  # a user's code may raise anything
                raise InputError(self.name, "an image (H, W, 3)", f"{type(error).__name__}: {error}") from error
            if taken.mean.dtype.kind not in "fiu" or taken.shape != (height, width, 3):
                wanted = f"an image ({height}, {width}, 3)"
                raise InputError(self.name, wanted, f"{taken.mean.dtype} {taken.shape}")
            if taken.variance is not None or (isinstance(made, Image) and not self.samples):
                return taken
            alone = replace(taken, mean=taken.mean.astype(np.float32), samples=1, batches=None)
            return replace(alone, samples=self.samples, batches=1) if self.samples else alone

        return call


DEFAULT_SAMPLES = 16
"""Samples per pixel that a function is asked for, where nothing else is said."""


def takes_of(function: Callable[..., Any]) -> set[str]:
    """Return which of `seed` and `samples` a function takes, or lists in its own `takes`; none if it is compiled."""
    if (names := getattr(function, "takes", None)) is None:
        try:
            names = inspect.signature(function).parameters
        except (TypeError, ValueError):
            return set()
    return {"seed", "samples"} & set(names)


def of_function(
    function: Callable[..., Any], name: str, rung: str, sampling: str, renders: int = 1, records: bool = False
) -> UserRenderer:
    """Return the renderer that a function is, as `raytwin.method` describes. Raises InputError for what is none."""
    if not callable(function):
        raise InputError("method", "a function of a scene, or a text as --subject takes it", repr(function))
    title, takes = name or getattr(function, "__name__", type(function).__name__), takes_of(function)
    few = DEFAULT_SAMPLES if takes >= {"seed", "samples"} else 0
    describe = _itself if records else as_arrays
    return UserRenderer(rung, title, function, describe, {}, "seed" in takes, renders, sampling, few)


def _itself(scene: Scene, rung: str) -> Scene:
    return scene
