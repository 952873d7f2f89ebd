"""The reference itself: where Mitsuba, left to itself, is wrong, and what raytwin's twin and tracer do there."""

from math import hypot, sqrt
from typing import Any

import numpy as np

from raytwin import twin
from raytwin.atlas.experiment import U32, Error, Experiment, Law, decades
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Shape, Sky, Sphere, Sun
from raytwin.tracer import trace

SIDE, WIDTH = 48, 0.6
"""Pixels of a view, and how wide it is at the distance 1."""

TO_SUN = np.array([0.3, 0.4, 0.8]) / sqrt(0.89)
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
GREY = Lambert((0.5, 0.5, 0.5))


def view(eye: Any, R: np.ndarray = DOWN, side: int = SIDE, width: float = WIDTH) -> Camera:
    f, c = side / width, (side - 1) / 2
    rows = [tuple(row) for row in R.tolist()]
    return Camera((side, side), ((f, 0.0, c), (0.0, f, c), (0.0, 0.0, 1.0)), (rows[0], rows[1], rows[2]),
                  tuple((-R @ np.array(eye, float)).tolist()))  # fmt: skip


def rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """The eye (3,) and unit directions (3, n), in the world's axes and float64."""
    at = np.arange(camera.width) - camera.cx
    u, v = (a.ravel() / camera.fx for a in np.meshgrid(at, at))
    d = np.array(camera.R_cam_board).T @ np.stack([u, v, np.ones(u.size)])
    return np.array(camera.eye), d / np.linalg.norm(d, axis=0)


def seen_by(scene: Scene) -> dict[str, Image | None]:
    """What raytwin's own make of the scene: None where they refuse."""
    found: dict[str, Image | None] = {}
    for name, draw in (
        ("raytwin's twin", lambda: twin.render(scene, "shadow", cache=False)),
        ("raytwin's tracer", lambda: trace(scene, "shadow")),
    ):
        try:
            found[name] = draw()
        except InputError:
            found[name] = None
    return found


# ------------------------------------------------------------------------------------------ Mitsuba as one writes it


def written(things: tuple[Shape, ...], *lights: dict[str, Any], merge: bool = True) -> Any:
    """A Mitsuba scene in metres, as a user writes it: with `merge`, as `load_dict` makes it unless told otherwise."""
    twin.activate()
    import mitsuba as mi

    world: dict[str, Any] = {"type": "scene"}
    for i, thing in enumerate(things):
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}}
        if isinstance(thing, Sphere):
            world[f"s{i}"] = {"type": "sphere", "center": list(thing.center), "radius": thing.radius, "bsdf": bsdf}
        else:
            matrix = np.eye(4)
            matrix[:3] = np.array([thing.half_u, thing.half_v, thing.normal, thing.center]).T
            world[f"s{i}"] = {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), "bsdf": bsdf}
    return mi.load_dict(world | {f"light{i}": light for i, light in enumerate(lights)}, optimize=merge)


def hidden_from_sun(loaded: Any, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return whether the sun is hidden where each ray (3, n) ends, by Mitsuba's own tests and its own offset."""
    import mitsuba as mi

    sun = mi.Vector3f(TO_SUN.tolist())
    if mi.variant().startswith("scalar"):
        found = [loaded.ray_intersect(mi.Ray3f(o.tolist(), way)) for way in d.T.tolist()]
        return np.array([si.is_valid() and loaded.ray_test(si.spawn_ray(sun)) for si in found], bool)
    si = loaded.ray_intersect(
        mi.Ray3f(mi.Point3f(o.tolist()), mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in d)))
    )
    return np.array(loaded.ray_test(si.spawn_ray(sun), si.is_valid()), bool) & np.array(si.is_valid(), bool)


def radiance(loaded: Any, integrator: dict[str, Any], o: np.ndarray, d: np.ndarray, n: int) -> float:
    """The mean of n samples of one ray."""
    import mitsuba as mi

    made, sampler = mi.load_dict(integrator), mi.load_dict({"type": "independent"})
    if mi.variant().startswith("scalar"):
        sampler.seed(1)
        ray = mi.RayDifferential3f(mi.Ray3f(o.tolist(), d.tolist()))
        return float(np.mean([made.sample(loaded, sampler, ray)[0][1] for _ in range(min(n, 4096))]))
    sampler.seed(1, n)
    import drjit as dr

    way = mi.Vector3f(*(dr.full(mi.Float, x, n) for x in d.tolist()))
    colour = made.sample(loaded, sampler, mi.RayDifferential3f(mi.Ray3f(mi.Point3f(o.tolist()), way)))[0]
    return float(np.mean(np.array(colour[1], float)))


PLAIN = "Mitsuba, as written"

# ------------------------------------------------------------------------------------------ the experiments


