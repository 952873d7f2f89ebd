"""What can be taken out of a scene: each part's name, and the scene without it."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from raytwin.scene import Scene, Sky
from raytwin.scene.scene import NO_SUN

Edit = Callable[[Scene], Scene]


def parts_of(scene: Scene) -> dict[str, Edit]:
    """Name -> what leaves the part out of this scene, in the order in which they can be left out together."""
    things = scene.objects
    labels = scene.names if len(set(scene.names)) == len(things) else scene.numbers
    found: dict[str, Edit] = {name: _with(thing) for name, thing in zip(labels, things, strict=True)}
    for name, thing in zip(labels, things, strict=True):
        if thing.specular is not UNSET:
            matt = msgspec.structs.replace(thing, specular=UNSET, exponent=UNSET)
            found[f"the highlight of {name}"] = _with(thing, matt)
    if any(scene.sun.irradiance):
        found["the sun"] = lambda scene: msgspec.structs.replace(scene, sun=NO_SUN)
    if scene.sky.texels is not UNSET:
        found["the sky's map"] = lambda scene: msgspec.structs.replace(scene, sky=Sky(mean_radiance(scene.sky)))
    if scene.sky.texels is not UNSET or any(scene.sky.radiance):
        found["the sky"] = lambda scene: msgspec.structs.replace(scene, sky=Sky())
    if any(scene.camera.dist):
        found["the lens's distortion"] = lambda scene: scene.with_camera(msgspec.structs.replace(scene.camera, dist=()))
    return found


def _with(thing: Any, *instead: Any) -> Edit:
    """Return what puts others in the place of a sphere or plane."""

    def edit(scene: Scene) -> Scene:
        spheres, planes = (
            tuple(new for t in kind for new in (instead if t is thing else (t,)))
            for kind in (scene.spheres, scene.planes)
        )
        return msgspec.structs.replace(scene, spheres=spheres, planes=planes, pyramids=())

    return edit


def mean_radiance(sky: Sky) -> tuple[float, float, float]:
    """The mean of a sky's map over all directions: its rows count by the solid angle that they see."""
    assert sky.environment is not None
    texels = sky.environment.radiance
    rows = np.sin((np.arange(len(texels)) + 0.5) / len(texels) * np.pi)
    r, g, b = np.average(texels.mean(axis=1), axis=0, weights=rows).tolist()
    return r, g, b
