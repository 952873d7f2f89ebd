"""Mistakes in which of several objects is seen."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from operator import itemgetter
from typing import Any

import msgspec
import numpy as np

from raytwin.diagnose.changes import (
    ORDER,
    Casters,
    both,
    gone,
    is_sphere,
    made_unit,
    offset_by,
    put,
    row,
    terms,
)
from raytwin.diagnose.predict import (
    RIGHT,
    Array,
    Change,
    Rays,
    Terms,
    hidden,
    meet,
    meet_all,
    nearest,
    others_hide,
    outward,
)
from raytwin.scene import Rectangle, Shape, Sphere


def last_of(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
    """The last that is hit at all."""
    met = np.isfinite(t)
    return np.where(met.any(axis=0), len(t) - 1 - met[::-1].argmax(axis=0), -1)


def first_of(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
    met = np.isfinite(t)
    return np.where(met.any(axis=0), met.argmax(axis=0), -1)


def _planes_first(t: Array, things: tuple[Shape, ...], rays: Rays, which: Any) -> Array:
    """One of a list that has the planes before the spheres."""
    order = np.array(sorted(range(len(things)), key=lambda k: is_sphere(things[k])), int)
    found = which(t[order], tuple(things[k] for k in order), rays)
    return np.where(found >= 0, order[found], -1)


def _one_of_kind(t: Array, things: tuple[Shape, ...], rays: Rays, kind: type, which: Any) -> Array:
    """See the last or the first hit of one kind, or something of the other kind before it."""
    alike = np.array([isinstance(thing, kind) for thing in things])[:, None]
    one = which(np.where(alike, t, np.inf), things, rays)
    return nearest(np.where(alike & (np.arange(len(things))[:, None] != one), np.inf, t), things, rays)


def _painted(t: Array, things: tuple[Shape, ...], rays: Rays, on_top: type) -> Array:
    """The last of this kind that is hit, before all of the other."""
    top = np.array([isinstance(thing, on_top) for thing in things])[:, None]
    last = last_of(np.where(top, t, np.inf), things, rays)
    return np.where(last >= 0, last, nearest(t, things, rays))


def _all_written(x: Terms, kinds: tuple[type, ...], albedo: bool, normal: bool, there: bool = True) -> Terms:
    """Write the albedo or normal of the last object of these kinds that the eye's ray meets.

    `there`: the normal where it is met itself, not at the point that is seen.
    """
    eye, things = np.array(x.scene.camera.eye)[:, None], x.scene.objects
    if not things:
        return x
    d = made_unit(x.hits.point - eye)
    rays = Rays(eye, d, d, np.ones(d.shape[1]))
    t = meet_all(eye, d, things, RIGHT)
    t[[not isinstance(thing, kinds) for thing in things]] = np.inf
    last = last_of(t, things, rays)
    ids = np.where(last >= 0, last, x.hits.ids)
    if albedo:
        x = x._replace(albedo=np.array([*(thing.material.albedo for thing in things), (0.0, 0.0, 0.0)])[ids].T)
    if not normal:
        return x
    n = x.hits.normal.copy()
    for k in np.unique(last[last >= 0]):
        here = last == k
        own = Rays(eye, d[:, here], d[:, here], rays.stretch[here])
        n[:, here] = outward(eye + t[k, here] * own.d if there else x.hits.point[:, here], own, things[k])
    return x._replace(cos=(n * np.array(x.scene.sun.to_light)[:, None]).sum(axis=0))


def by_key(key: Callable[[Array, Shape, Rays], Any]) -> Change:
    """See the hit of the least key (t (N,), thing, rays) -> (N,)."""

    def order(t: Array, things: tuple[Shape, ...], rays: Rays) -> Array:
        keys = np.stack([np.broadcast_to(key(t[k], thing, rays), t[k].shape) for k, thing in enumerate(things)])
        return nearest(np.where(np.isfinite(t), keys, np.inf), things, rays)

    return put(order=order)


def _center_away(t: Array, thing: Shape, rays: Rays) -> Any:
    return np.linalg.norm(rays.origin[:, 0] - thing.center)


def less(kind: Any, lost: Callable[[list[int]], list[int]]) -> tuple[Change, Change]:
    """Lose some objects of this kind: out of reach, so that ids stay; or for the eye alone."""

    def which(things: Casters) -> list[int]:
        return lost([i for i, thing in enumerate(things) if isinstance(thing, kind)])

    def order(t: Array, things: Casters, rays: Rays) -> Array:
        t = t.copy()
        t[which(things)] = np.inf
        return nearest(t, things, rays)

    def all_but(things: Casters) -> Casters:
        out = which(things)
        return tuple(gone(x) if i in out else x for i, x in enumerate(things))

    return lambda s: s._replace(objects=lambda things, camera: all_but(s.objects(things, camera))), put(order=order)


def all_at_last(*kinds: type) -> Change:
    """Put the last object of each of these kinds in the place of all; the first one's colour is seen on it."""

    def merged(things: Casters) -> Casters:
        made = list(things)
        for kind in kinds:
            alike = [i for i, thing in enumerate(things) if isinstance(thing, kind)]
            for i in alike[1:]:
                made[i] = gone(things[i])
            for i in alike[:1]:
                made[i] = msgspec.structs.replace(things[alike[-1]], material=things[i].material)
        return tuple(made)

    return lambda s: s._replace(objects=lambda things, camera: merged(s.objects(things, camera)))


def _by_rounded(t: Array, things: Casters, rays: Rays, to: Any, unit: bool) -> Array:
    """The least rounded t, of rays that are `unit` or have z = 1; of those that are equal the first."""
    return nearest(to(t / (1.0 if unit else rays.stretch)), things, rays)


