"""What can be taken out of a scene of raytwin's own: parts that are there or not, most of the picture, bounces."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from raytwin.files import write_scene
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, SceneFile, WrittenPlane, WrittenSky, WrittenSphere, WrittenSun

LENS = "k1", "k2", "p1", "p2", "k3"


@dataclass(frozen=True)
class OwnScene:
    """A scene of raytwin's own on its way down, and the light level that both sides render."""

    written: SceneFile
    rung: str
    labels: tuple[str, ...] = ()
    """The objects' names in the whole scene, spheres first: they stay as others go."""

    file_name = "scene.toml"

    @classmethod
    def begin(cls, written: SceneFile, rung: str) -> "OwnScene":
        scene = written.scene
        return cls(written, rung, scene.names if len(set(scene.names)) == len(scene.names) else scene.numbers)

    @property
    def name(self) -> str:
        return self.written.name

    @property
    def key(self) -> bytes:
        """What tells it from other scenes."""
        return msgspec.json.encode((self.written, self.rung))

    def placed(self, folder: Path) -> Scene:
        """The scene as renderers take it; nothing need lie in `folder`."""
        return self.written.scene

    @property
    def image_size(self) -> tuple[int, int]:
        return self.written.scene.camera.image_size

    @property
    def count(self) -> int:
        """Objects."""
        return len(self.written.spheres) + len(self.written.planes)

    def parts(self) -> list[str]:
        """Everything that might be left out."""
        scene, sky = self.written, self.written.sky
        things: zip[tuple[str, Any]] = zip(self.labels, (*scene.spheres, *scene.planes), strict=True)
        found = [*self.labels, *(f"the highlight of {name}" for name, thing in things if thing.specular is not UNSET)]
        found += ["the sun"] if any(scene.sun.irradiance) else []
        if sky.texels is not UNSET:
            found += ["the sky", "the sky's map"]
        elif any(sky.radiance):
            found += ["the sky"]
        return found + [f"the lens's {name}" for name, k in zip(LENS, self._dist(), strict=False) if k]

    def only(self, kept: list[str]) -> "OwnScene":
        """The scene with these parts alone: an even sky for a map that goes, matt for a highlight."""
        scene, keep = self.written, set(kept)
        pairs: list[tuple[str, Any]] = list(zip(self.labels, (*scene.spheres, *scene.planes), strict=True))
        left = [(name, _matt(thing, f"the highlight of {name}" in keep)) for name, thing in pairs if name in keep]
        sun, sky = scene.sun, scene.sky
        if "the sun" not in keep:
            sun = WrittenSun((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        if "the sky" not in keep:
            sky = WrittenSky()
        elif sky.texels is not UNSET and "the sky's map" not in keep:
            sky = WrittenSky(_mean_radiance(sky))
        dist = tuple(k if f"the lens's {name}" in keep else 0.0 for name, k in zip(LENS, self._dist(), strict=False))
        while dist and not dist[-1]:
            dist = dist[:-1]
        made = msgspec.structs.replace(
            scene,
            spheres=tuple(thing for _, thing in left if isinstance(thing, WrittenSphere)),
            planes=tuple(thing for _, thing in left if isinstance(thing, WrittenPlane)),
            sun=sun,
            sky=sky,
            pyramids=(),
            camera=msgspec.structs.replace(scene.scene.camera, dist=dist),
        )
        return OwnScene(made, self.rung, tuple(name for name, _ in left))

    def resized(self, width: int, height: int) -> "OwnScene":
        return replace(self, written=self.written.with_camera(self.written.scene.camera.resized(width, height)))

    def cropped(self, x: int, y: int, width: int, height: int) -> "OwnScene":
        camera = self.written.scene.camera.grid(x, y, size=(width, height))
        return replace(self, written=self.written.with_camera(camera))

    def fewer_bounces(self) -> Iterator[tuple[str, "OwnScene"]]:
        """The levels of light below its own, the lowest first."""
        rungs = list(RUNGS)
        for rung in rungs[1 : rungs.index(self.rung)]:
            yield f"every light level above {rung}", replace(self, rung=rung)

    def write(self, folder: Path, comment: str) -> Path:
        """Write scene.toml, and the map where there still is one."""
        return write_scene(folder / "scene.toml", self.written, comment)

    def _dist(self) -> tuple[float, ...]:
        return self.written.scene.camera.dist


def _matt(thing: Any, stays: bool) -> Any:
    return thing if stays else msgspec.structs.replace(thing, specular=UNSET, exponent=UNSET)


def _mean_radiance(sky: WrittenSky) -> tuple[float, float, float]:
    """The mean over all directions: rows of a map count by the solid angle that they see."""
    light = sky.light
    texels = light.radiance
    assert isinstance(texels, np.ndarray)  # a map's, not a constant sky's
    weight = np.sin((np.arange(texels.shape[0]) + 0.5) / texels.shape[0] * np.pi)
    r, g, b = ((texels * weight[:, None, None]).sum(axis=(0, 1)) / (weight.sum() * texels.shape[1])).tolist()
    return r, g, b
