"""What a tracer would show at chosen pixels if some of its functions were wrong: the textbook's, with mistakes in them.

A mistake is a tuple of steps (name, what). `name` is a function of the textbook, or `SPREAD`; `what` is slips in
its text, or a function that makes a wrong one of a correct one. A tracer is the tuple of all that is wrong in it, so
two mistakes are one tuple after the other. What a mistake leaves alone is computed once (`Predictor`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from raytwin import tracer
from raytwin.explain.textbook import FUNCTIONS, Changes, namespace, slipped
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene import Camera, Scene
from raytwin.scene.lens import newton_step

Array = np.ndarray
Pipeline = tuple[tuple[str, Any], ...]
SceneDict = dict[str, Any]
NO_MISTAKE: Pipeline = ()
"""The tracer as it should be."""
SPREAD = "spread"
"""A step beside the textbook's functions: the rays of a pixel. Any other name defines a function or number that slips
may use."""
FACES_AWAY = (("return visible", "return visible & (np.sum(normals * to_light, axis=-1) > 0)"),)
"""What faces away from the sun is in its own shadow, as where shadow rays start a little off the surface."""


class Seen(NamedTuple):
    """(N,) `ids` (-1: nothing), `cos` n·l, and `visible`, the sun."""

    ids: Array
    cos: Array
    visible: Array


def replaced(**functions: Callable[[Any], Any]) -> Pipeline:
    """A mistake of functions that make the wrong one of the correct one."""
    return tuple(functions.items())


def slip(function: str, *changes: tuple[str, str]) -> Pipeline:
    """A mistake of replacements (old, new) in the text of a function; of none, the textbook's text as it is."""
    return ((function, changes),)


def text_of(way: Pipeline) -> tuple[str, Changes] | None:
    """The function and the replacements that a mistake is made of; None where it is not one slip."""
    return way[0] if len(way) == 1 and way[0][0] in FUNCTIONS and isinstance(way[0][1], tuple) else None


def touches(pipeline: Pipeline, *names: str) -> bool:
    """Whether it has a step of these names."""
    return any(name in names for name, _ in pipeline)


def steps_of(pipeline: Pipeline, *names: str) -> Pipeline:
    """Its steps of these names, with the numbers that their text may have; empty where it has none of them."""
    if not touches(pipeline, *names):
        return NO_MISTAKE
    return tuple(step for step in pipeline if step[0] in names or step[0] not in (*FUNCTIONS, SPREAD))


def written(pipeline: Pipeline) -> dict[str, Any]:
    """The textbook's functions with these mistakes in them; correct ones converge and take all things at once.

    Raises ValueError for slips that exclude one another.
    """
    texts: dict[str, Changes] = {}
    for name, what in pipeline:
        if isinstance(what, tuple):
            texts[name] = (*texts.get(name, ()), *what)
    texts.setdefault("sun_visible", FACES_AWAY)
    space = namespace(slipped(name, texts.get(name, ())) for name in FUNCTIONS)
    forms = {
        "undistort": _undistort,
        "normals_at": _normals_at,
        "intersect_all": partial(_intersect_all, space),
    }
    space |= {name: form for name, form in forms.items() if name not in texts}
    for name, what in pipeline:
        if name != SPREAD and not isinstance(what, tuple):
            space[name] = what(space.get(name))
    return space


DEPENDS = {
    "through": ("undistort", "through"),
    "intersect_all": ("intersect_sphere", "intersect_plane", "intersect_all"),
    "normals_at": ("normals_at",),
    "sun_visible": ("sun_visible", "intersect_sphere", "intersect_plane", "intersect_all"),
}
"""Functions whose results stay for other tracers -> the functions that they are made by."""
CACHED = 12
"""Results of wrong functions that stay for the next tracer."""


@lru_cache(maxsize=64)
def as_dict(scene: Scene, shadows: bool) -> SceneDict:
    """The contract's dict, with `things`: all objects in the scene's order."""
    made = as_arrays(scene, "shadow" if shadows else "lambert")
    return made | {"things": [*made["spheres"], *made["planes"]]}


QUIET = np.errstate(all="ignore")
"""Misses divide by 0 and take the root of negative numbers."""


