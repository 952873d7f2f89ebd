"""Random scenes of 19 kinds: what a correct tracer and the twin must agree on, whatever a user points them at."""

from collections.abc import Callable

import msgspec
import numpy as np
from scene_of import changed, scene_of

from raytwin.scene import Camera, Environment, Rectangle, Scene, Sky, Sphere, Sun

Rng = np.random.Generator
SIZE = (96, 72)


def _tuple(x: np.ndarray) -> tuple[float, float, float]:
    a, b, c = (float(v) for v in x)
    return a, b, c


def camera(eye: np.ndarray, target: np.ndarray, focal: float = 1.2, dist: tuple[float, ...] = ()) -> Camera:
    """A camera at `eye` that looks at `target` with the world's z up; `focal` in units of the width."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(forward, right), forward])
    w, h = SIZE
    K = ((focal * w, 0.0, w / 2 - 0.3), (0.0, focal * w, h / 2 + 0.2), (0.0, 0.0, 1.0))
    rows = tuple(_tuple(row) for row in R)
    return Camera(SIZE, K, (rows[0], rows[1], rows[2]), _tuple(-R @ eye), dist)


def _colour(rng: Rng) -> tuple[float, float, float]:
    return _tuple(rng.uniform(0.1, 0.9, 3))


def _sun(rng: Rng, strength: float = 3.0, lowest: float = 0.2) -> Sun:
    turn, up = rng.uniform(0, 2 * np.pi), rng.uniform(lowest, 1)
    flat = np.sqrt(1 - up * up)
    return Sun((flat * np.cos(turn), flat * np.sin(turn), up), _tuple(strength * rng.uniform(0.5, 1, 3)))


def _sky(rng: Rng, radiance: float = 0.5) -> Sky:
    return Sky(_tuple(radiance * rng.uniform(0.5, 1, 3)))


def _balls(rng: Rng, count: int, wide: float = 1.5, size: tuple[float, float] = (0.2, 0.6)) -> list[Sphere]:
    """Spheres about the origin, on and above z = 0, that do not meet."""
    made: list[Sphere] = []
    while len(made) < count:
        radius = rng.uniform(*size)
        centre = np.array([*rng.uniform(-wide, wide, 2), radius + rng.choice([1e-3, 0.1, 0.5])])
        if all(np.linalg.norm(centre - s.center) > radius + s.radius + 0.02 for s in made):
            made.append(Sphere(_tuple(centre), radius, _colour(rng)))
        size = (size[0] * 0.98, size[1] * 0.98)
    return made


def _floor(rng: Rng, half: float = 4.0) -> Rectangle:
    return Rectangle((0.0, 0.0, 0.0), (half, 0.0, 0.0), (0.0, half, 0.0), _colour(rng))


def _eye(rng: Rng, away: float = 5.0) -> np.ndarray:
    turn, up = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 0.8)
    return away * np.array([np.cos(turn) * np.sqrt(1 - up * up), np.sin(turn) * np.sqrt(1 - up * up), up])


MIDDLE = np.array([0.0, 0.0, 0.4])


def _scene(rng: Rng, objects: list, lights: tuple | None = None, seen: Camera | None = None) -> Scene:
    lights = (_sun(rng), _sky(rng)) if lights is None else lights
    return scene_of("random", seen or camera(_eye(rng), MIDDLE), tuple(objects), lights)


def usual(rng: Rng) -> Scene:
    return _scene(rng, [*_balls(rng, int(rng.integers(2, 5))), _floor(rng)])


def _times(scene: Scene, by: float) -> Scene:
    """All lengths `by` times as long: the same picture."""
    replace, objects = msgspec.structs.replace, []
    for x in scene.objects:
        centre = _tuple(by * np.array(x.center))
        if isinstance(x, Sphere):
            objects.append(replace(x, center=centre, radius=by * x.radius))
        else:
            u, v = (_tuple(by * np.array(e)) for e in (x.half_u, x.half_v))
            objects.append(replace(x, center=centre, half_u=u, half_v=v))
    seen = replace(scene.camera, t_cam_board=_tuple(by * np.array(scene.camera.t_cam_board)))
    return changed(scene, objects=tuple(objects), camera=seen)


def far(rng: Rng) -> Scene:
    """Seen from some 20 to 80 radii away, through a long lens."""
    eye = _eye(rng, 20)
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], seen=camera(eye, MIDDLE, focal=5.0))


def tiny(rng: Rng) -> Scene:
    return _times(usual(rng), 0.01)


def huge(rng: Rng) -> Scene:
    return _times(usual(rng), 50.0)


def bright(rng: Rng) -> Scene:
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], (_sun(rng, 3000.0), _sky(rng, 100.0)))


def dim(rng: Rng) -> Scene:
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], (_sun(rng, 1e-4), _sky(rng, 1e-5)))


def lens(rng: Rng) -> Scene:
    dist = tuple(float(x) for x in rng.uniform((-0.25, -0.05, -0.003, -0.003), (0.1, 0.1, 0.003, 0.003)))
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], seen=camera(_eye(rng), MIDDLE, dist=dist))


def inside(rng: Rng) -> Scene:
    """The eye within a box of walls, open to the sky on some sides."""
    walls = [
        Rectangle((0.0, 0.0, -1.0), (3.0, 0.0, 0.0), (0.0, 3.0, 0.0), _colour(rng)),
        Rectangle((0.0, 3.0, 1.0), (3.0, 0.0, 0.0), (0.0, 0.0, 2.0), _colour(rng)),
        Rectangle((3.0, 0.0, 1.0), (0.0, 3.0, 0.0), (0.0, 0.0, 2.0), _colour(rng)),
    ]
    seen = camera(np.array([-1.5, -1.5, 0.5]) + rng.uniform(-0.3, 0.3, 3), np.array([1.0, 1.0, 0.0]), focal=0.8)
    return _scene(rng, [*walls, *_balls(rng, 2)], seen=seen)


def highlights(rng: Rng) -> Scene:
    def shiny(ball: Sphere) -> Sphere:
        specular, albedo = rng.uniform(0.05, 0.4), _tuple(rng.uniform(0.1, 0.5, 3))
        exponent = float(rng.choice([3.0, 20.0, 80.0]))
        return msgspec.structs.replace(ball, albedo=albedo, specular=(specular,) * 3, exponent=exponent)

    balls = [shiny(ball) for ball in _balls(rng, 3)]
    return _scene(rng, [*balls, _floor(rng)])


def mapped(rng: Rng) -> Scene:
    texels = rng.uniform(0.1, 1, (8, 16, 3)).astype("<f4")
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], (_sun(rng), Environment((16, 8), texels.tobytes())))


def planes(rng: Rng) -> Scene:
    """Panels that stand and lean on a floor, seen from both sides."""
    made: list = [_floor(rng)]
    for x in (-1.2, 0.0, 1.2):
        turn, lean = rng.uniform(0, np.pi), rng.uniform(-0.4, 0.4)
        u = 0.5 * np.array([np.cos(turn), np.sin(turn), 0])
        v = 0.6 * np.array([-np.sin(turn) * np.sin(lean), np.cos(turn) * np.sin(lean), np.cos(lean)])
        centre = np.array([x, rng.uniform(-1, 1), 0.7])
        made.append(Rectangle(_tuple(centre), _tuple(u), _tuple(v), _colour(rng)))
    return _scene(rng, made)


def touching(rng: Rng) -> Scene:
    """Spheres that rest on the floor and on one another."""
    r = rng.uniform(0.3, 0.6)
    first = np.array([-r, 0.0, r])
    spheres = [
        Sphere(_tuple(first + 2 * r * np.array(step)), r, _colour(rng)) for step in ((0, 0, 0), (1, 0, 0), (0, 1, 0))
    ]
    return _scene(rng, [*spheres, _floor(rng)])


def edges(rng: Rng) -> Scene:
    """Walls that share their edges: where they meet, rounding decides."""
    a, b = rng.uniform(0.8, 1.5, 2)
    walls = [
        Rectangle((0.0, 0.0, 0.0), (a, 0.0, 0.0), (0.0, b, 0.0), _colour(rng)),
        Rectangle((0.0, b, 1.0), (a, 0.0, 0.0), (0.0, 0.0, 1.0), _colour(rng)),
        Rectangle((-a, 0.0, 1.0), (0.0, b, 0.0), (0.0, 0.0, 1.0), _colour(rng)),
    ]
    eye = np.array([rng.uniform(3, 5), rng.uniform(-5, -3), rng.uniform(2, 4)])
    return _scene(rng, walls, seen=camera(eye, np.array([0.0, 0.0, 0.7])))


def many(rng: Rng) -> Scene:
    return _scene(rng, [*_balls(rng, 25, 2.0, (0.1, 0.3)), _floor(rng)])


def thin(rng: Rng) -> Scene:
    """Slivers: narrow panels and small spheres that hide little of the sky."""
    strips = [
        Rectangle((float(x), 0.1 * k, 0.8), (0.01, 0.0, 0.0), (0.0, 0.0, 0.5), _colour(rng))
        for k, x in enumerate(rng.uniform(-1.5, 1.5, 4))
    ]
    return _scene(rng, [*strips, *_balls(rng, 3, 1.5, (0.06, 0.1)), _floor(rng)])


def low_sun(rng: Rng) -> Scene:
    flat = _sun(rng, lowest=0.03)
    sun = Sun((*flat.to_light[:2], 0.05), flat.irradiance)
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], (sun, _sky(rng)))


def overcast(rng: Rng) -> Scene:
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], (_sky(rng),))


def night(rng: Rng) -> Scene:
    """A sun, and a black sky."""
    return _scene(rng, [*_balls(rng, 3), _floor(rng)], (_sun(rng),))


def lone(rng: Rng) -> Scene:
    """One convex body: nothing hides anything."""
    return _scene(rng, _balls(rng, 1))


def distant_occluder(rng: Rng) -> Scene:
    """A floor and a ball high above it, which hides a thousandth of the sky."""
    ball = Sphere((rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(6, 15)), 0.4, _colour(rng))
    return _scene(rng, [ball, _floor(rng)], seen=camera(_eye(rng), np.zeros(3)))


KINDS: dict[str, Callable[[Rng], Scene]] = {
    "usual": usual, "far": far, "tiny": tiny, "huge": huge, "bright": bright, "dim": dim, "lens": lens,
    "inside": inside, "highlights": highlights, "map": mapped, "planes": planes, "touching": touching, "edges": edges,
    "many": many, "thin": thin, "low sun": low_sun, "overcast": overcast, "night": night, "lone": lone,
    "distant occluder": distant_occluder,
}  # fmt: skip


def random_scene(kind: str, seed: int) -> Scene:
    return KINDS[kind](np.random.default_rng([seed, *kind.encode()]))
