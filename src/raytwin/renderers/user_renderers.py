"""Images that others make, by whatever function of a scene."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.image_input import as_image
from raytwin.renderers.renderer import Call, Renderer
from raytwin.renderers.scene_exchange import as_arrays, as_file
from raytwin.scene import MitsubaScene, Scene


@dataclass(frozen=True)
class UserRenderer(Renderer):
    """`render`, known as `title`, called with `tell(scene, rung)`; it returns radiance (H, W, 3), or an Image."""

    title: str = ""
    render: Callable[[dict[str, Any]], Any] | None = None
    tell: Callable[[Scene, str], dict[str, Any]] = as_arrays
    stages: Mapping[str, Callable[..., Any]] = field(default_factory=dict)
    """The functions of single stages that the same file has."""

    @property
    def name(self) -> str:
        return self.title

    @property
    def library(self) -> str:
        return "python"

    def prepare(self, scene: Scene | MitsubaScene) -> Call:
        width, height = scene.image_size

        def call(seed: int) -> Image:
            given = self.tell(scene, self.rung) if isinstance(scene, Scene) else as_file(scene)
            try:
                made = self.render(given) if self.render else None
                taken = made if isinstance(made, Image) else as_image(np.asarray(made)).image
            except InputError:
                raise
            except (Exception, SystemExit) as error:  # theirs, whatever it is: the program that runs it goes on
                raise InputError(self.name, "an image (H, W, 3)", f"{type(error).__name__}: {error}") from error
            if taken.mean.dtype.kind not in "fiu" or taken.shape != (height, width, 3):
                wanted = f"an image ({height}, {width}, 3)"
                raise InputError(self.name, wanted, f"{taken.mean.dtype} {taken.shape}")
            return taken if isinstance(made, Image) else Image(taken.mean.astype(np.float32))

        return call
