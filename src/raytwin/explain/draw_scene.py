"""Scenes that nobody has seen: an arrangement of arrangements.json whose parts, colours and lens are drawn from a seed.

No mistake can hide in an arrangement, however its parts are drawn: R is not symmetric, spheres and planes shade each
other and themselves, some values exceed 1, something is hidden, a plane is seen from behind, things are behind the eye
and far around, where rays of a wrong camera go.
"""

from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace

from raytwin.scene import Rectangle, Scene, Sky, Sphere, Sun

DRAWN_SIZE = (120, 88)
"""Pixels."""
LARGER = 6.0
"""So many times larger some scenes are drawn, so that code that takes a length for 1 is caught."""
MOVED_METRES = 0.002
"""Metres by which parts of an arrangement are moved, at most, along each axis."""
SMALLEST_FACTOR = 0.95
"""Least factor of a part's size: no two parts touch."""
ARRANGEMENTS = msgspec.json.decode(Path(__file__).with_name("arrangements.json").read_bytes(), type=tuple[Scene, ...])


def draw_scene(seed: int, size: tuple[int, int] = DRAWN_SIZE, name: str = "", scale: float = 1) -> Scene:
    """Spheres on and above a floor, panels seen from both sides, things behind the eye, a lens with all coefficients.

    Sun and sky have colours. `scale`: all lengths are so many times as long, with the same picture: a length that is
    taken for 1 shows.
    """
    rng = np.random.default_rng([seed, 7])
    scene = ARRANGEMENTS[rng.integers(len(ARRANGEMENTS))]

    def moved(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return _three(scale * (v + rng.uniform(-MOVED_METRES, MOVED_METRES, 3)))

    def resized(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return _three(scale * rng.uniform(SMALLEST_FACTOR, 1) * np.array(v))

    balls: list[Sphere] = []
    flats: list[Rectangle] = []
    for ball in scene.spheres:
        center, albedo = moved(ball.center), _colour(rng, 0.3, 0.95)
        balls.append(Sphere(center, scale * ball.radius * rng.uniform(SMALLEST_FACTOR, 1), albedo))
    for flat in scene.planes:
        center, albedo = moved(flat.center), _colour(rng, 0.3, 0.95)
        flats.append(Rectangle(center, resized(flat.half_u), resized(flat.half_v), albedo))
    lens = tuple((rng.uniform(0.7, 1.3, 5) * [-0.2, 0.07, 0.008, -0.006, 0.05]).tolist())
    camera = replace(scene.camera, dist=lens, t_cam_board=moved(scene.camera.t_cam_board)).resized(*size)
    sun, sky = Sun(scene.sun.to_light, _colour(rng, 4.5, 7.5)), Sky(_colour(rng, 0.08, 0.3))
    return Scene(name or f"drawn-{seed}", camera, tuple(balls), tuple(flats), sun, sky)


def _colour(rng: np.random.Generator, low: float, high: float) -> tuple[float, float, float]:
    """Three values that differ by a fifth of the range at least."""
    return _three(low + (high - low) * rng.permutation(np.array([0.0, 0.4, 0.8]) + rng.uniform(0, 0.2, 3)))


def _three(v: np.ndarray) -> tuple[float, float, float]:
    x, y, z = v.tolist()
    return (x, y, z)
