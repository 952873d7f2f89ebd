"""What is met on a surface: how far off it the point lies, whether its shadow rays see right."""

from math import sqrt

import numpy as np

from raytwin.scene import Rectangle, Sphere
from raytwin.study.atlas.experiment import U32, U64, Error, Experiment, spaced
from raytwin.study.atlas.spheres import seen_at
from raytwin.tracer import STAGES, PlainWorld, intersect_rectangle, intersect_sphere, surface_at
from raytwin.tracer.arrays import dot, unit
from raytwin.tracer.hit import Facts
from raytwin.tracer.world import normal

GAMMA5 = 5 * U32 / (1 - 5 * U32)
"""pbrt's bound of what a point put back onto its sphere is off by, in radii."""

PBRT = "Pharr, Jakob and Humphreys, Physically Based Rendering (2023), section 6.8"


def off_surface(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    """How far off the sphere the points found lie, in radii: o + t d, and the same put back onto it."""
    rays = seen_at(max(x, 1.5), 0.9 * rng.random(n), rng)
    found: dict[str, Error] = {}
    kinds: tuple[type, ...] = np.float32, np.float64
    for kind in kinds:
        d: np.ndarray = np.asarray(rays.d, kind).T
        c: np.ndarray = np.asarray(rays.center, kind).T
        ball = Sphere((c[0], c[1], c[2]), kind(1))
        p = intersect_sphere((kind(0),) * 3, (d[0], d[1], d[2]), ball) * d
        back = unit(normal((p[0], p[1], p[2]), Facts(ball.center, *ball.facing, ball.albedo)))
        for name, point in (("o + t d", p.astype(float) - c.astype(float)), ("put back onto the sphere", back)):
            off = np.linalg.norm(np.stack(point).astype(float), axis=0) - 1
            found[f"{name}, {np.dtype(kind)}"] = float(np.abs(off).max())
    return found


# ------------------------------------------------------------------------------------------ shadow rays

SUN = (0.36, 0.48, 0.8)
GRAZING = 0.02
"""n · l of the shallowest shadow ray that is asked for."""

GAP, HALF = 1e-3, 0.1
"""Height and half side, in radii, of the sheet that floats over the sphere towards the sun."""

EPSILON = 1e-4
"""Metres: the fixed offset that many tracers use."""
OWN = "raytwin: not its own object"
MITSUBA = 1500 * U32
"""Mitsuba 3 starts rays at p + n (1 + max|p|) times this."""


def shadows(radius: float, place: np.ndarray, n: int, rng: np.random.Generator) -> dict[str, Error]:
    """The share of shadow rays that see wrongly: acne (the sphere shades itself), or a leak (the sheet is missed).

    A sphere at `place`, seen from three radii away at n points. raytwin sees it as it sees every scene, from the eye;
    the others work in the world's coordinates, as written, in float32.
    """
    sun, up, view = np.array(SUN), np.array([0.8, -0.6, 0.0]), np.array([0.6, 0.0, 0.8])
    across = np.stack([up, np.cross(sun, up)])
    # The truth, in float64 and in radii from the sphere's centre: where rays at random points of it meet it first.
    aim = rng.normal(size=(3, n))
    aim /= np.linalg.norm(aim, axis=0)
    d = aim - 3 * view[:, None]
    d /= np.linalg.norm(d, axis=0)
    b = 3 * view @ d
    normals_ = 3 * view[:, None] + (-b - np.sqrt(np.maximum(b * b - 8, 0))) * d
    steep, beside = sun @ normals_, across @ normals_
    hidden = (np.abs(beside) <= HALF).all(axis=0) & (steep > 0)
    asked = (b * b > 8.01) & (steep > GRAZING) & (np.abs(np.abs(beside) - HALF).min(axis=0) > 0.003)
    d, normals_, hidden = d[:, asked], normals_[:, asked], hidden[asked]

    def scene(origin: np.ndarray) -> tuple[Sphere, Rectangle]:
        center = place - origin
        floats = center, center + (1 + GAP) * radius * sun, *(HALF * radius * across)
        c, middle, u, v = ((float(x), float(y), float(z)) for x, y, z in floats)
        return Sphere(c, radius), Rectangle(middle, u, v)

    eye, ray, light = place + 3 * radius * view, d.astype(np.float32), sun.astype(np.float32)
    things = scene(eye)
    world = PlainWorld(things, STAGES)
    towards = (ray[0], ray[1], ray[2])
    t = intersect_sphere((np.float32(0),) * 3, towards, things[0])
    hit = surface_at(world, (np.float32(0),) * 3, towards, t, np.zeros(t.shape, int))
    wrong = {OWN: world.blocked(hit, (light[0], light[1], light[2])) != hidden}
    ball, sheet = scene(np.zeros(3))
    o = eye.astype(np.float32)
    p = np.stack([a + intersect_sphere((o[0], o[1], o[2]), towards, ball) * c for a, c in zip(o, towards, strict=True)])
    facing = normals_.astype(np.float32)
    reach = np.float32(MITSUBA) * (1 + np.abs(p).max(axis=0))
    for name, start, least in (
        ("no offset", p, 0.0), (f"t > {EPSILON:g}", p, EPSILON), ("Wächter and Binder", offset(p, facing), 0.0),
        ("Mitsuba's offset", p + facing * reach, 0.0),
    ):  # fmt: skip
        wrong[name] = blocked(start, light, ball, sheet, least) != hidden
    return {name: float(w.mean()) for name, w in wrong.items()}


def blocked(p: np.ndarray, to_sun: np.ndarray, ball: Sphere, sheet: Rectangle, least: float) -> np.ndarray:
    """Whether a ray from p meets anything at more than `least`, its own object too, all in float32."""
    light = tuple(np.broadcast_to(to_sun[:, None], p.shape))
    f = tuple(a - c for a, c in zip(p, ball.center, strict=True))
    h = dot((f[0], f[1], f[2]), (light[0], light[1], light[2]))
    away = np.stack([a - h * b for a, b in zip(f, light, strict=True)])
    root = np.sqrt(np.maximum(ball.radius**2 - (away * away).sum(axis=0), 0))
    own = (root > 0) & (np.maximum(-h - root, -h + root) > np.float32(least))
    other = intersect_rectangle((p[0], p[1], p[2]), (light[0], light[1], light[2]), sheet)
    return np.asarray(own | (np.isfinite(other) & (other > np.float32(least))))


def offset(p: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Wächter and Binder's: 256 n float32 steps away, or n / 65536 where a coordinate is below 1/32."""
    steps = (256 * n).astype(np.int32)
    moved = (p.view(np.int32) + np.where(p < 0, -steps, steps)).view(np.float32)
    return np.where(np.abs(p) < 1 / 32, p + n / np.float32(65536), moved)


def sized(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    return shadows(x, x * DIAGONAL, n, rng)


def moved(x: float, rng: np.random.Generator, n: int) -> dict[str, Error]:
    return shadows(1.0, x * DIAGONAL, n, rng)


DIAGONAL = np.array([0.6, 0.5, sqrt(1 - 0.61)])
"""Where scenes are moved: along no axis."""

SHEET = HALF**2 / 0.7
"""About the share of the points asked for that the sheet hides: of half a sphere, some not seen from the eye."""


def leaks(far: float) -> float:
    """The share of points whose rays start, or begin to look, `far` radii away, and so beyond the sheet: its height
    over the sphere is spread evenly from GAP to GAP + HALF²."""
    return SHEET * min(max((far - GAP) / HALF**2, 0.0), 1.0)


def acne(off: float, least: float) -> float:
    """Half of the points lie below the surface, by `off` or less; their shadow rays leave it `off` / (n · l) away."""
    return 0.5 * min(max(off / least - GRAZING, 0.0), 1.0)


STEP = 0.75 * 2.0**-23
"""The mean step from one float32 to the next, as a share of the number."""

BINDER = "Wächter and Binder, A Fast and Robust Method for Avoiding Self-Intersection, Ray Tracing Gems (2019), ch. 6"
SHARE = "share of shadow rays that see wrongly"

EXPERIMENTS = (
    Experiment(
        "hit-point", "How far off the surface a hit lies", "distance / radius", "distance from the surface, radii",
        GAMMA5, spaced(1, 1e6, 7), off_surface, ("o + t d, float64",),
        "The point o + t d inherits the rounding of the whole way t, so u D of it is wrong, where pbrt's bound γ(5) r "
        "is of the sphere's own size. Putting the point back onto the sphere meets the bound; raytwin, which asks no "
        "object about itself, needs it in float64 only.",
        PBRT, {"o + t d, float32": lambda x: 2 * U32 * x, "o + t d, float64": lambda x: 2 * U64 * x},
    ),
    Experiment(
        "shadow-large", "Shadow rays in a large scene", "radius of the sphere, m", SHARE, 1e-3, spaced(1, 1e5, 6),
        sized, (OWN,),
        "Half of the points lie below the surface by rounding, u times the way of the ray, and shade themselves: acne. "
        "A fixed distance that is passed over, t > 1e-4, stops helping where rounding outgrows it.",
        BINDER, {f"t > {EPSILON:g}": lambda x: acne(U32 * x / 2, EPSILON), "no offset": lambda x: 0.2},
        trials=10_000,
    ),
    Experiment(
        "shadow-small", "Shadow rays in a small scene", "radius of the sphere, m", SHARE, 1e-3, spaced(1, 1e-5, 6),
        sized, (OWN,),
        "What a shadow ray leaves out, or jumps over, it cannot see: a sheet a thousandth of a radius above the sphere "
        "is missed once that is less than the offset. All three offsets have a length built in, so all fail in a scene "
        "small enough.",
        BINDER,
        {f"t > {EPSILON:g}": lambda x: leaks(EPSILON / x), "Mitsuba's offset": lambda x: leaks(MITSUBA * (1 / x + 1)),
         "Wächter and Binder": lambda x: leaks(max(1 / 65536 / x, 256 * STEP))},
        trials=10_000,
    ),
    Experiment(
        "shadow-moved", "Shadow rays far from the origin", "distance from the origin, radii", SHARE, 1e-3,
        spaced(1, 1e6, 7), moved, (OWN,),
        "Far from the origin float32's steps are wide, and offsets that grow with them jump over what lies near, while "
        "a fixed one is drowned. raytwin puts the origin at the eye first, in float64, so that only the distance seen "
        "counts.",
        BINDER,
        {f"t > {EPSILON:g}": lambda x: acne(U32 * x / 8, EPSILON),
         "Mitsuba's offset": lambda x: leaks(0.6 * MITSUBA * x),
         "Wächter and Binder": lambda x: leaks(0.6 * 256 * STEP * x), "no offset": lambda x: 0.2},
        trials=10_000,
    ),
)  # fmt: skip