@dataclass(eq=False)
class Predictor:
    """Predict what tracers show of one scene at chosen pixels. `memory`: what functions gave lately, by mistakes."""

    scene: Scene
    u: Array
    v: Array
    shadows: bool = True
    brightest: float = 1.0
    memory: dict[tuple[str, Pipeline], list[tuple[Any, Any]]] = field(default_factory=dict)

    @property
    def camera(self) -> Camera:
        return self.scene.camera

    def at(self, u: Array, v: Array) -> "Predictor":
        """The same at other pixels."""
        return Predictor(self.scene, u, v, self.shadows, self.brightest)

    def described(self, pipeline: Pipeline) -> SceneDict:
        """The scene as this tracer takes it."""

        def described() -> SceneDict:
            scene, things = written(changes)["read_scene"](made, made["things"])
            return scene | {"things": things}

        changes, made = steps_of(pipeline, "read_scene"), as_dict(self.scene, self.shadows)
        return self._remembered("scene", changes, described) if changes else made

    def functions(self, pipeline: Pipeline) -> dict[str, Any]:
        """Those of this tracer; what they give for the same arguments is not computed again."""
        space = written(pipeline)
        for name, causes in DEPENDS.items():
            space[name] = partial(self._remembered, name, steps_of(pipeline, *causes), space[name])
        return space

    @QUIET
    def _remembered(self, name: str, mistakes: Pipeline, function: Callable[..., Any], *args: Any) -> Any:
        key = name, mistakes
        store = self.memory.setdefault(key, [])
        for given, result in store:
            if all(map(_same, given, args)):
                return result
        made = function(*args)
        if isinstance(made, np.ndarray):
            made.flags.writeable = False
        store.append((args, made))
        del store[:-2]
        wrong = [k for k in self.memory if k[1]] if key[1] else []
        for old in wrong[:-CACHED]:
            del self.memory[old]
        return made

    def place(self, pipeline: Pipeline = NO_MISTAKE) -> tuple[Array, Array]:
        """Where in the image its rays go."""
        u, v = written(pipeline)["pixel"](self.u, self.v, *self.camera.image_size)
        return np.broadcast_to(u, self.u.shape), np.broadcast_to(v, self.u.shape)

    def _met(self, scene: SceneDict, space: dict[str, Any]) -> Any:
        """The eye; which thing each ray meets; where, not finite for none."""
        u, v = space["pixel"](self.u, self.v, scene["width"], scene["height"])
        rays = space["through"](scene["K"], scene["dist"], u, v)
        return space["met"](rays, scene, scene["things"])

    @QUIET
    def seen(self, pipeline: Pipeline = NO_MISTAKE) -> Seen:
        """What the eye's rays meet first, and how the sun falls on it."""
        scene, space = self.described(pipeline), self.functions(pipeline)
        eye, which, points = self._met(scene, space)
        things, to_light, hit = scene["things"], scene["sun"]["to_light"], which >= 0
        normals, visible = np.zeros(points.shape), np.ones(len(which), bool)
        if hit.any():
            normals[hit] = space["normals_at"](points[hit], which[hit], eye, things)
            if self.shadows and scene["sun"]["irradiance"].any():
                visible[hit] = space["sun_visible"](points[hit], normals[hit], which[hit], to_light, eye, things)
        return Seen(which, normals @ to_light, visible)

    @QUIET
    def radiance(self, pipeline: Pipeline = NO_MISTAKE) -> Array:
        """(N, 3), before output: the mean over all rays of a pixel."""
        if touches(pipeline, SPREAD):
            one = tuple(step for step in pipeline if step[0] != SPREAD)
            places = next(what for name, what in pipeline if name == SPREAD)
            rays = [self.at(self.u + x, self.v + y).radiance(one) for x, y in places]
            return np.asarray(sum(rays) / len(rays))
        scene, space = self.described(pipeline), self.functions(pipeline)
        eye, which, points = self._met(scene, space)
        return np.asarray(space["radiance"](scene, scene["things"], eye, which, points), float)

    @QUIET
    def picture(self, pipeline: Pipeline = NO_MISTAKE) -> Array:
        """(N, 3), the values that are handed in."""
        return output(pipeline, self.radiance(pipeline), self.brightest)

    @QUIET
    def points(self, pipeline: Pipeline = NO_MISTAKE) -> Array:
        """(N, 3) where each ray first meets an object, NaN for none."""
        _, which, points = self._met(self.described(pipeline), self.functions(pipeline))
        return np.where((which >= 0)[:, None], points, np.nan)


