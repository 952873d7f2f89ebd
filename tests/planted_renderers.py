"""Renderers with one mistake each: the correct tracer of a scene that is slightly another, or of a spoiled picture."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np
from scene_of import changed

from raytwin.fast import trace
from raytwin.images.image import Image
from raytwin.renderers.renderer import Call, Renderer
from raytwin.scene import Rectangle, Scene, Sky, Sphere, Sun

Fault = Callable[[Scene, str], Image]


@dataclass(frozen=True)
class Planted(Renderer):
    """A renderer with the mistake `title`; it counts its renders."""

    title: str = ""
    calls: list[int] = field(default_factory=list, compare=False)

    @property
    def name(self) -> str:
        return self.title

    def prepare(self, scene: Scene) -> Call:
        def call(seed: int) -> Image:
            self.calls.append(seed)
            return replace(FAULTS[self.title](scene, self.rung), surface=None)

        return call


def objects(change: Callable[[Any], Any]) -> Fault:
    def render(scene: Scene, rung: str) -> Image:
        return trace(changed(scene, objects=tuple(map(change, scene.objects))), rung)

    return render


def light(kind: type, change: Callable[[Any], Any]) -> Fault:
    def render(scene: Scene, rung: str) -> Image:
        lights = tuple(change(one) if isinstance(one, kind) else one for one in (scene.sun, scene.sky))
        return trace(changed(scene, lights=lights), rung)

    return render


def camera(change: Callable[[Any], Any]) -> Fault:
    return lambda scene, rung: trace(scene.with_camera(change(scene.camera)), rung)


def picture(change: Callable[[np.ndarray], np.ndarray]) -> Fault:
    return lambda scene, rung: Image(change(trace(scene, rung).mean).astype(np.float32))


def only(kind: type, **changes: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def change(thing: Any) -> Any:
        if not isinstance(thing, kind):
            return thing
        return msgspec.structs.replace(thing, **{name: make(getattr(thing, name)) for name, make in changes.items()})

    return change


def material(change: Callable[[tuple], tuple]) -> Callable[[Any], Any]:
    return lambda thing: msgspec.structs.replace(thing, albedo=change(thing.albedo))


def scaled(factor: float) -> Callable[[Any], Any]:
    return lambda value: tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value


def without(kind: type) -> Fault:
    def render(scene: Scene, rung: str) -> Image:
        left = tuple(thing for thing in scene.objects if not isinstance(thing, kind))
        return trace(changed(scene, objects=left), rung)

    return render


def first_last(scene: Scene, rung: str) -> Image:
    """The first object is drawn over all others."""
    whole, alone = trace(scene, rung), trace(changed(scene, objects=scene.objects[:1]), rung)
    assert alone.surface is not None
    return Image(np.where(alone.surface.mask[..., None], alone.mean, whole.mean))


def missed(scene: Scene, rung: str) -> Image:
    """NaN where nothing is met."""
    image = trace(scene, rung)
    assert image.surface is not None
    return Image(np.where(image.surface.mask[..., None], image.mean, np.float32(np.nan)))


def crash(scene: Scene, rung: str) -> Image:
    from raytwin.errors import InputError

    if len(scene.spheres) > 1:
        raise InputError("tracer", "an image", f"IndexError: sphere {len(scene.spheres)}")
    return trace(scene, rung)


FAULTS: dict[str, Fault] = {
    "small spheres": objects(only(Sphere, radius=scaled(0.95))),
    "large spheres": objects(only(Sphere, radius=scaled(1.02))),
    "spheres too high": objects(only(Sphere, center=lambda c: (c[0], c[1], c[2] + 0.01))),
    "planes too low": objects(only(Rectangle, center=lambda c: (c[0], c[1], c[2] - 0.01))),
    "planes too wide": objects(only(Rectangle, half_u=scaled(1.1))),
    "one sphere forgotten": lambda scene, rung: trace(changed(scene, objects=scene.objects[1:]), rung),
    "no planes": without(Rectangle),
    "red and blue exchanged": objects(material(lambda a: a[::-1])),
    "albedo squared": objects(material(lambda a: tuple(v * v for v in a))),
    "half a pixel": camera(lambda c: c.grid(0.5, 0.5)),
    "no distortion": camera(lambda c: msgspec.structs.replace(c, dist=())),
    "mirrored": picture(lambda x: x[:, ::-1]),
    "upside down": picture(lambda x: x[::-1]),
    "gamma": picture(lambda x: np.maximum(x, 0) ** (1 / 2.2)),
    "twice as bright": picture(lambda x: 2 * x),
    "clipped": picture(lambda x: np.minimum(x, 0.1)),
    "offset": picture(lambda x: x + 0.02),
    "bottom row black": picture(lambda x: np.concatenate([x[:-1], 0 * x[-1:]])),
    "not a number": missed,
    "first over all": first_last,
    "crash with two spheres": crash,
    "no shadows": lambda scene, rung: trace(scene, "lambert"),
    "sun from below": light(Sun, lambda s: Sun((s.to_light[0], s.to_light[1], -s.to_light[2]), s.irradiance)),
    "sun in grey": light(Sun, lambda s: Sun(s.to_light, (s.irradiance[0],) * 3)),
    "no sky": light(Sky, lambda s: Sky()),
    "sky twice": light(Sky, lambda s: Sky(tuple(2 * v for v in s.radiance))),
}
