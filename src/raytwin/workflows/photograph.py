"""A board -> photos of it that exist only in Mitsuba, and the truth beside them."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from raytwin import files, twin
from raytwin.calib import boards, synthetic_photos
from raytwin.progress import Progress, silent
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun

WOOD = Lambert((0.36, 0.25, 0.17))
TABLE = Rectangle((0.0, 0.0, -0.002), (1.5, 0.0, 0.0), (0.0, 1.5, 0.0), WOOD, in_photo=True)
SUN = Sun((0.45, 0.35, 0.85), (2.3, 2.2, 2.05))
SKY = Sky((0.22, 0.24, 0.27))
"""What `photograph_board` uses where no scene is given: white paper comes out a little below white."""


def photograph_board(
    board: str | Path,
    out: str | Path,
    *,
    scene: str | Path | None = None,
    count: int = 14,
    size: tuple[int, int] = (2016, 1512),
    focal: float = 1560.0,
    dist: tuple[float, ...] = (0.08, -0.16),
    samples: int = 32,
    seed: int = 1,
    with_objects: bool = False,
    bend: float = 0.0,
    mirror: Sphere | None = None,
    ball: Sphere | None = None,
    stand: tuple[float, float, float] | None = None,
    exposures: Sequence[float] = (1.0,),
    progress: Progress = silent,
) -> synthetic_photos.Truth:
    """`count` photos of the board on its table, and the truth (camera.toml's K, dist and every pose), written to `out`.

    Sun, sky and table (the planes below the board) come from `scene`, by default a plain desk. `focal` is in pixels of
    a photo 2016 wide, so that another size changes the pixels and not the view. The lens is centred a little off, as
    real ones are. `with_objects` puts the scene's spheres really there: the same seed gives the same poses and the same
    sensor noise, so that such photos are the truth for augmented ones. `bend`: the sheet is bent
    by so many metres.

    `mirror` (its albedo is the reflectance), `ball` and `stand` (x, y of its foot, and height) stand beside the board:
    what `raytwin light` measures by. The light that the mirror throws on what surrounds it is left out. `exposures`: by
    turns, the photos' linear value of radiance 1.
    """
    definition = boards.read_board(board)
    width, height = size
    scale = width / 2016
    K = ((focal * scale, 0.0, 0.504 * width), (0.0, 1.001 * focal * scale, 0.497 * height), (0.0, 0.0, 1.0))
    lens = Camera(size, K, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)), (0.0, 0.0, 1.0), dist)
    files.check_camera(lens, "--focal, --size: ")
    stage = files.read_scene(scene).at(lens) if scene is not None else Scene("desk", lens, (TABLE,), (SUN, SKY))
    table = tuple(p for p in stage.rectangles if p.center[2] < 0)
    upright = stand_planes(*stand) if stand is not None else ()
    twin.activate()

    def render(view: Camera, texture: np.ndarray, sheet: Rectangle) -> np.ndarray:
        spheres = (*((mirror,) if mirror else ()), *((ball,) if ball else ()), *(stage.spheres if with_objects else ()))
        set_up = msgspec.structs.replace(stage, camera=view, objects=(*spheres, sheet, *table, *upright))
        made = twin.render(
            set_up, "path", sampling="area", samples=samples, seed=seed, textures={len(spheres): texture},
            mirrors=(0,) if mirror else (), cache=False,
        )  # fmt: skip
        glint = synthetic_photos.sun_glint(view, mirror, stage.sun) if mirror and any(stage.sun.irradiance) else 0
        return made.mean + glint

    beside = [thing for thing in (mirror, ball) if thing is not None]
    if stand is not None:
        beside.append(Sphere((stand[0], stand[1], stand[2] / 2), stand[2] / 2))
    return synthetic_photos.photograph(
        definition, lens, count, Path(out), render, seed=seed, bend=bend, beside=beside, exposures=exposures,
        progress=progress,
    )  # fmt: skip


STAND_SHARE = 0.05
"""The stand's thickness, as a share of its height."""


def stand_planes(x: float, y: float, height: float) -> tuple[Rectangle, ...]:
    """A square post: four sides and a top."""
    a, grey = STAND_SHARE * height / 2, Lambert((0.3, 0.3, 0.3))
    up = (0.0, 0.0, height / 2)
    sides = [((x + a * i, y + a * j, height / 2), (a * j, -a * i, 0.0)) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    top = Rectangle((x, y, height), (a, 0.0, 0.0), (0.0, a, 0.0), grey)
    return (*(Rectangle(middle, along, up, grey) for middle, along in sides), top)
