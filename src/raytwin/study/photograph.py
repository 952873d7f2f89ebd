"""A board -> photos of it that exist only in Mitsuba, and the truth beside them."""

from pathlib import Path

import msgspec
import numpy as np

from raytwin import twin
from raytwin.photos import boards, synthetic_photos
from raytwin.progress import Progress, silent
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sun
from raytwin.scene.scene_files import scene_and_photos

WOOD = 0.36, 0.25, 0.17
TABLE = Rectangle((0.0, 0.0, -0.002), (1.5, 0.0, 0.0), (0.0, 1.5, 0.0), WOOD, in_photo=True)
SUN = Sun((0.45, 0.35, 0.85), (2.3, 2.2, 2.05))
SKY = Sky((0.22, 0.24, 0.27))
"""What `photograph_board` uses where no scene is given: white paper comes out a little below white."""
FOCAL, DIST = 1560 / 2016, (0.08, -0.16)
"""Focal length in widths of the photo, and k1, k2: those of a phone."""


def photograph_board(
    board: str | Path,
    out: str | Path,
    *,
    scene: str | Path | None = None,
    count: int = 14,
    size: tuple[int, int] = (2016, 1512),
    samples: int = 32,
    seed: int = 1,
    with_objects: bool = False,
    progress: Progress = silent,
) -> synthetic_photos.Truth:
    """`count` photos of the board on its table, and the truth (camera.toml's K, dist and every pose), written to `out`.

    Sun, sky and table (the planes below the board) come from `scene`, by default a plain desk. `size` changes the
    pixels and not the view. The lens is centred a little off, as real ones are. `with_objects` puts the
    scene's spheres really there: the same seed gives the same poses and the same sensor noise, so that such photos are
    the truth for augmented ones.
    """
    definition = boards.read_board(board)
    width, height = size
    focal = FOCAL * width
    K = ((focal, 0.0, 0.504 * width), (0.0, 1.001 * focal, 0.497 * height), (0.0, 0.0, 1.0))
    lens = Camera(size, K, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)), (0.0, 0.0, 1.0), DIST)
    stage = scene_and_photos(scene)[0] if scene is not None else Scene("desk", lens, (), (TABLE,), SUN, SKY)
    table = tuple(p for p in stage.planes if p.center[2] < 0)
    spheres = stage.spheres if with_objects else ()
    twin.activate()

    def render(view: Camera, texture: np.ndarray, sheet: Rectangle) -> np.ndarray:
        set_up = msgspec.structs.replace(stage, camera=view, spheres=spheres, planes=(sheet, *table))
        textures = {len(spheres): texture}
        made = twin.render(
            set_up, "path", sampling="area", samples=samples, seed=seed, textures=textures, cache=False
        )  # fmt: skip
        return made.mean

    return synthetic_photos.photograph(definition, lens, count, Path(out), render, seed=seed, progress=progress)
