"""Guessing pixels between traced ones: the paper's way, and raytwin's careful one beside the error that it promises."""

import numpy as np

from raytwin.atlas.experiment import Error, Experiment
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.speed import speculate, trace
from raytwin.speed.speculation import interpolation_bound

TOLERANCE = 5e-4
"""What `speculate` promises unless told otherwise, in units of radiance."""

N, FOCAL, DISTANCE = 8, 400.0, 5.0
SUN = Sun((0.26, -0.43, -0.86))
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
FLOOR = Rectangle((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 3.0, 0.0))


def seen(*things: Sphere | Rectangle, size: tuple[int, int] = (160, 120)) -> Scene:
    """By a camera that looks straight at the origin's plane, where a pixel is DISTANCE / FOCAL m wide."""
    K = ((FOCAL, 0.0, (size[0] - 1) / 2), (0.0, FOCAL, (size[1] - 1) / 2), (0.0, 0.0, 1.0))
    camera = Camera(size, K, AXES, (0.0, 0.0, DISTANCE))
    return Scene("guess", camera, things, (SUN, Sky((0.2, 0.2, 0.2))))


def worst(scene: Scene, n: int, rung: str = "shadow", where: np.ndarray | None = None) -> dict[str, Error]:
    """The largest error of a pixel, by way of guessing; `where` (H, W): of these pixels."""
    truth = trace(scene, rung, "numpy64").mean
    found: dict[str, Error] = {}
    for way in ("paper", "careful"):
        error = np.abs(speculate(scene, n, rung, "numpy64", way, TOLERANCE)[0] - truth).max(axis=-1)
        found[f"{way}{': raytwin' * (way == 'careful')}"] = float((error if where is None else error[where]).max())
    return found


def over(scenes: list[Scene]) -> dict[str, Error]:
    rows = [worst(scene, N) for scene in scenes]
    return {way: max(row[way] or 0.0 for row in rows) for way in rows[0]}


def places(rng: np.random.Generator, n: int) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in rng.uniform((-0.8, -0.6), (0.8, 0.6), (n, 2))]


def small(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """A sphere x pixels in radius before a floor, and its shadow."""
    radius = x * DISTANCE / FOCAL
    return over([seen(FLOOR, Sphere((a, b, -radius), radius)) for a, b in places(rng, n)])


def unseen(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The shadow of a sphere x pixels in radius which itself stands outside the picture."""
    radius, up = x * DISTANCE / FOCAL, 4.5 * np.array(SUN.to_light)
    return over([seen(FLOOR, Sphere((a + up[0], b + up[1], up[2]), radius)) for a, b in places(rng, n)])


RADIUS_PX, RIM = 90.0, 0.8


def curved(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Blocks of x pixels on a sphere of 90 pixels, a block's width within 0.8 of its radius."""
    radius = RADIUS_PX * DISTANCE / FOCAL
    scene = seen(Sphere((0.0, 0.0, radius / 50), radius), size=(257, 257))
    v, u = np.mgrid[:257, :257] - 128
    inside = np.hypot(u, v) < RIM * RADIUS_PX - x
    return worst(scene, round(x), "lambert", inside)


BOUND = "Taylor: |f − bilinear| ≤ (|f_uu| + |f_vv|) h² / 8; the paper's speculation, its figure 12"

EXPERIMENTS = (
    Experiment(
        "guess-curved", "Guessing the shading of a sphere", "pixels between traced ones", "largest error of radiance",
        TOLERANCE, (2.0, 4.0, 8.0, 16.0, 32.0), curved, ("careful: raytwin",),
        "Between traced pixels the shading is taken for straight, and it curves: the error is a quarter of what it was "
        "at half the step. Careful guessing measures the curvature and traces the block where it is too much.",
        BOUND, {"paper": lambda x: interpolation_bound(2.4 / np.pi, x, RADIUS_PX, RIM) / 2}, slack=1.9, trials=1,
        many=1,
    ),
    Experiment(
        "guess-small", "Guessing where a small sphere stands on a floor", "radius, pixels", "largest error of radiance",
        TOLERANCE, (48.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.5), small, ("careful: raytwin",),
        "Guessing across an edge is wrong by the whole step, at any size; and a sphere smaller than the step may be "
        "missed by every traced pixel. The careful way asks which objects, and whose shadows, are narrower than two "
        "blocks, and traces these whole.",
        BOUND, {"paper": lambda x: 0.3}, trials=3, many=64,
    ),
    Experiment(
        "guess-shadow", "Guessing where only a shadow falls", "radius of the shadow, pixels",
        "largest error of radiance",
        TOLERANCE, (48.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0, 0.6), unseen, ("careful: raytwin",),
        "The object stands outside the picture, so that nothing but its shadow tells of it, and a shadow smaller than "
        "the step may lie between all traced pixels. This lost whole shadows here, until casters were looked at too.",
        BOUND, {"paper": lambda x: 0.3}, trials=3, many=64,
    ),
)  # fmt: skip