def ground(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """Return the share of sunlit points of a ground sphere of radius x, seen from 2 m above, that are shaded."""
    eye, d = rays(camera := view((0.0, 0.0, 2.0)))
    ball = Sphere((0.0, 0.0, -x), x, GREY)
    b, c = (2 + x) * d[2], 2 * (2 + 2 * x)
    hit = b * b > c * (1 + 1e-9)
    t = c / (-b + np.sqrt(np.maximum(b * b - c, 0)))
    normal = (eye[:, None] + t * d + np.array([[0], [0], [x]])) / x
    lit = hit & (TO_SUN @ normal > 0.02)
    found: dict[str, Error] = {PLAIN: float(hidden_from_sun(written((ball,)), eye, d)[lit].mean())}
    a, b, c = TO_SUN.tolist()
    for name, image in seen_by(Scene("ground", camera, (ball,), (Sun((a, b, c)),))).items():
        found[name] = None if image is None else float((image.mean[..., 1].ravel() <= 0)[lit].mean())
    return found


FLOOR = Rectangle((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), GREY)


def gap(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """A floor under a large sheet x m above it: the share of its points between them that the sun reaches."""
    eye, R = np.array((0.0, 0.0, x / 2)), np.array([[1.0, 0, 0], [0, 0.0, -1], [0, 1, 0]])
    camera = view(eye, R)
    sheet = Rectangle((0.0, 0.0, x), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), GREY)
    eye, d = rays(camera)
    t = -eye[2] / np.where(d[2] < 0, d[2], -1.0)
    between = (d[2] < 0) & (t < 0.5)

    def leak(hidden: np.ndarray) -> float:
        return float((~hidden)[between].mean())

    found: dict[str, Error] = {PLAIN: leak(hidden_from_sun(written((FLOOR, sheet), merge=False), eye, d))}
    a, b, c = TO_SUN.tolist()
    for name, image in seen_by(Scene("gap", camera, (FLOOR, sheet), (Sun((a, b, c)),))).items():
        found[name] = None if image is None else leak(image.mean[..., 1].ravel() <= 0)
    return found


def merged(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """The floor at x beside a wall of height 1 under a sky: relative error of its radiance, a (1 + x/√(x² + 1)) / 2."""
    floor = Rectangle((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (0.0, 100.0, 0.0), GREY)
    wall = Rectangle((0.0, 0.0, 0.5), (0.0, 100.0, 0.0), (0.0, 0.0, 0.5), GREY)
    truth = 0.25 * (1 + x / hypot(x, 1))
    eye, d = np.array((x, 0.0, 1.5)), np.array((0.0, 0.0, -1.0))
    path, sky = {"type": "path", "max_depth": 2}, {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
    found: dict[str, Error] = {
        name: abs(radiance(written((floor, wall), sky, merge=merge), path, eye, d, n) / truth - 1)
        for name, merge in ((PLAIN, True), ("Mitsuba, optimize=False", False))
    }
    scene = Scene("wall", view(eye, side=16, width=1e-3), (floor, wall), (Sky((1.0, 1.0, 1.0)),))
    image = twin.render(scene, "sky", samples=max(n // 256, 2), cache=False)
    return found | {"raytwin's twin": abs(float(image.mean[..., 1].mean(dtype=float)) / truth - 1)}


def beyond(edge: float, share: float) -> Law:
    """Return a law that is 0 down to the edge and `share` below it."""
    return lambda x: share if x < edge else 0.0


TWIN, TRACER = "raytwin's twin", "raytwin's tracer"
MITSUBA = "Mitsuba 3.9"

EXPERIMENTS = (
    Experiment(
        "mitsuba-ground", "A ground sphere under the sun, seen from 2 m", "radius, m",
        "share of sunlit points in shade", 1e-3,
        decades(0, 8), ground, (TWIN, TRACER),
        "Mitsuba tests shadows against a sphere in float32, from the difference of the squares of its radius and of "
        "the point's distance, and starts the ray 9e-5 m off: from some 2000 m on, rounding is more. raytwin's twin "
        "meets such spheres in float64 itself; its tracer does not ask the ground about itself.",
        f"{MITSUBA}, shapes/sphere.cpp; Shirley, Ray Tracing in One Weekend, where every scene has such a ground",
        {PLAIN: lambda x: 0.5 * (U32 * x > 1500 * U32)}, trials=1,
    ),
    Experiment(
        "mitsuba-gap", "The shadow in a gap between two sheets", "width of the gap, m",
        "share of points that the sun reaches", 1e-3,
        decades(-1, -7, 2), gap, (TWIN, TRACER),
        "Mitsuba's rays start 9e-5 m off their surface wherever the eye is, so that they begin beyond a sheet that is "
        "nearer than this, and light comes through. The twin's world is 1024 times as large and its offset follows the "
        "distance from the eye; the tracer has none.",
        f"{MITSUBA}, render/interaction.h: offset_p", {PLAIN: beyond(1500 * U32, 1.0)}, trials=1,
    ),
    Experiment(
        "mitsuba-merge", "A floor beside a wall, under the sky", "distance / height of the wall",
        "relative error of radiance", 0.02,
        (2.0, 1.0, 0.5, 0.2, 0.1), merged, (TWIN,),
        "load_dict merges rectangles of one material unless told not to, and leaves the merged one out of the scene's "
        "bounding box: rays to the sky end too soon, and light comes through walls, silently. The twin loads with "
        "optimize=False.",
        f"{MITSUBA}, load_dict; Howell, A Catalog of Radiation Heat Transfer Configuration Factors", trials=1 << 16,
    ),
)  # fmt: skip
