"""Each light level of a scene as a picture, to look at beside `raytwin needs`' numbers."""

from raytwin.analysis.recommend.search import DEEP
from raytwin.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.speed import trace, walk

WIDTH = 360
"""Pixels across, at most."""
SAMPLES, MORE = 64, 4
"""Samples per pixel where light is followed; the reference has MORE times as many."""
REFERENCE = "reference"


def level_pictures(scene: Scene, engine: str, depth: int | None = None) -> dict[str, Image]:
    """Return the tracer's image of each lit level, and of all light: `reference`, the last.

    `depth`: of the level `path`, by default its own.
    """
    w, h = scene.camera.image_size
    small = min(1.0, WIDTH / w)
    scene = scene.with_camera(scene.camera.resized(max(1, round(w * small)), max(1, round(h * small))))
    found = {}
    for name, row in RUNGS.items():
        if row.lit and not row.noisy:
            found[name] = trace(scene, name, engine)
        elif row.lit:
            deep = depth if row.depth != 2 else None
            found[name] = walk(scene, name, engine, samples=SAMPLES, depth=deep, surface=False)
    found[REFERENCE] = walk(scene, "path", engine, samples=MORE * SAMPLES, seed=1, depth=DEEP, surface=False)
    return found