def output(pipeline: Pipeline, radiance: Array, brightest: float) -> Array:
    """The values that a tracer with these mistakes hands in."""
    steps = steps_of(pipeline, "hand_in")
    return np.asarray(written(steps)["hand_in"](radiance, brightest), float) if steps else radiance


def _same(a: Any, b: Any) -> bool:
    return a is b or (isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b))


def predictor(scene: Scene, shadows: bool = True, every: int = 1) -> Predictor:
    """Return a predictor for all pixels of a scene, row by row, or every `every`-th; it knows the brightest value."""
    v, u = np.indices((scene.camera.height, scene.camera.width), float).reshape(2, -1)[:, ::every]
    made = Predictor(scene, u, v, shadows)
    made.brightest = float(made.radiance().max(initial=0.0)) or 1.0
    return made


@dataclass(eq=False)
class UnknownScene:
    """Correct pictures (H, W, 3) of nobody knows which scene: their pixels can be moved, and their values changed.

    `pictures`: the correct one, and where a format rounds it, the least and the largest that are stored as this one.
    """

    pictures: tuple[Array, ...]
    u: Array
    v: Array
    brightest: float = 1.0

    def radiances(self, pipeline: Pipeline = NO_MISTAKE) -> list[Array]:
        """(N, 3) of each, before output; NaN beyond the picture."""
        h, w = self.pictures[0].shape[:2]
        u, v = (np.rint(x).astype(int) for x in written(pipeline)["pixel"](self.u, self.v, w, h))
        there = ((u >= 0) & (u < w) & (v >= 0) & (v < h))[:, None]
        return [np.where(there, one[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)], np.nan) for one in self.pictures]


# --------------------------------------------------------------------------------- faster forms, equal to rounding


def _undistort(xd: Array, yd: Array, dist: Array) -> tuple[Array, Array]:
    """The tracer's own way back through the lens, ended where nothing moves any more."""
    if not np.any(dist):
        return xd, yd
    x, y = tracer.undistort(xd, yd, dist.tolist(), steps=4)
    for _ in range(12):
        dx, dy = newton_step(x, y, xd, yd, dist.tolist())
        x, y = x + dx, y + dy
        if max(np.abs(dx).max(initial=0.0), np.abs(dy).max(initial=0.0)) < 1e-8:  # the error is that, squared
            break
    return x, y


def _intersect_all(space: dict[str, Any], origins: Array, directions: Array, things: Any) -> Array:
    """t (objects, N); the text works on spheres in a further axis as well, unless a slip in it does not."""
    t = np.full((max(1, len(things)), len(origins)), np.inf)
    balls = [k for k, thing in enumerate(things) if "radius" in thing]
    if balls:
        solve = space["intersect_sphere"]
        centers, radii = (np.array([things[k][name] for k in balls])[:, None] for name in ("center", "radius"))
        try:
            found = np.asarray(solve(origins, directions, centers, radii), float)
        except (ValueError, IndexError):
            found = np.empty(0)
        if found.shape != (len(balls), len(origins)):
            found = np.stack([solve(origins, directions, things[k]["center"], things[k]["radius"]) for k in balls])
        t[balls] = found
    for k, thing in enumerate(things):
        if "radius" not in thing:
            t[k] = space["intersect_plane"](origins, directions, thing["center"], thing["half_u"], thing["half_v"])
    t[np.isnan(t)] = np.inf
    return t


def _normals_at(points: Array, which: Array, eye: Array, things: Any) -> Array:
    """All objects at once. A sphere's normal is turned only where the eye is inside it: most students never turn it."""
    none, table = (np.zeros(3), np.inf, np.zeros(3)), []
    for thing in things:
        if "radius" in thing:
            table.append((thing["center"], thing["radius"], np.zeros(3)))
        else:
            n = np.cross(thing["half_u"], thing["half_v"])
            table.append((np.zeros(3), np.inf, n / np.linalg.norm(n)))
    centers, radii, flats = (np.array(column)[which] for column in zip(*table, none, strict=True))
    f = points - centers
    n = np.where(np.isfinite(radii)[:, None], f / radii[:, None], flats)
    turns = np.isinf(radii) | (np.linalg.norm(eye - centers, axis=-1) <= radii)
    away = turns & ~(np.sum(n * (eye - points), axis=-1) > 0)
    return np.where(away[:, None], -n, n)
