"""Scenes that nobody has seen: drawn from a seed, and drawn again where a mistake could hide in them.

A scene is blind to a transposed R where R is symmetric, to missing shadows where nothing is in shadow, to clipping
where nothing exceeds 1, to a missing depth test where nothing is hidden, to normals that are not turned to the eye
where no plane is seen from behind, to hits behind the eye where nothing is there.
"""

from collections.abc import Iterator
from itertools import permutations
from math import cos, dist, hypot
from operator import mul

import numpy as np
from msgspec.structs import replace

from raytwin.diagnose.predict import RIGHT, Predictor
from raytwin.errors import InputError
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Shape, Sky, Sphere, Sun

SIZE = (120, 88)
"""Pixels."""
LARGER = 6.0
"""So many times larger some scenes are drawn, so that code that takes a length for 1 is caught."""
LEAST = 0.005
"""Share of the pixels: what fewer pixels show may be overlooked."""
TRIES = 1000
"""Scenes drawn before giving up."""
AROUND = (((0.0, -2.2, -0.3), 0.6), ((0.0, 2.6, 0.0), 0.8), ((0.0, 1.5, -2.6), 1.5), ((0.0, -0.8, 2.6), 0.5))
"""Large spheres far away, where rays of a wrong camera go: what they meet tells which way it is wrong."""
PROBED = (60, 44)
"""Pixels of the small picture that is looked at to see what a scene shows."""
MOVED = 0.004
"""Metres by which parts of an arrangement are moved, at most, along each axis."""
ARRANGEMENTS = (
    5, 337, 603, 770, 896, 912, 919, 1233, 1560, 1594, 1655, 1869, 2110, 2129, 2243, 2435, 2506, 2687, 3276, 3450,
    3750, 3789, 3795, 4293, 4325, 4426, 4463, 4477, 4643, 4667, 4764, 4927, 5073, 5087, 5169, 5248, 5649, 5665,
    5819, 6003, 6089, 6121, 6686, 6735, 7319, 7602, 7923, 8030, 8059, 8295, 8316, 8977, 8997, 9226, 9417, 9433,
    9844, 10260, 10912, 11160, 11695, 11792, 12121, 12544, 12575, 12745, 13269, 13853, 14215, 14220, 14277, 14385,
    14432, 14459, 14519, 14726, 14869, 14927, 14931, 14987, 15083, 15251, 15296, 15347, 16118, 16153, 16234, 16855,
    17065, 17147, 17294, 17477, 18087, 18801, 18811, 19123, 19917, 19974, 20657, 20973, 21423, 21437, 21664, 22138,
    22291, 22894, 23356, 23480, 23510, 23661, 23761, 23775, 23903, 24002, 24587, 24616, 24636, 25091, 26077, 26157,
    26468, 26686, 26961, 27048, 27058, 27067, 27186, 27314,
)  # fmt: skip
"""Those of the first numbers of `arrangement` that are blind to nothing, by a margin."""
GAP = 0.004
"""Metres, between any two things: more than by what a shadow ray starts off its surface."""


def draw_scene(seed: int, size: tuple[int, int] = SIZE, name: str = "", scale: float = 1) -> Scene:
    """Spheres on and above a floor, panels seen from both sides, things behind the eye, a lens with all coefficients.

    Sun and sky have colours. Blind to nothing. `scale`: all lengths are so many times as long, with the same picture:
    a length that is taken for 1 shows.
    """
    rng = np.random.default_rng([seed, 7])
    for _ in range(TRIES):
        scene = _varied(rng, arrangement(int(rng.choice(ARRANGEMENTS)), size))
        if scene is not None and not blind_to(replace(scene, camera=scene.camera.resized(*PROBED))):
            return replace(_turned(scene, np.eye(3), scale), name=name or f"drawn-{seed}")
    raise InputError("seed", "one that gives a scene", seed)


def arrangement(number: int, size: tuple[int, int] = SIZE) -> Scene:
    """Draw a scene that may be blind to something."""
    return _drawn(np.random.default_rng([number, 8]), size, "")


