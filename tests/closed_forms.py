"""Scenes whose light is known in closed form, each seen where all pixels of a small picture show the same radiance.

Under a sky of radiance 1 an element of albedo a shows a (1 - F) at depth 2, F being the share of its sky, weighed by
the cosine, that another surface hides. The tracer is tested on every row, the twin on every second one.
"""

from math import cos, hypot, pi, radians, sin, sqrt
from typing import NamedTuple

import numpy as np
from scene_of import scene_of
from truths import BLACK, WHITE, element, from_element, grey, in_wedge, parallel, perpendicular, view_of, wedge

from raytwin.scene import Rectangle, Scene, Shape, Sphere, Sun

FLOOR = Rectangle((0, 0, 0), (10, 0, 0), (0, 10, 0), grey(0.5))


class Closed(NamedTuple):
    """`expected`: the radiance at `depth` (2: light, surface, eye); `bias`: what the scene's finite size costs."""

    scene: Scene
    expected: float
    bias: float = 0.0
    depth: int = 2


def over_element(*things: Shape, hidden: float) -> Closed:
    """The element at the origin faces up."""
    camera = view_of((0, 0, 0), (-0.6, -0.5, 0.5), 1e-5)
    return Closed(scene_of("element", camera, (element((0, 0, 1)), *things), WHITE), 0.5 * (1 - hidden))


def beside_sphere(h: float, c: float) -> Closed:
    """A black sphere h radii away, at the angle acos(c) from the element's normal: Howell's formula."""
    sphere = Sphere((h * sqrt(1 - c * c), 0, h * c), 1.0, BLACK)
    found = over_element(sphere, hidden=from_element(h, c))
    return found._replace(scene=found.scene.with_camera(view_of((0, 0, 0), (-0.6, 0.2, 0.3), 1e-5)))


def under_ball(height: float, at: float) -> Closed:
    """A ball whose centre is H above the floor hides r² H / (ρ² + H²)^(3/2), ρ from its foot."""
    eye = (at + 2.5, 0.0, 0.15) if height == 1.0 else (at + 2.0, 0.3, 0.4)
    scene = scene_of("ball", view_of((at, 0, 0), eye, 1e-4), (Sphere((0, 0, height), 1.0, grey(0.3)), FLOOR), WHITE)
    return Closed(scene, 0.5 * (1 - height / hypot(at, height) ** 3), 2e-5)  # the picture is 0.002 long


def on_ball(slope: float) -> Closed:
    """A ball over a black floor sees (1 + n·z) / 2 of the sky; a floor of 1000 H leaves 1e-3 rad open above its rim."""
    n = np.array([sqrt(1 - slope**2), 0, slope])
    at = np.array([0, 0, 3.0]) + n
    floor = Rectangle((0, 0, 0), (3000, 0, 0), (0, 3000, 0), BLACK)
    camera = view_of(at, at + 1.2 * n + np.array([0.0, 0.5, 0.0]), 1e-3)
    scene = scene_of("over", camera, (Sphere((0, 0, 3.0), 1.0, grey(0.5)), floor), WHITE)
    return Closed(scene, 0.5 * (1 + slope) / 2, 0.5 * 6.4e-4 * n[0])


def beside_wall(at: float, order: int = 1) -> Closed:
    """(1 - d / √(d² + H²)) / 2 at the distance d from a wall of height H; it is 200 H long, which takes 1e-5 off."""
    floor = Rectangle((0, 0, 0), (100, 0, 0), (0, 100, 0), grey(0.5))
    wall = Rectangle((0, 0, 0.5), (0, 100, 0), (0, 0, 0.5), grey(0.5))
    camera = view_of((at, 0, 0), (at + 0.4, 0.1, 0.8), 1e-4)
    scene = scene_of("wall", camera, (floor, wall)[::order], WHITE)
    return Closed(scene, 0.5 * (1 - (1 - at / hypot(at, 1)) / 2), max(1e-5, 1e-4 * at))


def between_planes(
    degrees: float, one: float, other: float, bounces: int, sun: float = 0.0, half: float = 500.0
) -> Closed:
    """Seen d = 5 mm from the edge, under a sun along the wedge's middle. Where the sheets end the sky comes in: that
    brightens by d / half at most.

    (9.6e-4 for 10 m at 60 degrees and depth 32, the worst, by 8 million samples; 7e-5 +- 7e-5 for 1 km.)
    """
    tilt = radians(degrees / 2)
    lights = WHITE + ((Sun((cos(tilt), 0.0, sin(tilt)), (sun,) * 3),) if sun else ())
    eye = (0.005 + 0.15 * cos(radians(35)), 0.04, 0.15 * sin(radians(35)))
    scene = scene_of("wedge", view_of((0.005, 0, 0), eye, 1e-5), wedge(degrees, one, other, half), lights)
    share = sun * sin(tilt) / pi
    return Closed(scene, in_wedge(degrees, one, other, bounces, (share, share)), 0.005 / half, bounces + 2)


LID = Rectangle((0.75, 0.5, 1.0), (0.75, 0, 0), (0, 0.5, 0), BLACK)
OPPOSITE = Rectangle((0.5, 0.6, 0.4), (0, 0.6, 0), (0, 0, 0.4), BLACK)
# Albedos, bounces, and the sun.
WEDGES = (
    (0.5, 0.5, 0, 0.0), (0.5, 0.5, 1, 0.0), (0.5, 0.5, 2, 0.0), (0.5, 0.5, 30, 0.0), (0.8, 0.3, 30, 0.0),
    (0.3, 0.8, 2, 2.0),
)  # fmt: skip

FAMILIES: dict[str, list[Closed]] = {
    "a sphere hides from an element what Howell says": [
        beside_sphere(h, c)
        for h, c in ((2, 1), (2, 0.5), (2, 0), (2, -0.25), (1.5, 0.3), (1.5, 0), (4, 0.1), (1.01, 0))
    ],
    "a ball hides its share of the sky from the floor": [
        under_ball(height, at) for height, at in ((1, 0.5), (1, 1), (1, 2), (1, 3), (2, 0), (2, 0.5), (2, 1), (2, 3))
    ],
    "a ball sees its half of the sky": [on_ball(slope) for slope in (-0.8, -0.2, 0.4)],
    "a lid hides what its solid angle does": [over_element(LID, hidden=parallel(1.5, 1.0))],
    "a wall opposite hides what its solid angle does": [
        over_element(OPPOSITE, hidden=perpendicular(0.8 / 1.2, 0.5 / 1.2))
    ],
    "a wall hides its share from the floor beside it": [
        beside_wall(0.1), beside_wall(0.1, -1), beside_wall(0.5), beside_wall(2.0),
    ],
    "light between two planes": [between_planes(degrees, *row) for degrees in (60, 90, 120) for row in WEDGES],
    "light between two planes of ten metres": [
        between_planes(degrees, *WEDGES[row], half=5.0) for degrees, row in ((60, 3), (90, 5), (120, 1))
    ],
}  # fmt: skip

CLOSED = {f"{family}, {i}": row for family, rows in FAMILIES.items() for i, row in enumerate(rows)}
FIRST = [name for name in CLOSED if name.endswith(", 0")]
"""One of each family."""