def _at_rounded(rays: Rays, t: Array, to: Any, unit: bool) -> Array:
    stretch = 1.0 if unit else rays.stretch
    return rays.origin + to(t / stretch) * stretch * rays.aim


def _of_true_point(point: Array, rays: Rays, thing: Shape) -> Array:
    """Normals that are taken where the ray meets the object, whatever point is kept."""
    t = meet(rays.origin, rays.d, thing, RIGHT)
    return outward(rays.origin + np.where(np.isfinite(t), t, 0) * rays.d, rays, thing)


def rounded_t(to: Any) -> Iterator[Change]:
    """t is kept as to(t): to be compared alone, for where shadow rays start, too, or even for normals."""
    for unit in (True, False):
        order = put(order=partial(_by_rounded, to=to, unit=unit))
        yield order
        for test in (offset_by(1e-6), others_hide):
            point = both(order, put(point=partial(_at_rounded, to=to, unit=unit), blocked=test))
            yield from (both(point, put(normal=_of_true_point)), point)


ORDERS = (
    row("last-wins", ORDER,
        "no depth test: of all objects on a ray, the last one tested is shown; keep the one of the smallest t",
        put(order=last_of), put(order=partial(_planes_first, which=last_of))),
    row("first-wins", ORDER,
        "no depth test: of all objects on a ray, the first one tested is shown; keep the one of the smallest t",
        put(order=first_of), put(order=partial(_planes_first, which=first_of)),
        *(put(order=partial(_one_of_kind, kind=kind, which=first_of)) for kind in (Sphere, Rectangle))),
    row("painter", ORDER,
        "objects are drawn by the distance of their centres (painter's order): compare t on each ray",
        by_key(_center_away),
        by_key(lambda t, thing, rays: _center_away(t, thing, rays) if is_sphere(thing) else 1e6 + t),
        by_key(lambda t, thing, rays: _center_away(t, thing, rays) - getattr(thing, "radius", 0.0)),
        by_key(lambda t, thing, rays: -thing.center[2] if is_sphere(thing) else 1e6 + t)),
    row("spheres-on-top", ORDER,
        "spheres always hide planes: compare the t of all objects, planes and spheres alike",
        by_key(lambda t, thing, rays: t if is_sphere(thing) else t + 1e6),
        put(order=partial(_painted, on_top=Sphere))),
    row("planes-on-top", ORDER,
        "planes always hide spheres: compare the t of all objects, planes and spheres alike",
        by_key(lambda t, thing, rays: t + 1e6 if is_sphere(thing) else t),
        put(order=partial(_painted, on_top=Rectangle))),
    *(row(f"last-{name}-wins", ORDER,
          f"among {name}s the last one hit is shown, not the nearest: compare t between them too",
          put(order=partial(_one_of_kind, kind=kind, which=last_of)))
      for name, kind in (("sphere", Sphere), ("plane", Rectangle))),
    row("farthest-wins", ORDER, "the farthest object on a ray is shown: keep the one of the smallest t",
        by_key(lambda t, thing, rays: -t)),
    row("t-of-other-rays", ORDER,
        "t of spheres and of planes is compared across rays of different length: t is a distance only along unit rays",
        by_key(lambda t, thing, rays: t if is_sphere(thing) else t / rays.stretch),
        by_key(lambda t, thing, rays: t / rays.stretch if is_sphere(thing) else t)),
    row("depth-from-elsewhere", ORDER,
        "depth is measured from the board's origin, not from the eye: keep the smallest t on each ray",
        by_key(lambda t, thing, rays: np.linalg.norm(rays.origin + np.where(np.isfinite(t), t, 0) * rays.aim, axis=0))),
    row("hidden-one-written", ORDER,
        "albedo or normals are written for every object that a ray meets, not only for the nearest: use the mask of "
        "the closer t for them, too",
        *(terms(partial(_all_written, kinds=kinds, albedo=albedo, normal=normal))
          for albedo, normal in ((True, False), (False, True), (True, True))
          for kinds in ((Sphere, Rectangle), (Rectangle,), (Sphere,))),
        *(both(put(blocked=test), terms(partial(
            _all_written, kinds=(Sphere, Rectangle), albedo=True, normal=True, there=False)))
          for test in (hidden, others_hide))),
    row("t-rounded", ORDER,
        "t is kept in whole numbers or few digits (np.full(n, 10000) makes an array of integers): objects are compared "
        "by it, or points are made of it; keep it in float64, np.full(n, np.inf)",
        *rounded_t(np.floor), *(put(order=partial(_by_rounded, to=f, unit=unit))
                                for f in (np.rint, partial(np.round, decimals=1)) for unit in (True, False)),
        *(put(point=partial(_at_rounded, to=partial(np.round, decimals=k), unit=True), blocked=others_hide)
          for k in (0, 1, 2))),
    row("one-sphere", ORDER,
        "only one of the spheres is there, in its own colour or in another's: test every ray against each of them "
        "(functions that are made in a loop see its variable as it is in the end: the last sphere)",
        *less(Sphere, lambda alike: alike[1:]), *less(Sphere, lambda alike: alike[:-1]),
        all_at_last(Sphere), all_at_last(Sphere, Rectangle)),
    row("object-missing", ORDER, "one object is missing: the loop ends too early or begins too late, test them all",
        *(way for kind, one in product((Sphere, Rectangle, (Sphere, Rectangle)), (slice(1), slice(-1, None)))
          for way in less(kind, itemgetter(one)))),
    row("one-plane", ORDER,
        "only one of the planes is there, in its own colour or in another's: test every ray against each of them "
        "(functions that are made in a loop see its variable as it is in the end: the last plane)",
        *less(Rectangle, lambda alike: alike[1:]), *less(Rectangle, lambda alike: alike[:-1]), all_at_last(Rectangle)),
)  # fmt: skip