def _varied(rng: np.random.Generator, scene: Scene) -> Scene | None:
    """Turn a scene about z, move its parts, and draw its colours and lens anew; None where two parts touch."""
    objects: list[Shape] = []
    for x in scene.objects:
        center = _three(x.center + rng.uniform(-MOVED, MOVED, 3) * (1, 1, 0 if _is_floor(x) else 1))
        if isinstance(x, Sphere):
            radius = x.radius * rng.uniform(0.97, 1.03)
            low = radius + GAP if x.center[2] > 0 else -np.inf
            objects.append(Sphere((*center[:2], max(center[2], low)), radius, _paint(rng)))
        elif isinstance(x, Rectangle):
            u, v = (_three(rng.uniform(0.97, 1.03) * np.array(half)) for half in (x.half_u, x.half_v))
            objects.append(Rectangle(center, u, v, _paint(rng)))
    sun, sky = Sun(scene.sun.to_light, _sunlight(rng)), Sky(_skylight(rng))
    t = _three(scene.camera.t_cam_board + rng.uniform(-MOVED, MOVED, 3))
    camera = replace(scene.camera, dist=_lens(rng), t_cam_board=t)
    made = replace(scene, camera=camera, objects=tuple(objects), lights=(sun, sky))
    spheres, panels = list(made.spheres), [x for x in objects if isinstance(x, Rectangle) and not _is_floor(x)]
    if not _apart(spheres) or not all(_is_clear(panel, spheres) for panel in panels):
        return None
    angle = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    return _turned(made, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _turned(scene: Scene, rotation: np.ndarray, scale: float = 1) -> Scene:
    """The scene in another frame of the board, and so many times as long: the same picture."""

    def moved(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return _three(scale * rotation @ v)

    objects: list[Shape] = []
    for x in scene.objects:
        if isinstance(x, Sphere):
            objects.append(replace(x, center=moved(x.center), radius=scale * x.radius))
        elif isinstance(x, Rectangle):
            objects.append(replace(x, center=moved(x.center), half_u=moved(x.half_u), half_v=moved(x.half_v)))
    R, t = np.array(scene.camera.R_cam_board) @ rotation.T, scale * np.array(scene.camera.t_cam_board)
    camera = replace(scene.camera, R_cam_board=(_three(R[0]), _three(R[1]), _three(R[2])), t_cam_board=_three(t))
    sun = replace(scene.sun, to_light=_three(rotation @ scene.sun.to_light))
    return replace(scene, camera=camera, objects=tuple(objects), lights=(sun, scene.sky))


def blind_to(scene: Scene, least: float = LEAST) -> list[str]:
    """The kinds of mistake that this scene would not show."""
    return [name for name, there in _shows(scene) if np.mean(there) < least]


def _shows(scene: Scene) -> Iterator[tuple[str, np.ndarray | bool]]:
    """Each kind of mistake, and the pixels that show it: those first that cost least to know and are missing most."""
    yield "a missing depth test", _overlap(list(scene.spheres), np.asarray(scene.camera.eye))
    R = np.asarray(scene.camera.R_cam_board)
    yield "a transposed R", bool(np.abs(R - R.T).max() >= 0.3)
    v, u = np.indices((scene.camera.height, scene.camera.width), float).reshape(2, -1)
    bench, count = Predictor(scene, u, v, shadows=False), len(scene.spheres)
    met, described = bench.functions(RIGHT)["intersect_all"], bench.described(RIGHT)
    things, eye = described["things"], -R.T @ described["t_cam_board"]
    rays = bench.functions(RIGHT)["through"](described["K"], described["dist"], u, v) @ R
    eyes = np.tile(eye, (len(rays), 1))
    ahead, seen = np.isfinite(met(eyes, rays, things)), bench.seen()
    ids, facing = seen.ids, seen.cos
    ball, flat = (ids >= 0) & (ids < count), ids >= count
    away = np.array([np.linalg.norm(x["center"] - eye) for x in things])
    painted = np.where(ahead, away[:, None], np.inf).argmin(axis=0)
    yield "drawing by the centres' distance", (ids >= 0) & (painted != ids)
    yield "a plane before a sphere", flat & ahead[:count].any(axis=0)
    yield "the background", ids < 0
    yield "a plane's dark side", flat & (facing < -0.05)
    yield "lit backs", ball & (facing < -0.05)
    to_light = np.tile(scene.sun.to_light, (len(rays), 1))
    hides = np.isfinite(met(seen.points, to_light, things)) & (np.arange(len(ahead))[:, None] != ids)
    yield "clipping", (bench.radiance() > 1).any(axis=-1) & ~hides.any(axis=0)
    by_balls, by_planes = (x.any(axis=0) & (facing > 0.05) for x in (hides[:count], hides[count:]))
    yield "shadows of spheres on spheres", ball & by_balls & ~by_planes
    yield "shadows of planes on planes", flat & by_planes & ~by_balls
    yield "shadows of planes on spheres", ball & by_planes & ~by_balls
    yield "shadows of spheres on planes", flat & by_balls & ~by_planes
    lit = (facing > 0.05) & ~by_balls & ~by_planes
    own = np.array([x.normal if isinstance(x, Rectangle) else (0, 0, 0) for x in scene.objects])[ids]
    yield "a lit plane, seen from behind", flat & lit & ((own * rays).sum(axis=-1) > 0.05)
    yield "light on spheres", ball & lit
    behind = np.isfinite(met(eyes, -rays, things))
    yield "spheres behind the eye", behind[:count].any(axis=0)
    yield "planes behind the eye", behind[count:].any(axis=0)


def _overlap(spheres: list[Sphere], eye: np.ndarray) -> bool:
    """A sphere hides one that comes later in the list, and one that comes earlier: seen from the eye."""
    to = [[c - e for c, e in zip(s.center, eye.tolist(), strict=True)] for s in spheres]
    d = [hypot(*x) for x in to]
    wide = [s.radius / x for s, x in zip(spheres, d, strict=True)]
    hides = {
        i < j
        for i, j in permutations(range(len(spheres)), 2)
        if d[i] < d[j] and sum(map(mul, to[i], to[j])) > d[i] * d[j] * cos(0.8 * (wide[i] + wide[j]))
    }
    return len(hides) == 2


def _drawn(rng: np.random.Generator, size: tuple[int, int], name: str) -> Scene:
    width, height = size
    f = width * rng.uniform(0.9, 1.1)
    K = (
        (f, 0.0, width * rng.uniform(0.42, 0.47)),
        (0.0, f * rng.uniform(1.02, 1.06), height * rng.uniform(0.53, 0.58)),
    )
    eye = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.9, -0.7), rng.uniform(0.4, 0.65)])
    R = _looking(eye, np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.08, 0.16)]), rng.uniform(-0.3, 0.3))
    camera = Camera(
        K=(*K, (0.0, 0.0, 1.0)),
        image_size=size,
        dist=_lens(rng),
        R_cam_board=(_three(R[0]), _three(R[1]), _three(R[2])),
        t_cam_board=_three(-R @ eye),
    )
    angle, up = -np.pi / 2 + rng.choice([-1, 1]) * rng.uniform(0.5, 1.7), rng.uniform(0.7, 1.6)  # from the eye's side
    to_light = _unit(np.array([np.cos(angle), np.sin(angle), up]))
    spheres = _spheres(rng, eye, to_light)
    planes = _planes(rng, eye, to_light, spheres)
    # Behind the eye, to be met by none of its rays.
    for place, radius in ((eye - 0.5 * R[2], 0.13), *((np.array(p), r) for p, r in AROUND)):
        ball = Sphere(_three(place + radius * rng.uniform(-0.3, 0.3, 3)), radius, _paint(rng))
        spheres.insert(rng.integers(1, len(spheres)), ball)
    floor, *panels = planes
    wall = _rectangle(rng, eye - 0.8 * R[2], _unit(R[2] + rng.uniform(-0.2, 0.2, 3)), 0.2, 0.3)
    # First and last of each kind stand what casts shadows and is seen: loops that miss an end show.
    one, other = rng.permutation(2)
    middle = [floor, wall] if rng.random() < 0.5 else [wall, floor]
    objects = [*spheres, panels[one], *middle, panels[other]]
    sun, sky = Sun(_three(to_light), _sunlight(rng)), Sky(_skylight(rng))
    return Scene(name, camera, tuple(objects), (sun, sky))


