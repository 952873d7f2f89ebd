"""Closed forms of light, and the scenes in which they hold: images of the tracer and of the twin are held to them."""

from math import acos, atan, cos, hypot, inf, pi, radians, sin, sqrt
from typing import NamedTuple

import numpy as np
from scene_of import scene_of

from raytwin.images.image import Image
from raytwin.scene import Camera, Rectangle, Scene, Shape, Sky, Sphere, Sun


def from_element(h: float, c: float) -> float:
    """F of a sphere of radius 1 at the distance h, c the cosine between the element's normal and its direction.

    Howell, A Catalog of Radiation Heat Transfer Configuration Factors, section B.
    """
    if h * c >= 1:
        return c / h**2
    if h * c <= -1:
        return 0.0
    cut = sqrt(1 - h * h * c * c)
    above = c * acos(-c * sqrt((h * h - 1) / (1 - c * c))) - cut * sqrt(h * h - 1)
    return (above / h**2 + atan(cut / sqrt(h * h - 1))) / pi


def view_of(point, eye, extent: float, pixels: int = 16) -> Camera:
    """From `eye` at `point`, the picture `extent` wide there: all its pixels see nearly the same place."""
    eye, point = np.array(eye, float), np.array(point, float)
    far = np.linalg.norm(point - eye)
    z = (point - eye) / far
    x = np.cross(z, (0.6, 0.8, 0.0) if abs(z[2]) > 0.5 else (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    f, c = pixels * far / extent, (pixels - 1) / 2
    K = ((f, 0.0, c), (0.0, f, c), (0.0, 0.0, 1.0))
    return Camera((pixels, pixels), K, tuple(map(tuple, R.tolist())), tuple((-R @ eye).tolist()))


DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))


def camera_above(height: float, size: int = 101, f: float = 100.0) -> Camera:
    """Straight down on the board's origin, the middle pixel's centre on the axis."""
    c = (size - 1) / 2
    return Camera((size, size), ((f, 0.0, c), (0.0, f, c), (0.0, 0.0, 1.0)), DOWN, (0.0, 0.0, height))


def glare(exponent: float) -> tuple[Scene, np.ndarray]:
    """A sheet seen in the sun's mirror direction, aslant; and the red of its Phong highlight by the formula (H, W)."""
    to_light = np.array((0.48, 0.36, 0.8))
    material = (0.3, 0.2, 0.1), (0.4, 0.3, 0.2), exponent
    sun, eye = Sun(tuple(to_light.tolist()), (10.0,) * 3), np.array((-0.48, -0.36, 0.8)) * 1.5
    camera = view_of((0.0, 0.0, 0.0), eye, 2 / exponent**0.5, 48)
    scene = scene_of("glare", camera, (Rectangle((0, 0, 0), (9, 0, 0), (0, 9, 0), *material),), (sun,))
    v, u = np.mgrid[:48, :48].astype(float)
    d = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)
    d = d @ np.array(camera.R_cam_board)
    mirrored = np.maximum(-(d / np.linalg.norm(d, axis=-1, keepdims=True)) @ (to_light * (-1, -1, 1)), 0)
    f = (0.3 + 0.4 * (exponent + 2) / 2 * mirrored**exponent) / np.pi
    return scene, f * 10 * to_light[2]


WHITE = (Sky((1.0, 1.0, 1.0)),)
BLACK = (0.0, 0.0, 0.0)


def grey(albedo: float) -> tuple[float, float, float]:
    return (albedo,) * 3


def element(normal, albedo: float = 0.5) -> Rectangle:
    """A small sheet at the origin that faces along `normal`."""
    n = np.divide(normal, np.linalg.norm(normal))
    u = np.cross(n, (0.36, 0.48, 0.8) if abs(n[2]) < 0.9 else (1.0, 0.0, 0.0))
    u /= np.linalg.norm(u)
    return Rectangle((0, 0, 0), tuple((0.01 * u).tolist()), tuple((0.01 * np.cross(n, u)).tolist()), grey(albedo))


class Shown(NamedTuple):
    """Of the green channel, which is even: the mean, its standard error, and the same of n x n tiles."""

    mean: float
    error: float
    tiles: np.ndarray
    errors: np.ndarray


