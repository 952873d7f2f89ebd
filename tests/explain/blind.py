"""Which mistakes a scene would not show: what an arrangement of `draw_scene` has to be free of."""

from collections.abc import Iterator
from itertools import permutations
from math import cos

import numpy as np

from raytwin.explain.predict import RIGHT, Predictor
from raytwin.scene import Rectangle, Scene

LEAST = 0.005
"""Share of the pixels: what fewer pixels show may be overlooked."""
GAP = 0.001
"""Metres, between any two things: no less than what shadow rays start off their surface."""


def blind_to(scene: Scene, least: float = LEAST) -> list[str]:
    """The kinds of mistake that this scene would not show."""
    return [name for name, there in shown_kinds(scene) if np.mean(there) < least]


def shown_kinds(scene: Scene) -> Iterator[tuple[str, np.ndarray | bool]]:
    """Each kind of mistake, and the pixels that show it."""
    yield "a missing depth test", _overlap(scene)
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


def _overlap(scene: Scene) -> bool:
    """A sphere hides one that comes later in the list, and one that comes earlier: seen from the eye."""
    to = [np.subtract(s.center, scene.camera.eye) for s in scene.spheres]
    d = [float(np.linalg.norm(x)) for x in to]
    wide = [s.radius / x for s, x in zip(scene.spheres, d, strict=True)]
    hides = {
        i < j
        for i, j in permutations(range(len(to)), 2)
        if d[i] < d[j] and to[i] @ to[j] > d[i] * d[j] * cos(0.8 * (wide[i] + wide[j]))
    }
    return len(hides) == 2


def nearest_gap(scene: Scene) -> float:
    """Metres between the two things that come nearest: spheres, panels and the floor."""
    spheres, (floor,) = scene.spheres, (x for x in scene.planes if is_floor(x))
    gaps = [
        np.linalg.norm(np.subtract(a.center, b.center)) - a.radius - b.radius
        for i, a in enumerate(spheres)
        for b in spheres[:i]
    ]
    for panel in scene.planes:
        if panel is not floor:
            gaps.append(panel.center[2] - abs(panel.half_u[2]) - abs(panel.half_v[2]) - floor.center[2])
        for s in spheres:
            away, near = np.subtract(s.center, panel.center), np.zeros(3)
            for half in np.array([panel.half_u, panel.half_v]):
                near = near + np.clip(away @ half / (half @ half), -1, 1) * half
            gaps.append(np.linalg.norm(away - near) - s.radius)
    return float(min(gaps))


def is_floor(x: Rectangle) -> bool:
    return x.half_u[2] == x.half_v[2] == 0