def _spheres(rng: np.random.Generator, eye: np.ndarray, to_light: np.ndarray) -> list[Sphere]:
    """One; another in its shadow; another before or behind it; perhaps a fourth. In any order, none touching."""
    while True:
        first = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.17, 0.23)])
        centers = [first, first - rng.uniform(0.16, 0.2) * to_light + rng.uniform(-0.02, 0.02, 3)]
        along = rng.choice([-1, 1]) * rng.uniform(0.16, 0.2) * _unit(first - eye)
        centers.append(first + along + rng.uniform(-0.07, 0.07, 3))
        if rng.random() < 0.4:
            centers.append(np.array([*rng.uniform(-0.2, 0.2, 2), 0.1]))
        rng.shuffle(centers)
        radii = rng.uniform(0.05, 0.085, len(centers))
        made = [
            Sphere((float(x), float(y), max(float(z), float(r) + GAP)), float(r), _paint(rng))
            for (x, y, z), r in zip(centers, radii, strict=True)
        ]
        if _apart(made) and _overlap(made, eye):
            return made


def _apart(spheres: list[Sphere]) -> bool:
    return all(
        dist(a.center, b.center) >= a.radius + b.radius + GAP for i, a in enumerate(spheres) for b in spheres[:i]
    )


def _planes(rng: np.random.Generator, eye: np.ndarray, to_light: np.ndarray, spheres: list[Sphere]) -> list[Rectangle]:
    """A floor; a panel between a sphere and the sun, whose back is seen and lit; one seen from its dark side,
    before a sphere."""
    floor = np.array([*rng.uniform(-0.03, 0.03, 2), 0.0])
    made = [_rectangle(rng, floor, np.array([0.0, 0.0, 1.0]), 0.28, 0.36)]
    while len(made) < 2:
        place = np.array(spheres[rng.integers(len(spheres))].center) + rng.uniform(0.12, 0.25) * to_light
        place = place + rng.uniform(-0.05, 0.05, 3)
        normal = _unit(_unit(eye - place) + to_light + rng.uniform(-0.2, 0.2, 3))
        panel = _rectangle(rng, place, -normal, 0.05, 0.08)
        made += [panel] if _is_clear(panel, spheres) else []
    while len(made) < 3:
        place = np.array(spheres[rng.integers(len(spheres))].center)
        to_eye = _unit(eye - place)
        place = place + rng.uniform(0.12, 0.3) * to_eye + rng.uniform(-0.07, 0.07, 3)
        normal = _unit(to_eye - (to_eye @ to_light + rng.uniform(0.3, 0.6)) * to_light) * rng.choice([-1, 1])
        panel = _rectangle(rng, place, normal, 0.04, 0.07)
        made += [panel] if _is_clear(panel, spheres) else []
    return made