def shown(image: Image, n: int = 8) -> Shown:
    assert image.variance is not None  # of several batches

    def tiles(values: np.ndarray) -> np.ndarray:
        h, w = values.shape
        return values.reshape(n, h // n, n, w // n).sum(axis=(1, 3), dtype=float)

    mean, variance = tiles(image.mean[..., 1]), tiles(image.variance[..., 1])
    pixels = image.mean[..., 1].size
    return Shown(
        float(mean.sum()) / pixels,
        sqrt(variance.sum()) / pixels,
        mean / pixels * n * n,
        np.sqrt(variance) / pixels * n * n,
    )


def by_chance(z: np.ndarray) -> bool:
    """Of n tiles' errors, in standard errors: at most one beyond 3.5, none beyond 4.5, no large sum of squares.

    All of 64 within 3.5 would fail 3 % of correct pictures. Each of these fails 5 in 10 000: the sum by chi-square of n
    (Wilson and Hilferty; 108 for 64), and up to 15 where few pixels of 16 batches make a tile (Student's t of 60).
    """
    n, far = z.size, np.abs(z)
    most = n * (1 - 2 / (9 * n) + 3.29 * sqrt(2 / (9 * n))) ** 3
    return bool((far > 3.5).sum() <= 1 and far.max() < 4.5 and np.square(z).sum() < most)


def agrees(found: Shown, expected: float, bias: float = 0.0) -> bool:
    """The mean within 3.5 standard errors, and its tiles `by_chance`; beyond what the scene's finite size takes away.

    A correct picture of another seed fails in 2 to 5 of 1000.
    """
    off = np.maximum(np.abs(found.tiles - expected) - bias - 1e-6, 0)
    return abs(found.mean - expected) < 3.5 * found.error + bias + 1e-6 and by_chance(off / (found.errors + 1e-30))


def parallel(A: float, B: float) -> float:
    """F of a rectangle parallel to the element, one corner above it: sides A and B of its height."""
    first = A / hypot(1, A) * atan(B / hypot(1, A)) + B / hypot(1, B) * atan(A / hypot(1, B))
    return first / (2 * pi)


def perpendicular(X: float, Y: float) -> float:
    """F of a rectangle upright on the element's plane, a corner opposite: X = height / width, Y = distance / width."""
    return (atan(1 / Y) - Y / hypot(X, Y) * atan(1 / hypot(X, Y))) / (2 * pi)


def wedge(degrees: float, one: float, other: float, half: float) -> tuple[Shape, ...]:
    """Two sheets of side 2 `half` that meet in the y axis: the floor, and one at the angle to it."""
    a = radians(degrees)
    floor = Rectangle((half, 0, 0), (half, 0, 0), (0, half, 0), grey(one))
    up = np.array([cos(a), 0, sin(a)]) * half
    return floor, Rectangle(tuple(up.tolist()), tuple(up.tolist()), (0, half, 0), grey(other))


BESIDE_EDGE = (0.005 + 0.15 * cos(radians(35)), 0.04, 0.15 * sin(radians(35)))
"""An eye that sees the floor of a wedge 5 mm from the edge."""


def corner(pixels: int) -> Scene:
    """90 degrees, albedo 1/2, a sky of 1: half of all paths go on at each surface.

    Each pixel shows 1/4 without bounces, 1/3 with all.
    """
    return scene_of("wedge", view_of((0.005, 0, 0), BESIDE_EDGE, 1e-5, pixels), wedge(90, 0.5, 0.5, 500.0), WHITE)


def in_wedge(degrees: float, one: float, other: float, bounces: float, suns: tuple[float, float] = (0, 0)) -> float:
    """The radiance of the first plane of an endless wedge under a sky of 1: L_n = a (1 - F + s) + a F L'_{n-1}.

    F = (1 + cos α) / 2, s = E cos θ / π of a sun that lights the whole of the plane; each plane's radiance is constant.
    """
    F = (1 + cos(radians(degrees))) / 2
    light = [a * (1 - F + s) for a, s in zip((one, other), suns, strict=True)]
    if bounces == inf:
        return (light[0] + one * F * light[1]) / (1 - one * other * F * F)
    lit = list(light)
    for _ in range(int(bounces)):
        lit = [light[0] + one * F * lit[1], light[1] + other * F * lit[0]]
    return lit[0]


# ------------------------------------------------------------------------------------------ scenes of one radiance

# All pixels of a small picture show the same radiance. Under a sky of radiance 1 an element of albedo a shows a (1 - F)
# at depth 2. F is the share of its sky, weighed by the cosine, that another surface hides.

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
    scene = scene_of("wedge", view_of((0.005, 0, 0), BESIDE_EDGE, 1e-5), wedge(degrees, one, other, half), lights)
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
