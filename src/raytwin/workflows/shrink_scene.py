"""What can be taken out of a scene of raytwin's own: parts that are there or not, smaller pictures, rounder numbers."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from raytwin.errors import InputError
from raytwin.files import check_camera, check_contents, write_scene
from raytwin.rungs import RUNGS
from raytwin.scene import Scene, SceneFile, WrittenPlane, WrittenSky, WrittenSphere, WrittenSun

LENS = "k1", "k2", "p1", "p2", "k3"
Field = tuple[str, int, str]
"""A part of the written scene, which one of its kind, and the name of the number."""


@dataclass(frozen=True)
class OwnScene:
    """A scene of raytwin's own on its way down, and the light level that both sides render."""

    written: SceneFile
    rung: str
    labels: tuple[str, ...] = ()
    """The objects' names in the whole scene, spheres first: they stay as others go."""

    @classmethod
    def begin(cls, written: SceneFile, rung: str) -> "OwnScene":
        scene = written.scene
        return cls(written, rung, scene.names if len(set(scene.names)) == len(scene.names) else scene.numbers)

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

    def fields(self) -> list[Field]:
        """All numbers but the camera's rotation."""
        scene = self.written
        found = [
            (kind, i, name)
            for kind, things in (("spheres", scene.spheres), ("planes", scene.planes))
            for i, thing in enumerate(things)
            for name in thing.__struct_fields__
            if isinstance(value := getattr(thing, name), float | tuple) and value
        ]
        found += [("sun", 0, name) for name in ("to_light", "irradiance") if any(scene.sun.irradiance)]
        if scene.sky.texels is UNSET:
            found.append(("sky", 0, "radiance"))
        return found + [("camera", 0, name) for name in ("K", "t_cam_board", "dist")]

    def rounded(self, fields: list[Field], digits: int) -> "OwnScene":
        """The scene with these numbers to so many digits; itself where they make none that can be."""
        scene = self.written
        for part, i, name in fields:
            old = getattr(scene, part)
            thing = old[i] if isinstance(old, tuple) else old
            new = msgspec.structs.replace(thing, **{name: _round(getattr(thing, name), digits)})
            if isinstance(old, tuple):
                new = (*old[:i], new, *old[i + 1 :])
            scene = msgspec.structs.replace(scene, **{part: new})
        try:
            check_contents(scene, "")
            check_camera(scene.scene.camera, "")
            msgspec.convert(msgspec.to_builtins(scene), SceneFile)  # radii above 0, albedos up to 1
        except (InputError, msgspec.ValidationError):
            return self
        return replace(self, written=scene)

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


def _round(value: Any, digits: int) -> Any:
    """To so many significant digits of the largest number of a vector, so that a tiny component becomes 0."""
    if isinstance(value, tuple):
        if value and isinstance(value[0], tuple):
            return tuple(_round(row, digits + 1) if any(row[:2]) else row for row in value)  # K: px, which count
        largest = max((abs(v) for v in value), default=0.0)
        return tuple(_to(v, largest, digits) for v in value)
    return _to(value, abs(value), digits)


def _to(value: float, largest: float, digits: int) -> float:
    if not largest:
        return value
    return round(value, digits - 1 - math.floor(math.log10(largest))) + 0.0
