"""The twin, and Mitsuba left to itself."""

from dataclasses import dataclass

import numpy as np

from raytwin import twin
from raytwin.images.image import Image
from raytwin.renderers.renderer import Call, Renderer
from raytwin.rungs import RUNGS
from raytwin.scene import MitsubaScene, Scene
from raytwin.scene.lens import without_ray

SHORT_VARIANTS = {"llvm_ad_rgb": "llvm", "cuda_ad_rgb": "cuda"}
"""Mitsuba's variants as names have them."""


@dataclass(frozen=True)
class _ByVariant(Renderer):
    """`variant`: of Mitsuba, None for what works best here; `samples`: of each pixel."""

    VARIED = "samples"
    variant: str | None = None
    samples: int = 1

    @property
    def short(self) -> str:
        return SHORT_VARIANTS[self.library]

    @property
    def integrator(self) -> str:
        """Mitsuba's, for a rung that it follows light on."""
        return "direct" if RUNGS[self.rung].depth == 2 else "path"

    @property
    def library(self) -> str:
        return self.variant or str(twin.activate().variant)


@dataclass(frozen=True)
class Twin(_ByVariant):
    """As `raytwin compare` renders it."""

    @property
    def name(self) -> str:
        tail = f"{self.integrator}-{self.samples}" if self.noisy else self.rung
        return f"twin-{self.short}-{tail}"

    @property
    def sampling(self) -> str:
        return "area" if self.noisy else "center"

    @property
    def noisy(self) -> bool:
        return RUNGS[self.rung].noisy

    def prepare(self, scene: Scene | MitsubaScene) -> Call:
        twin.activate(self.variant)
        if isinstance(scene, MitsubaScene):  # its own integrator decides the light
            file = scene
            return lambda seed: twin.render_mitsuba(file, self.samples, seed, cache=False, variant=self.variant)
        return lambda seed: twin.render(
            scene, self.rung, sampling=self.sampling, samples=self.samples, seed=seed, cache=False, variant=self.variant
        )


@dataclass(frozen=True)
class Plain(_ByVariant):
    """Mitsuba's own sensor, film and integrator; loading its scene is not timed, which flatters it."""

    sampling, noisy = "area", True

    @property
    def name(self) -> str:
        return f"mitsuba-{self.short}-{self.integrator}-{self.samples}"

    def prepare(self, scene: Scene) -> Call:
        loaded = twin.load_plain(scene, self.integrator, self.variant)

        def call(seed: int) -> Image:
            twin.activate(self.variant)
            image = Image(twin.render_plain(loaded, self.samples, seed).astype(np.float32), samples=self.samples)
            return image.blacken(without_ray(scene.camera))

        return call
