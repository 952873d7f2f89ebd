"""The subject, in its many ways: whole frames, several rays a pixel, guesses between rays; and the paper's loop."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from raytwin import twin
from raytwin.fast import ENGINES, background, draw, speculate, walk
from raytwin.images.image import Image, Surface
from raytwin.renderers.python_loop import loop
from raytwin.renderers.renderer import Call, Renderer
from raytwin.scene import Scene
from raytwin.tracer import STAGES, Stages


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
    """One ray through each pixel's centre.

    `in_place`: draw into a frame that is filled already, to time drawing into a photo. `surface`: also return what each
    ray met.
    """

    VARIED = "trim"
    trim: str = "conic"
    solver: str = "robust"
    in_place: bool = False
    surface: bool = False
    stages: Stages = STAGES

    @property
    def name(self) -> str:
        solver = "" if self.solver == "robust" else f"-{self.solver}"
        return f"{self.engine}-{self.rung}-{'inplace' if self.in_place else self.trim}{solver}"

    def prepare(self, scene: Scene) -> Call:
        self.ready()
        filled = background(scene, self.rung) if self.in_place else None

        def call(seed: int) -> Image:
            out = background(scene, self.rung) if filled is None else filled
            surface = Surface.empty(*scene.camera.image_size) if self.surface else None
            draw(scene, out, self.rung, self.engine, self.solver, self.trim, surface, self.stages)
            return Image(out, surface=surface)

        return call


@dataclass(frozen=True)
class PathTraced(_ByEngine):
    """Light followed from surface to surface by random walks, `samples` of them a pixel.

    `over`: the pixel's `area`, or its `center`. `surface`: also what the ray through the centre met. `depth`: the
    rung's own where not given.
    """

    VARIED = "samples"
    rung: str = "path"
    samples: int = 16
    over: str = "area"
    surface: bool = False
    depth: int | None = None
    noisy = True

    @property
    def name(self) -> str:
        rung = self.rung if self.depth is None else f"{self.rung}-depth{self.depth}"
        return f"{self.engine}-{rung}-{self.samples}{'' if self.over == 'area' else '-center'}"

    @property
    def sampling(self) -> str:
        return self.over

    def prepare(self, scene: Scene) -> Call:
        self.ready()
        return lambda seed: walk(
            scene, self.rung, self.engine, sampling=self.over, samples=self.samples, seed=seed, depth=self.depth,
            surface=self.surface,
        )  # fmt: skip


def fast_engine(variant: str | None) -> str:
    """The fastest row of ENGINES on a machine where Mitsuba's `variant` works."""
    return {"llvm_ad_rgb": "drjit32", "cuda_ad_rgb": "cuda32"}.get(variant or "", "numpy32")


@dataclass(frozen=True)
class Supersampled(_ByEngine):
    """The mean of `samples` rays on a regular grid within the pixel."""

    VARIED = "samples"
    samples: int = 4
    sampling = "area"

    @property
    def name(self) -> str:
        return f"{self.engine}-{self.rung}-{self.samples}spp"

    def prepare(self, scene: Scene) -> Call:
        self.ready()
        side = round(self.samples**0.5)
        steps = ((np.arange(side) + 0.5) / side - 0.5).tolist()
        moved = [scene.with_camera(scene.camera.grid(x, y)) for y in steps for x in steps]

        def call(seed: int) -> Image:
            total: Any = np.float32(0)
            for one in moved:
                out = background(one, self.rung)
                draw(one, out, self.rung, self.engine)
                total = total + out
            return Image(total / np.float32(len(moved)), samples=self.samples)

        return call


@dataclass(frozen=True)
class Speculated(_ByEngine):
    """Every n-th pixel traced and the others guessed, in a `way` of speculation's WAYS."""

    VARIED = "n"
    way: str = "careful"
    n: int = 8

    @property
    def name(self) -> str:
        return f"{self.engine}-{self.rung}-{self.way}{self.n}"

    @property
    def step(self) -> int:
        return self.n

    def prepare(self, scene: Scene) -> Call:
        self.ready()
        return lambda seed: Image(speculate(scene, self.n, self.rung, self.engine, self.way)[0])


@dataclass(frozen=True)
class SmoothedSpeculation(Speculated):
    """The paper's speculation, whose guesses are then smoothed by non-local means."""

    way: str = "paper"

    @property
    def name(self) -> str:
        return f"{super().name}-nlm"

    def prepare(self, scene: Scene) -> Call:
        from raytwin.photos.denoise import non_local_means  # with OpenCV

        guess = super().prepare(scene)
        return lambda seed: Image(non_local_means(guess(seed).mean))


@dataclass(frozen=True)
class PythonLoop(Renderer):
    """The paper's way: a Python loop over the pixels."""

    VARIED = "trim"
    trim: str = "none"
    library = "python"
    precision = 64

    @property
    def name(self) -> str:
        return f"loop-{self.rung}-{self.trim}"

    def prepare(self, scene: Scene) -> Call:
        return lambda seed: Image(loop(scene, self.rung, self.trim))


@dataclass(frozen=True)
class Filled(Renderer):
    """The frame filled with the sky: the least that any method can do."""

    name = "fill"

    def prepare(self, scene: Scene) -> Call:
        return lambda seed: Image(background(scene))
