"""What a tracer would show at chosen pixels if one of its steps were wrong: the tracer again, in finer steps.

    pixel -> place -> undo -> ray -> sphere, rectangle -> order -> point -> normal -> visible -> shade -> output

`raytwin.tracer.Stages` has the steps that a learner replaces; a mistake sits within one of them, so here they are cut
smaller. All is in the board's frame, float64, vectors (3, N), N chosen pixels. A fault is a change of `Steps`; two
faults are one change after the other. What a change leaves alone is computed once (`Bench`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import pi
from typing import Any, NamedTuple

import msgspec
import numpy as np

from raytwin.scene import Camera, Rectangle, Scene, Shape, Sphere
from raytwin.tracer import intersect_rectangle, intersect_sphere, sample_cosine_hemisphere, undistort

Array = np.ndarray


class Rays(NamedTuple):
    """`origin` (3, 1); `d` (3, N): what solvers are given; `aim` (3, N): what t is applied to, both `d` where right.

    `stretch` (N,): the length of (x, y, 1), by which t is smaller for rays that are not made unit.
    """

    origin: Array
    d: Array
    aim: Array
    stretch: Array


class Hits(NamedTuple):
    """(N,) `ids` (-1: nothing) and `t`; (3, N) `point`, `normal`, `albedo`; (3,) `eye`."""

    ids: Array
    t: Array
    point: Array
    normal: Array
    albedo: Array
    eye: Array


class Terms(NamedTuple):
    """What shading is made of: `to` (3, 1) or (3, N), l; `cos` n·l (N,), not clamped; `visible` (N,); `irradiance`,
    `sky` (3, 1)."""

    albedo: Array
    to: Array
    cos: Array
    visible: Array
    irradiance: Array
    sky: Array
    hits: Hits
    scene: Scene
    shadows: bool


class Steps(NamedTuple):
    """The tracer's steps as data, finer than `tracer.Stages`; `RIGHT` is the right tracer.

    `through`, `to_board`, `intersect_all`, `normals_at`, `mixed`: functions of the textbook (`mixed`: its `radiance`)
    that do what several of these steps do, with a slip in them; None where the steps do it. `texts`: each function of
    the textbook that has slips in it, and these.
    """

    place: Callable[[Array, Array, Camera], tuple[Array, Array]]
    lens: Callable[[Camera], Camera]
    undo: Callable[[Array, Array, Any], tuple[Array, Array]]
    ray: Callable[[Array, Array, Camera], Rays]
    camera: Callable[[Camera], Camera]
    through: Callable[..., Any] | None
    to_board: Callable[..., Any] | None
    objects: Callable[[tuple[Shape, ...], Camera], tuple[Shape, ...]]
    sphere: Callable[[Any, Any, Sphere], Any]
    rectangle: Callable[[Any, Any, Rectangle], Any]
    intersect_all: Callable[..., Any] | None
    order: Callable[[Array, tuple[Shape, ...], Rays], Array]
    point: Callable[[Rays, Array], Array]
    normal: Callable[[Array, Rays, Shape], Array]
    normals_at: Callable[..., Any] | None
    light: Callable[[Array, Scene, Hits], Array]
    shadows: Callable[[bool], bool]
    blocked: Callable[..., Array]
    prepare: Callable[[Terms], Terms]
    shade: Callable[[Terms], Array]
    background: Callable[[Scene, Array], Array]
    output: Callable[[Array, float], Array]
    gather: Callable[["Walks"], Array]
    spread: tuple[tuple[float, float], ...]
    earlier: Callable[[Scene, "Before"], Scene]
    mixed: Callable[..., Any] | None
    texts: tuple[tuple[str, Any], ...]


class Before(NamedTuple):
    """`calls`: the stage and the scene of each that a process was given before, in order; `stage`: of this one."""

    stage: str = ""
    calls: tuple[tuple[str, Scene], ...] = ()


FIRST = Before()


class Walks(NamedTuple):
    """Light followed from S random walks a pixel, by the surfaces k = 0, 1, ... that each met.

    `weight` (K, 3, N, S): the product of the albedos up to k; `cos` (K, N, S): of the direction that leaves k; `sun`
    (K, 3, N, S): E/π V max(0, n·l) there; `sky` (K, 3, N, S): its radiance where the walk leaves the scene.
    """

    weight: Array
    cos: Array
    sun: Array
    sky: Array


def gathered(walks: Walks) -> Array:
    """Σ weight (sun + sky), the mean over walks: (N, 3). Directions have density cos/π, which cancels cosine and π."""
    return np.asarray((walks.weight * (walks.sun + walks.sky)).sum(axis=0).mean(axis=-1).T)


def undo(xd: Array, yd: Array, dist: Any) -> tuple[Array, Array]:
    """The tracer's own way back through the lens, ended where nothing moves any more."""
    x, y = undistort(xd, yd, dist, steps=5)
    for _ in range(5):
        further = undistort(xd, yd, dist, (x, y), steps=3)
        moved = max(np.abs(further[0] - x).max(initial=0.0), np.abs(further[1] - y).max(initial=0.0))
        x, y = further
        if moved < 1e-13:
            break
    return x, y


