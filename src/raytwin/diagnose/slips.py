"""Slips in the textbook's text as changes of the tracer's steps: what a picture shows of them can be predicted.

`slip` makes a change of one function's text. The functions call one another as the steps have them, so that a slip and
another mistake can be put into one tracer, one after the other.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np

from raytwin.diagnose.predict import (
    RIGHT,
    Array,
    Bench,
    Change,
    Hits,
    Rays,
    Steps,
    Terms,
    as_dicts,
    hidden,
    lambert,
    meet_all,
)
from raytwin.diagnose.textbook import Changes, tracer_with
from raytwin.scene import Camera, Rectangle, Shape, Sphere

Function = Callable[..., Any]


@lru_cache(maxsize=4096)
def wrong(function: str, changes: Changes) -> Function:
    """The textbook's function with these slips in it."""
    made: Function = getattr(tracer_with(changes=changes), function)
    return made


def slip(function: str, *changes: tuple[str, str]) -> Change:
    """The textbook's function with these replacements (old, new) in its text, in the place of the tracer's own."""
    return partial(_changed, function=function, changes=changes)


def slips(function: str, *texts: str) -> tuple[Change, ...]:
    """A way for each text, `old => new`, several of which are joined by ` ;; `."""
    return tuple(slip(function, *map(_old_and_new, text.split(" ;; ") if text else ())) for text in texts)


def text_of(way: Change) -> tuple[str, Changes] | None:
    """The function and the replacements that a way is made of; None where it is not one slip."""
    if isinstance(way, partial) and way.func is _changed:
        return way.keywords["function"], way.keywords["changes"]
    return None


def _old_and_new(text: str) -> tuple[str, str]:
    old, _, new = text.partition(" => ")
    return old, new


def _changed(steps: Steps, function: str, changes: Changes) -> Steps:
    """The slips of this function that the steps have already stay, unless they exclude the new ones."""
    before = dict(steps.texts).get(function, ())
    for both in ((*before, *changes), (*changes, *before), changes):
        try:
            made = AS_STEP[function](steps, wrong(function, both))
        except ValueError:
            continue
        others = tuple(one for one in steps.texts if one[0] != function)
        return made._replace(texts=(*others, (function, both)))
    raise ValueError(f"{function}: {changes}")


# ------------------------------------------------------------------------------------------ one function, as a step


def _pixels(steps: Steps, f: Function) -> Steps:
    def place(u: Array, v: Array, camera: Camera) -> tuple[Array, Array]:
        u, v = steps.place(u, v, camera)
        rows, columns = (np.clip(np.rint(k), 0, n - 1).astype(int) for k, n in ((v, camera.height), (u, camera.width)))
        there = [np.broadcast_to(k, (camera.height, camera.width))[rows, columns] for k in f(*camera.image_size)]
        return there[0] + (u - columns), there[1] + (v - rows)

    return steps._replace(place=place)


def _through(steps: Steps, f: Function) -> Steps:
    def through(K: Array, dist: Array, u: Array, v: Array, undo: Function) -> Array:
        f.__globals__["undistort"] = undo
        return np.asarray(f(K, dist, u, v), float)

    return steps._replace(through=through)


def _undistort(steps: Steps, f: Function) -> Steps:
    return steps._replace(undo=f)


def _to_board(steps: Steps, f: Function) -> Steps:
    return steps._replace(to_board=f)


def _sphere(steps: Steps, f: Function) -> Steps:
    return steps._replace(sphere=WrittenSphere(f))


class WrittenSphere:
    """The textbook's `intersect_sphere` with components first."""

    def __init__(self, function: Function) -> None:
        self.function = function

    def __call__(self, o: Any, d: Any, ball: Sphere) -> Any:
        d = np.asarray(d).T
        return self.function(np.broadcast_to(np.asarray(o).T, d.shape), d, np.array(ball.center), ball.radius)

    def all_at_once(self, o: Array, d: Array, balls: Sequence[Sphere]) -> Array:
        """(K, N): the text works on spheres in a further axis as well, unless a slip in it does not."""
        center, radius = np.array([x.center for x in balls])[:, None], np.array([x.radius for x in balls])[:, None]
        try:
            t = np.asarray(self.function(np.broadcast_to(o, d.shape).T, d.T, center, radius), float)
        except (ValueError, IndexError):
            t = np.empty(0)
        if t.shape == (len(balls), d.shape[1]):
            return t
        return np.stack([self(o, d, ball) for ball in balls])


def _plane(steps: Steps, f: Function) -> Steps:
    def solve(o: Any, d: Any, flat: Rectangle) -> Any:
        d, edges = np.asarray(d).T, (np.array(x) for x in (flat.center, flat.half_u, flat.half_v))
        return f(np.broadcast_to(np.asarray(o).T, d.shape), d, *edges)

    return steps._replace(rectangle=solve)


def _intersect_all(steps: Steps, f: Function) -> Steps:
    return steps._replace(intersect_all=f)


