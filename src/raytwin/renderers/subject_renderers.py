"""raytwin's own tracer, in several ways: whole frames, several rays per pixel, pixels interpolated between rays."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytwin import twin
from raytwin.fast import ENGINES, background, draw, speculate, walk
from raytwin.images.image import Image, Surface
from raytwin.renderers.renderer import Call, Renderer
from raytwin.scene import Scene


@dataclass(frozen=True)
class _ByEngine(Renderer):
    """`engine`: a row of ENGINES."""

    engine: str = "numpy64"
    trim = "conic"

    @property
    def library(self) -> str:
        return ENGINES[self.engine].title

    @property
    def precision(self) -> int:
        return ENGINES[self.engine].bits

    def ready(self) -> None:
        """Tell Dr.Jit which libLLVM to load: it asks but once."""
        if not ENGINES[self.engine].is_numpy:
            twin.activate()


@dataclass(frozen=True)
class Traced(_ByEngine):
    """One ray through each pixel's centre, or the mean of `samples` rays on a regular grid within the pixel.

    `surface`: also return what the one ray met.
    """

    trim: str = "conic"
    solver: str = "robust"
    surface: bool = False
    samples: int = 1

    @property
    def name(self) -> str:
        if self.samples > 1:
            return f"{self.engine}-{self.rung}-{self.samples}spp"
        solver = "" if self.solver == "robust" else f"-{self.solver}"
        return f"{self.engine}-{self.rung}-{self.trim}{solver}"

    @property
    def sampling(self) -> str:
        return "center" if self.samples == 1 else "area"

    def prepare(self, scene: Scene) -> Call:
        self.ready()
        side = round(self.samples**0.5)
        steps = ((np.arange(side) + 0.5) / side - 0.5).tolist()
        moved = [scene.with_camera(scene.camera.grid(x, y)) for y in steps for x in steps]

        def drawn(one: Scene, surface: Surface | None = None) -> Any:
            out = background(one, self.rung)
            draw(one, out, self.rung, self.engine, self.solver, self.trim, surface)
            return out

        def call(seed: int) -> Image:
            if self.samples > 1:
                total: Any = sum(map(drawn, moved), np.float32(0))
                return Image(total / np.float32(len(moved)), samples=self.samples)
            surface = Surface.empty(*scene.camera.image_size) if self.surface else None
            return Image(drawn(scene, surface), surface=surface)

        return call


@dataclass(frozen=True)
class PathTraced(_ByEngine):
    """Light followed from surface to surface by random walks, `samples` of them per pixel.

    `sampling`: over the pixel's `area`, or its `center`. `surface`: also what the ray through the centre met. `depth`:
    the rung's own where not given.
    """

    rung: str = "path"
    samples: int = 16
    sampling: str = "area"
    surface: bool = False
    depth: int | None = None
    noisy = True

    @property
    def name(self) -> str:
        rung = self.rung if self.depth is None else f"{self.rung}-depth{self.depth}"
        return f"{self.engine}-{rung}-{self.samples}{'' if self.sampling == 'area' else '-center'}"

    def prepare(self, scene: Scene) -> Call:
        self.ready()
        return lambda seed: walk(
            scene, self.rung, self.engine, sampling=self.sampling, samples=self.samples, seed=seed, depth=self.depth,
            surface=self.surface,
        )  # fmt: skip


def fast_engine(variant: str | None) -> str:
    """The fastest row of ENGINES on a machine where Mitsuba's `variant` works."""
    return {"llvm_ad_rgb": "drjit32", "cuda_ad_rgb": "cuda32"}.get(variant or "", "numpy32")


@dataclass(frozen=True)
class Speculated(_ByEngine):
    """Every `step`-th pixel traced and the others interpolated, in a `way` of speculation's WAYS.

    `smoothed`: the whole picture by non-local means, as the paper does it.
    """

    way: str = "careful"
    step: int = 8
    smoothed: bool = False

    @property
    def name(self) -> str:
        return f"{self.engine}-{self.rung}-{self.way}{self.step}" + ("-nlm" if self.smoothed else "")

    def prepare(self, scene: Scene) -> Call:
        self.ready()

        def call(seed: int) -> Image:
            guess = speculate(scene, self.step, self.rung, self.engine, self.way)[0]
            if self.smoothed:
                from raytwin.photos.denoise import non_local_means  # with OpenCV

                guess = non_local_means(guess)
            return Image(guess)

        return call


@dataclass(frozen=True)
class Filled(Renderer):
    """The frame filled with the sky: the least that any method can do."""

    name = "fill"

    def prepare(self, scene: Scene) -> Call:
        return lambda seed: Image(background(scene))
