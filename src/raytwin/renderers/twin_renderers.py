"""The twin as a renderer with a name."""

from dataclasses import dataclass

from raytwin import twin
from raytwin.renderers.renderer import Call, Renderer
from raytwin.rungs import RUNGS
from raytwin.scene import MitsubaScene, Scene


@dataclass(frozen=True)
class Twin(Renderer):
    """As `raytwin compare` renders it. `variant`: Mitsuba's, None for the one that works here; `samples` per pixel."""

    variant: str | None = None
    samples: int = 1

    @property
    def name(self) -> str:
        integrator = "direct" if RUNGS[self.rung].depth == 2 else "path"
        tail = f"{integrator}-{self.samples}" if self.noisy else self.rung
        return f"twin-{self.library.partition('_')[0]}-{tail}"

    @property
    def library(self) -> str:
        return self.variant or str(twin.activate().variant)

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