def _nearest(steps: Steps, f: Function) -> Steps:
    def order(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
        return np.asarray(f(t)[0])

    return steps._replace(order=order)


def _met(steps: Steps, f: Function) -> Steps:
    """Where the eye's rays end; what they meet is as before."""

    def point(rays: Rays, t: Array) -> Array:
        f.__globals__.update(
            to_board=lambda rays, R, t: (rays.origin[:, 0], rays.aim.T),
            intersect_all=lambda *_: None,
            nearest=lambda _: (None, t),
        )
        made: Array = np.asarray(f(rays, {"R_cam_board": None, "t_cam_board": None}, ())[2], float).T
        return made

    return steps._replace(point=point)


def _normals(steps: Steps, f: Function) -> Steps:
    return steps._replace(normals_at=f)


def _sun_visible(steps: Steps, f: Function) -> Steps:
    def blocked(hits: Hits, to: Array, things: tuple[Shape, ...], steps: Steps) -> Array:
        met = hits.ids >= 0
        if to.shape[1] > 1:  # the text knows one sun
            return hidden(hits, to, things, steps)
        dark = np.zeros(met.shape, bool)
        if things and met.any():
            f.__globals__["intersect_all"] = partial(_all_met, steps=steps, things=things)
            light = to[:, 0]
            of_met = hits.point[:, met].T, hits.normal[:, met].T, hits.ids[met]
            seen = f(*of_met, light, hits.eye, as_dicts(things))
            dark[met] = ~np.asarray(seen, bool)
        return dark

    return steps._replace(blocked=blocked)


def _all_met(origins: Array, directions: Array, _: Any, steps: Steps, things: tuple[Shape, ...]) -> Array:
    return meet_all(origins.T, directions.T, things, steps)


def _shade(steps: Steps, f: Function) -> Steps:
    def shade(x: Terms) -> Array:
        sun = np.broadcast_to(x.irradiance, x.albedo.shape).T
        sky = np.broadcast_to(x.sky, x.albedo.shape).T
        to = np.broadcast_to(x.to, x.albedo.shape).T if x.to.shape[1] > 1 else x.to[:, 0]
        if (sun == sun[:1]).all() and (sky == sky[:1]).all():
            sun, sky = sun[0], sky[0]
        lit, dark = (
            np.broadcast_to(f(x.hits.point.T, x.hits.normal.T, x.albedo.T, to, E, sky), x.albedo.T.shape).T
            for E in (sun, 0 * sun)
        )
        return np.where(x.visible > 0, lit, dark)

    return steps._replace(shade=shade)


def _radiance(steps: Steps, f: Function) -> Steps:
    def mixed(bench: Bench, steps: Steps, terms: Terms) -> Array:
        hits, things, hit = terms.hits, bench.things(steps), terms.hits.ids >= 0

        def part(of: Array, points: Array) -> Array:
            """Values at the points that are asked for, all of those met or others."""
            return of[hit] if len(points) == hit.sum() else of

        def normals_at(points: Array, *_: Any) -> Array:
            return part(hits.normal.T, points)

        def sun_visible(points: Array, *_: Any) -> Array:
            return part(terms.visible > 0, points)

        def shade(points: Array, normals: Array, albedo: Array, to: Array, E: Array, sky: Array) -> Array:
            dot, all_ = normals @ to, np.ones(len(points))
            seen = hits._replace(point=points.T, normal=normals.T, albedo=albedo.T)
            given = Terms(albedo.T, to[:, None], dot, all_, E[:, None], sky[:, None], seen, terms.scene, terms.shadows)
            return steps.shade(steps.prepare(given)).T

        f.__globals__.update(normals_at=normals_at, sun_visible=sun_visible)
        if steps.shade is not lambert or steps.prepare is not RIGHT.prepare:
            f.__globals__["shade"] = shade
        sun, sky = bench.scene.sun, bench.scene.sky
        scene = {
            "sun": {"to_light": np.array(sun.to_light), "irradiance": np.array(sun.irradiance)},
            "sky": {"radiance": np.array(sky.radiance)},
            "rung": "shadow" if steps.shadows(terms.shadows) else "lambert",
        }
        points = np.where(hit, hits.point, np.nan).T
        return np.asarray(f(scene, as_dicts(things), hits.eye, hits.ids, points))

    return steps._replace(mixed=mixed)


AS_STEP: dict[str, Callable[[Steps, Function], Steps]] = {
    "pixels": _pixels,
    "undistort": _undistort,
    "through": _through,
    "to_board": _to_board,
    "intersect_sphere": _sphere,
    "intersect_plane": _plane,
    "intersect_all": _intersect_all,
    "nearest": _nearest,
    "met": _met,
    "normals_at": _normals,
    "sun_visible": _sun_visible,
    "shade": _shade,
    "radiance": _radiance,
}
"""Function of the textbook -> how it takes the place of the tracer's step."""
