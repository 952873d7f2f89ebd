"""All light of a scene: the sun's two numbers, and the sky's three functions."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

from raytwin.scene import Environment, Scene, Sky
from raytwin.tracer.arrays import Vec
from raytwin.tracer.lights.constant_sky import constant_sky
from raytwin.tracer.lights.environment_map import environment_map


@runtime_checkable
class SkyLight(Protocol):
    """What is seen past every object. `sampled`: worth a ray of its own, since it is brighter in some directions."""

    @property
    def sampled(self) -> bool: ...
    def radiance(self, d: Vec) -> Vec: ...
    def diffuse_irradiance(self, normal: Vec) -> Vec: ...
    def sample(self, a: Any, b: Any) -> tuple[Vec, Any]: ...
    def density(self, d: Vec) -> Any: ...


class Lighting(NamedTuple):
    """`to_sun`: unit, in the rays' frame; `irradiance` E of the sun on a surface that faces it; the `sky`."""

    to_sun: Vec
    irradiance: Vec
    sky: SkyLight


SKIES: dict[type, Callable[[Any], SkyLight]] = {Sky: constant_sky, Environment: environment_map}
"""Record of the scene -> the light that rays meet."""


def lighting(scene: Scene) -> Lighting:
    sky = scene.environment or scene.sky
    return Lighting(scene.sun.to_light, scene.sun.irradiance, SKIES[type(sky)](sky))