def _is_clear(panel: Rectangle, spheres: list[Sphere]) -> bool:
    """Whether it touches neither the floor nor a sphere."""
    lowest = panel.center[2] - abs(panel.half_u[2]) - abs(panel.half_v[2])
    for s in spheres:
        away, near = np.subtract(s.center, panel.center), np.zeros(3)
        for half in (np.array(panel.half_u), np.array(panel.half_v)):
            near = near + min(1.0, max(-1.0, away @ half / (half @ half))) * half
        if hypot(*(away - near)) < s.radius + GAP:
            return False
    return lowest > GAP


def _is_floor(x: Shape) -> bool:
    return isinstance(x, Rectangle) and x.half_u[2] == x.half_v[2] == 0


def _rectangle(rng: np.random.Generator, center: np.ndarray, normal: np.ndarray, low: float, high: float) -> Rectangle:
    """With this normal, half_u × half_v; its edges point anywhere."""
    u = _unit(np.cross(normal, rng.normal(size=3)))
    (a, b), v = rng.uniform(low, high, 2), np.cross(normal, u)
    return Rectangle(_three(center), _three(a * u), _three(b * v), _paint(rng))


def _looking(eye: np.ndarray, target: np.ndarray, roll: float) -> np.ndarray:
    """R_cam_board (3, 3) of a camera at `eye` that looks at `target`: rows are the camera's x, y, z in the board's."""
    z = _unit(target - eye)
    x = _unit(np.cross(z, [0.0, 0.0, 1.0]))
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * x + s * y, -s * x + c * y, z])


def _paint(rng: np.random.Generator) -> Lambert:
    return Lambert(_colour(rng, 0.3, 0.95))


def _sunlight(rng: np.random.Generator) -> tuple[float, float, float]:
    return _colour(rng, 4.5, 7.5)


def _skylight(rng: np.random.Generator) -> tuple[float, float, float]:
    return _colour(rng, 0.08, 0.3)


def _lens(rng: np.random.Generator) -> tuple[float, ...]:
    return tuple((rng.uniform(0.7, 1.3, 5) * [-0.2, 0.07, 0.008, -0.006, 0.05]).tolist())


def _colour(rng: np.random.Generator, low: float, high: float) -> tuple[float, float, float]:
    """Three values that differ by a fifth of the range at least."""
    return _three(low + (high - low) * rng.permutation(np.array([0.0, 0.4, 0.8]) + rng.uniform(0, 0.2, 3)))


def _unit(v: np.ndarray) -> np.ndarray:
    return np.asarray(v / np.linalg.norm(v))


def _three(v: np.ndarray) -> tuple[float, float, float]:
    x, y, z = v.tolist()
    return (x, y, z)
