"""The same scene as Mitsuba renders it left to itself: a baseline of speed.

`render` takes care that noise and outlines are comparable: own rays, batches, a surface. `render_plain` takes none:
Mitsuba's sensor, film and integrator, its own shadow offset, nothing but the picture.
"""

from typing import Any

import numpy as np

from raytwin.scene import Scene
from raytwin.twin.backend import activate
from raytwin.twin.opencv_sensor import sensor_at
from raytwin.twin.twin_scene import load, place_of, translate

INTEGRATORS = {"direct": {"type": "direct"}, "path": {"type": "path", "max_depth": 8, "rr_depth": 8}}
"""name -> Mitsuba's: light that met one surface (the rung `sky`), and up to seven (the rung `path`)."""

LANES = 1 << 24
"""Most rays in one launch: Mitsuba keeps the state of every sample of a launch in memory."""


def load_plain(scene: Scene, integrator: str = "direct", variant: str | None = None) -> Any:
    """A Mitsuba scene with its own sensor, box filter and integrator, to hand to `render_plain`.

    The sensor is `perspective` where pixels are square and nothing is distorted; else one that undoes the distortion
    (about half as slow again).
    """
    activate(variant)
    place = place_of(scene)
    world: dict[str, Any] = translate(scene, place, {}) | {"integrator": INTEGRATORS[integrator]}
    world.get("sky", {}).pop("sampling_weight", None)
    world["sensor"] = sensor_at(scene.camera, np.asarray(scene.camera.R_cam_board), place.eye, place.unit)
    return load(world)


def render_plain(loaded: Any, samples: int = 1, seed: int | tuple[int, ...] = 0) -> np.ndarray:
    """`samples` a pixel by its own integrator and film: (H, W, channels) float64. The variant must be active."""
    import mitsuba as mi

    width, height = loaded.sensors()[0].film().crop_size()
    passes = -(-samples // max(1, LANES // (int(width) * int(height))))
    total: Any = 0.0
    for k in range(passes):
        part = samples // passes + (k < samples % passes)
        number = np.random.SeedSequence([*np.atleast_1d(seed).tolist(), k]).generate_state(1)[0]
        total = total + part * np.asarray(mi.render(loaded, spp=part, seed=int(number)), float)
    return np.asarray(total / samples)