def direct_ray(x: Array, y: Array, camera: Camera) -> Rays:
    """(x, y, 1) made unit and turned to the board's axes, from the camera's centre."""
    d = np.stack([x, y, np.ones_like(x)])
    length = np.linalg.norm(d, axis=0)
    d = np.asarray(camera.R_cam_board).T @ (d / length)
    return Rays(np.array(camera.eye)[:, None], d, d, length)


def on_sphere(origin: Any, d: Any, sphere: Sphere, solver: str = "robust") -> Array:
    """The tracer's own solver."""
    return np.asarray(intersect_sphere(tuple(origin), tuple(d), sphere, solver))


def on_rectangle(origin: Any, d: Any, rectangle: Rectangle) -> Array:
    return np.asarray(intersect_rectangle(tuple(origin), tuple(d), rectangle))


def nearest(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
    """Return the index of the least t of (K, N), -1 where none is finite."""
    return np.where(np.isfinite(t).any(axis=0), t.argmin(axis=0), -1)


def along(rays: Rays, t: Array) -> Array:
    """origin + t d."""
    return rays.origin + t * rays.aim


def outward(point: Array, rays: Rays, thing: Shape) -> Array:
    """(p - center) / r of a sphere; a rectangle's own, to the side of the eye."""
    if isinstance(thing, Sphere):
        return (point - np.array(thing.center)[:, None]) / thing.radius
    n = np.array(thing.normal)[:, None]
    return np.where((n * rays.d).sum(axis=0) > 0, -n, n)


def to_sun(to: Array, scene: Scene, hits: Hits) -> Array:
    """The sun is far away: one direction (3, 1) for all."""
    return to


def hidden(hits: Hits, to: Array, things: tuple[Shape, ...], steps: "Steps") -> Array:
    """(N,) bool: another object lies on the way along the light, or the point faces away from it."""
    return others_hide(hits, to, things, steps) | ((hits.normal * to).sum(axis=0) <= 0)


def others_hide(hits: Hits, to: Array, things: tuple[Shape, ...], steps: "Steps") -> Array:
    """(N,) bool: another object than the point's own lies on the way along l."""
    met = np.isfinite(meet_all(hits.point, np.broadcast_to(to, hits.point.shape), things, steps))
    return np.asarray((met & (hits.ids != np.arange(len(things))[:, None])).any(axis=0))


def lambert(terms: Terms) -> Array:
    """albedo/π E V max(0, n·l) + albedo Lₛ."""
    sun = terms.albedo / pi * terms.irradiance * terms.visible * np.maximum(terms.cos, 0)
    return sun + terms.albedo * terms.sky


RIGHT = Steps(
    place=lambda u, v, camera: (u, v),
    lens=lambda camera: camera,
    undo=undo,
    ray=direct_ray,
    camera=lambda camera: camera,
    through=None,
    to_board=None,
    objects=lambda things, camera: things,
    sphere=on_sphere,
    rectangle=on_rectangle,
    intersect_all=None,
    order=nearest,
    point=along,
    normal=outward,
    normals_at=None,
    light=to_sun,
    shadows=lambda asked: asked,
    blocked=hidden,
    prepare=lambda terms: terms,
    shade=lambert,
    background=lambda scene, d: np.array(scene.sky.radiance)[:, None],
    output=lambda radiance, brightest: radiance,
    gather=gathered,
    spread=((0.0, 0.0),),
    earlier=lambda scene, before: scene,
    mixed=None,
    texts=(),
)
"""The tracer as it should be."""

Change = Callable[[Steps], Steps]
KEPT = 10
"""Intermediate results of wrong tracers that are kept for the next."""


def meet(origin: Array, d: Array, thing: Shape, steps: Steps) -> Array:
    """t along d, infinity for a miss."""
    if isinstance(thing, Sphere):
        return np.asarray(steps.sphere(origin, d, thing))
    return np.asarray(steps.rectangle(origin, d, thing))


def meet_all(origin: Array, d: Array, things: Sequence[Shape], steps: Steps) -> Array:
    """The same of all things, (K, N): the tracer's own solvers take all of a kind at once, as one of columns (K, 1)."""
    if steps.intersect_all is not None:
        starts = np.broadcast_to(origin, d.shape).T
        return np.asarray(steps.intersect_all(starts, d.T, as_dicts(tuple(things))), float)[: len(things)]
    t = np.full((len(things), d.shape[1]), np.inf)
    for kind, own, names in (
        (Sphere, steps.sphere is on_sphere, ("center", "radius")),
        (Rectangle, steps.rectangle is on_rectangle, ("center", "half_u", "half_v")),
    ):
        here = [i for i, thing in enumerate(things) if isinstance(thing, kind)]
        at_once = getattr(steps.sphere, "all_at_once", None)
        if kind is Sphere and at_once is not None and here:
            t[here] = at_once(origin, d, [things[i] for i in here])
        elif own and len(here) > 1:
            columns = {name: np.array([getattr(things[i], name) for i in here]).T[..., None] for name in names}
            all_of_them = {name: tuple(x) if x.ndim == 3 else x for name, x in columns.items()}
            t[here] = meet(origin, d, msgspec.structs.replace(things[here[0]], **all_of_them), steps)
        else:
            for i in here:
                t[i] = meet(origin, d, things[i], steps)
    return t


@lru_cache(maxsize=64)
def as_dicts(things: tuple[Shape, ...]) -> list[dict[str, Any]]:
    """The things as the contract has them."""
    made: list[dict[str, Any]] = []
    for x in things:
        names = ("center", "radius") if isinstance(x, Sphere) else ("center", "half_u", "half_v")
        made.append({name: np.array(getattr(x, name)) for name in names} | {"albedo": np.array(x.material.albedo)})
    return made


@dataclass(frozen=True, eq=False)
class Table:
    """K things and, in the last row, none: `albedo`, `center`, `facing` (a rectangle's normal) (K + 1, 3); `radius`
    (K + 1,), infinite for a rectangle."""

    albedo: Array
    center: Array
    facing: Array
    radius: Array

    def outward(self, point: Array, d: Array, ids: Array) -> Array:
        """(3, N): `outward` of all points at once, 0 where nothing is met."""
        flat = self.facing[ids].T
        flat = np.where((flat * d).sum(axis=0) > 0, -flat, flat)
        ball = np.isfinite(self.radius[ids])
        with np.errstate(invalid="ignore"):
            return np.where(ball, (point - self.center[ids].T) / self.radius[ids], flat)


@lru_cache(maxsize=64)
def table_of(things: tuple[Shape, ...]) -> Table:
    none = (0.0, 0.0, 0.0)
    return Table(
        np.array([*(x.material.albedo for x in things), none], float),
        np.array([*(x.center for x in things), none], float),
        np.array([*(x.normal if isinstance(x, Rectangle) else none for x in things), none], float),
        np.array([*(x.radius if isinstance(x, Sphere) else np.inf for x in things), np.inf], float),
    )


@dataclass(eq=False)
class Bench:
    """One scene at chosen pixels, on which changes are tried; what was found last stays, by the steps that made it.

    `right`: what the lens of the scene gives, for good. `before`: what may have stayed of other scenes.
    """

    scene: Scene
    u: Array
    v: Array
    shadows: bool = True
    brightest: float = 1.0
    kept: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    right: dict[str, Any] = field(default_factory=dict)
    before: Before = FIRST

    @property
    def camera(self) -> Camera:
        return self.scene.camera

    def at(self, u: Array, v: Array) -> "Bench":
        """The same at other pixels."""
        return Bench(self.scene, u, v, self.shadows, self.brightest, before=self.before)

    def of(self, steps: Steps) -> "Bench":
        """The same on the scene that is left of this one and earlier ones."""
        if not self.before.calls or (scene := steps.earlier(self.scene, self.before)) is self.scene:
            return self
        key = ("of", steps.earlier)
        if key not in self.kept:
            self.keep(key, Bench(scene, self.u, self.v, self.shadows, self.brightest))
        return self.kept[key]

    def rays(self, steps: Steps) -> Rays:
        key = ("rays", *steps[:7])
        if key not in self.kept:
            lens = steps.camera(self.scene.camera)
            u, v = steps.place(self.u, self.v, self.scene.camera)
            seen = steps.lens(lens)
            if steps.through is not None or steps.to_board is not None:
                self.keep(key, self._written_rays(steps, seen, u, v))
                return self.kept[key]
            # What a pose or another ray leaves alone: the lens of the scene's own K and coefficients.
            own = seen.K == self.camera.K and seen.dist == self.camera.dist
            own = own and steps.place is RIGHT.place and steps.undo is RIGHT.undo
            if own and "xy" in self.right:
                x, y = self.right["xy"]
            else:
                x, y = (u - seen.cx) / seen.fx, (v - seen.cy) / seen.fy
                if any(seen.coefficients):
                    x, y = steps.undo(x, y, seen.coefficients)
                if own:
                    self.right["xy"] = x, y
            self.keep(key, steps.ray(x, y, lens))
        return self.kept[key]

    def _written_rays(self, steps: Steps, camera: Camera, u: Array, v: Array) -> Rays:
        """Those of the textbook's functions."""
        R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)
        if steps.through is None:
            right = self.rays(steps._replace(to_board=None, camera=RIGHT.camera))
            rays = (np.asarray(self.camera.R_cam_board) @ right.d).T
        else:
            rays = steps.through(np.array(camera.K), np.array(camera.coefficients), u, v, steps.undo)
            unit = np.abs(np.square(rays).sum(axis=-1) - 1).max() < 1e-12 and (rays[:, 2] > 0).all()
            if steps.to_board is None and unit:  # as usual from here on
                return steps.ray(rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2], camera)
        eye, d = steps.to_board(rays, R, t) if steps.to_board is not None else (np.array(camera.eye), rays @ R)
        d = np.asarray(d, float).T
        return Rays(np.asarray(eye, float)[:, None], d, d, np.linalg.norm(d, axis=0))

    def distances(self, steps: Steps) -> Array:
        """(K, N): t along each ray of the eye to each thing, infinity for a miss."""
        key = ("t", *steps[:11])
        if key not in self.kept:
            rays, things = self.rays(steps), self.things(steps)
            t = meet_all(rays.origin, rays.d, things, steps) if things else np.full((1, self.u.size), np.inf)
            t[np.isnan(t)] = np.inf
            self.keep(key, t)
        return self.kept[key]

    def met(self, steps: Steps) -> tuple[Array, Array]:
        """The index of what each ray of the eye meets first, -1 for nothing, and its t."""
        key = ("met", *steps[:12])
        if key not in self.kept:
            rays, things, t = self.rays(steps), self.things(steps), self.distances(steps)
            ids = steps.order(t, things, rays) if things else np.full(self.u.size, -1)
            reach = np.where(ids >= 0, np.take_along_axis(t, np.maximum(ids, 0)[None], 0)[0], 0.0)
            self.keep(key, (ids, np.where(np.isfinite(reach), reach, 0.0)))
        return self.kept[key]

    def keep(self, key: tuple[Any, ...], value: Any) -> None:
        """The right tracer's for good, and the last few others."""
        self.kept[key] = value
        for old in [k for k in self.kept if k[0] != "walks" and k[1:] != RIGHT[: len(k) - 1]][:-KEPT]:
            del self.kept[old]

    def things(self, steps: Steps) -> tuple[Shape, ...]:
        return steps.objects(self.scene.objects, self.camera)

    def hits(self, steps: Steps) -> Hits:
        """What the eye's rays meet first, and its normal and albedo."""
        key = ("hits", *steps[:15])
        if key not in self.kept:
            rays, things = self.rays(steps), self.things(steps)
            ids, reach = self.met(steps)
            point, table = steps.point(rays, reach), table_of(things)
            if steps.normals_at is not None:
                eye = rays.origin[:, 0]
                normal = np.asarray(steps.normals_at(point.T, ids, eye, as_dicts(things)), float).T
            elif steps.normal is outward:
                normal = table.outward(point, rays.d, ids)
            else:
                normal = np.zeros((3, ids.size))
                for index, thing in enumerate(things):
                    if (here := ids == index).any():
                        part = Rays(rays.origin, rays.d[:, here], rays.aim[:, here], rays.stretch[here])
                        normal[:, here] = steps.normal(point[:, here], part, thing)
            self.keep(key, Hits(ids, reach, point, normal, table.albedo[ids].T, rays.origin[:, 0]))
        return self.kept[key]

    def terms(self, steps: Steps) -> Terms:
        key = ("terms", *steps[:18])
        if key not in self.kept:
            hits, sun = self.hits(steps), self.scene.sun
            to = steps.light(np.array(sun.to_light)[:, None], self.scene, hits)
            visible = np.ones(hits.t.shape)
            if steps.shadows(self.shadows) and any(sun.irradiance):
                visible = np.where(steps.blocked(hits, to, self.things(steps), steps), 0.0, 1.0)
            cos, E, sky = (hits.normal * to).sum(axis=0), sun.irradiance, self.scene.sky.radiance
            E3, sky3 = np.array(E)[:, None], np.array(sky)[:, None]
            self.keep(key, Terms(hits.albedo, to, cos, visible, E3, sky3, hits, self.scene, self.shadows))
        return self.kept[key]

    def walks(self, samples: int, depth: int, seed: int = 1) -> Walks:
        """Random walks of the right tracer, up to so many surfaces."""
        key = ("walks", samples, depth)
        if key not in self.kept:
            rng, start = np.random.default_rng(seed), self.hits(RIGHT)
            n = start.t.size * samples
            many = lambda x: np.repeat(x, samples, axis=-1)  # noqa: E731
            point, normal, ids, weight = many(start.point), many(start.normal), many(start.ids), np.ones((3, n))
            albedo, rows = many(start.albedo), []
            to = np.array(self.scene.sun.to_light)[:, None]
            E, sky = (np.array(x)[:, None] for x in (self.scene.sun.irradiance, self.scene.sky.radiance))
            table = np.array([*(x.material.albedo for x in self.scene.objects), (0.0, 0.0, 0.0)])
            for _ in range(depth):
                weight = weight * albedo
                hits = Hits(ids, np.zeros(n), point, normal, albedo, start.eye)
                cos = (normal * to).sum(axis=0)
                sun = E / pi * np.where(hidden(hits, to, self.scene.objects, RIGHT), 0.0, np.maximum(cos, 0))
                d = np.stack(sample_cosine_hemisphere(tuple(normal), *rng.random((2, n))))
                t = meet_all(point, d, self.scene.objects, RIGHT)
                t[np.maximum(ids, 0), np.arange(n)] = np.inf  # convex: not met again from outside
                after = np.where(ids >= 0, nearest(t, self.scene.objects, Rays(point, d, d, np.ones(n))), -1)
                gone = (after < 0) & (ids >= 0)
                rows.append((weight, np.maximum((normal * d).sum(axis=0), 0), sun * (ids >= 0), sky * gone))
                reach = np.where(after >= 0, t[np.maximum(after, 0), np.arange(n)], 0.0)
                point, ids, albedo, normal = point + reach * d, after, table[after].T, np.zeros((3, n))
                for index, thing in enumerate(self.scene.objects):
                    here = ids == index
                    part = Rays(point[:, here], d[:, here], d[:, here], np.ones(here.sum()))
                    normal[:, here] = outward(point[:, here], part, thing)
            size = start.t.size, samples
            weights, cosines, suns, skies = (np.stack(column) for column in zip(*rows, strict=True))
            light = (x.reshape(depth, 3, *size) for x in (suns, skies))
            self.kept[key] = Walks(weights.reshape(depth, 3, *size), cosines.reshape(depth, *size), *light)
        return self.kept[key]

    def radiance(self, steps: Steps) -> Array:
        """(N, 3), before output: the mean over all rays of a pixel."""
        if steps.spread != RIGHT.spread:
            one = steps._replace(spread=RIGHT.spread)
            rays = [self.at(self.u + x, self.v + y).radiance(one) for x, y in steps.spread]
            return np.asarray(sum(rays) / len(rays))
        seen = self.of(steps)
        terms = seen.terms(steps)
        if steps.mixed is not None:
            return np.asarray(steps.mixed(seen, steps, terms), float)
        behind = np.broadcast_to(steps.background(seen.scene, seen.rays(steps).d), terms.albedo.shape)
        return np.where(terms.hits.ids >= 0, steps.shade(steps.prepare(terms)), behind).T

    def points(self, steps: Steps) -> Array:
        """(N, 3) where each ray first meets a sphere, NaN for none."""
        hits = self.of(steps).hits(steps)
        return np.where(hits.ids >= 0, hits.point, np.nan).T


@dataclass(eq=False)
class Plain:
    """A right picture (H, W, 3) of nobody knows which scene: its pixels can be moved, and its values changed."""

    right: Array
    u: Array
    v: Array
    brightest: float = 1.0

    @property
    def camera(self) -> Camera:
        """A camera of the picture's size; nothing else of it is known."""
        h, w = self.right.shape[:2]
        K = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        return Camera((w, h), K, K, (0.0, 0.0, 0.0))

    def at(self, u: Array, v: Array) -> "Plain":
        return Plain(self.right, u, v, self.brightest)

    def radiance(self, steps: Steps) -> Array:
        """(N, 3), before output; NaN beyond the picture."""
        h, w = self.right.shape[:2]
        u, v = (np.rint(x).astype(int) for x in steps.place(self.u, self.v, self.camera))
        there = (u >= 0) & (u < w) & (v >= 0) & (v < h)
        return np.where(there[:, None], self.right[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)], np.nan)
