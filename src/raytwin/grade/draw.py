"""Scenes that nobody has seen: drawn from a seed, and drawn again where a mistake could hide in them.

A scene is blind to a transposed R where R is symmetric, to missing shadows where nothing is in shadow, to clipping
where nothing exceeds 1, to a missing depth test where nothing is hidden, to lit backs where no sphere shows one.
"""

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.tracer import trace

SIZE = (160, 120)
"""Pixels."""
LEAST = 0.01
"""Of the pixels: what fewer show may be overlooked."""
TRIES = 1000


def draw_scene(seed: int, size: tuple[int, int] = SIZE, name: str = "") -> Scene:
    """Three or four spheres on and above a floor, a lens with all five coefficients, sun and sky: blind to nothing."""
    rng = np.random.default_rng([seed, 7])
    for _ in range(TRIES):
        scene = _drawn(rng, size, name or f"drawn-{seed}")
        half = msgspec.structs.replace(scene, camera=scene.camera.resized(size[0] // 2, size[1] // 2))
        if not blind_to(half) and not blind_to(scene):  # the half tells most, in a quarter of the time
            return scene
    raise InputError("seed", "one that gives a scene", seed)


def blind_to(scene: Scene) -> list[str]:
    """The kinds of mistake that this scene would not show."""
    if not _overlap(scene):  # the cheapest question first
        return ["a missing depth test"]
    lambert, shadow = trace(scene, "lambert"), trace(scene, "shadow")
    surface = shadow.surface
    assert surface is not None
    R = np.asarray(scene.camera.R_cam_board)
    spheres = len(scene.spheres)
    ids, light = surface.ids, np.asarray(scene.sun.to_light)
    facing = (surface.normal @ light / np.linalg.norm(light))[surface.mask & (ids < spheres)]
    dark = np.abs(lambert.mean - shadow.mean).max(axis=-1) > 0.05 * lambert.mean.max()
    missing = {
        "a transposed R": np.abs(R - R.T).max() < 0.3,
        "missing shadows": dark.mean() < LEAST or dark[surface.mask & (ids < spheres)].mean() < LEAST,
        "clipping": (shadow.mean > 1).any(axis=-1).mean() < LEAST,
        "lit backs": (facing < 0).mean() < LEAST,
        "an object": min((ids == i).mean() for i in range(len(scene.objects))) < LEAST / 2,
        "the background": (ids < 0).mean() < LEAST,
    }
    return [name for name, holds in missing.items() if holds]


def _overlap(scene: Scene) -> bool:
    """A sphere hides one that comes later in the list, and one that comes earlier: seen from the eye."""
    eye = np.asarray(scene.camera.eye)
    found = set()
    for i, a in enumerate(scene.spheres):
        for j, b in enumerate(scene.spheres):
            to_a, to_b = np.subtract(a.center, eye), np.subtract(b.center, eye)
            da, db = np.linalg.norm(to_a), np.linalg.norm(to_b)
            apart = np.arccos(np.clip(to_a @ to_b / (da * db), -1, 1))
            if i != j and da < db and apart < 0.8 * (a.radius / da + b.radius / db):
                found.add(i < j)
    return found == {True, False}


def _drawn(rng: np.random.Generator, size: tuple[int, int], name: str) -> Scene:
    width, height = size
    f = width * rng.uniform(0.9, 1.2)
    K = (
        (f, 0.0, width * rng.uniform(0.42, 0.47)),
        (0.0, f * rng.uniform(1.02, 1.06), height * rng.uniform(0.53, 0.58)),
    )
    eye = np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.9, -0.7), rng.uniform(0.35, 0.6)])
    R = _looking(eye, np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.08, 0.16)]), rng.uniform(-0.3, 0.3))
    t = -R @ eye
    camera = Camera(
        K=(*K, (0.0, 0.0, 1.0)),
        image_size=size,
        dist=tuple((rng.uniform(0.7, 1.3, 5) * [-0.12, 0.04, 0.004, -0.003, 0.01]).tolist()),
        R_cam_board=(_three(R[0]), _three(R[1]), _three(R[2])),
        t_cam_board=_three(t),
    )
    angle, up = rng.uniform(0, 2 * np.pi), rng.uniform(0.7, 1.6)
    to_light = np.array([np.cos(angle), np.sin(angle), up])
    to_light /= np.linalg.norm(to_light)
    spheres = _spheres(rng, eye, to_light)
    half = rng.uniform(0.28, 0.36, 2)
    floor = Rectangle((0.0, 0.0, 0.0), (float(half[0]), 0.0, 0.0), (0.0, float(half[1]), 0.0), Lambert(_albedo(rng)))
    sun, sky = Sun(_three(to_light), _three(rng.uniform(4.5, 7.0, 3))), Sky(_three(rng.uniform(0.08, 0.3, 3)))
    return Scene(name, camera, (*spheres, floor), (sun, sky))


def _spheres(rng: np.random.Generator, eye: np.ndarray, to_light: np.ndarray) -> list[Sphere]:
    """One; another in its shadow; another before or behind it; perhaps a fourth anywhere. In any order."""
    first = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.14, 0.2)])
    view = (first - eye) / np.linalg.norm(first - eye)
    centers = [first, first - rng.uniform(0.16, 0.2) * to_light + rng.uniform(-0.03, 0.03, 3)]
    centers.append(first + rng.choice([-1, 1]) * rng.uniform(0.16, 0.2) * view + rng.uniform(-0.07, 0.07, 3))
    if rng.random() < 0.5:
        centers.append(np.array([*rng.uniform(-0.2, 0.2, 2), 0.1]))
    rng.shuffle(centers)
    radii = rng.uniform(0.05, 0.085, len(centers))
    return [
        Sphere((float(x), float(y), max(float(z), float(r) + 0.002)), float(r), Lambert(_albedo(rng)))
        for (x, y, z), r in zip(centers, radii, strict=True)
    ]


def _looking(eye: np.ndarray, target: np.ndarray, roll: float) -> np.ndarray:
    """R_cam_board (3, 3) of a camera at `eye` that looks at `target`: rows are the camera's x, y, z in the board's."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * x + s * y, -s * x + c * y, z])


def _albedo(rng: np.random.Generator) -> tuple[float, float, float]:
    return _three(rng.uniform(0.35, 0.95, 3))


def _three(v: np.ndarray) -> tuple[float, float, float]:
    x, y, z = v.tolist()
    return (x, y, z)
