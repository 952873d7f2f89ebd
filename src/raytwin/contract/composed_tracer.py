"""A whole tracer out of stages: a submission's own where it has them, ours for the rest."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from raytwin.contract.stage import Function
from raytwin.contract.stages.back_project import back_project
from raytwin.contract.stages.intersect_sphere import intersect_sphere
from raytwin.contract.stages.shade import shade

SceneDict = dict[str, Any]


def view(scene: SceneDict, rays: Any) -> tuple[Any, Any]:
    """The eye (3,) and the rays (N, 3) in the board's frame: -Rᵀ t and Rᵀ d."""
    R, t = scene["R_cam_board"], scene["t_cam_board"]
    return -R.T @ t, rays @ R


def intersect_plane(origins: Any, directions: Any, plane: Mapping[str, Any]) -> Any:
    """t (N,) > 0 where each ray meets center ± half_u ± half_v; infinity for a miss."""
    center, u, v = plane["center"], plane["half_u"], plane["half_v"]
    n = np.cross(u, v)
    with np.errstate(all="ignore"):
        t = ((center - origins) @ n) / (directions @ n)
        q = origins + t[:, None] * directions - center
        within = (np.abs(q @ u) <= u @ u) & (np.abs(q @ v) <= v @ v)
    return np.where(within & (t > 0), t, np.inf)


def nearest(ts: Any) -> Any:
    """Of t (objects, N), which object each ray meets first; -1 for none."""
    return np.where(np.isfinite(ts.min(axis=0)), ts.argmin(axis=0), -1)


def sphere_normal(points: Any, sphere: Mapping[str, Any]) -> Any:
    return (points - sphere["center"]) / sphere["radius"]


class Met(NamedTuple):
    """What rays (N,) met: the object `which` (-1: none), spheres before planes; and the distance `t` along each."""

    which: np.ndarray
    t: np.ndarray
    origins: np.ndarray
    directions: np.ndarray

    @property
    def points(self) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.asarray(self.origins + self.t[:, None] * self.directions)


@dataclass(frozen=True)
class Renderer:
    """A tracer as a record of its parts; three of them are stages that are handed in.

    `given(scene)`: the scene as it is read. `sun_visible(scene, met, dark)`: where the sun shines; objects hide it
    from points that are `dark`.
    `normals(scene, met, normals)`: those to the eye, as they are used. `finish(scene, picture)`: what is returned.
    """

    given: Function = lambda scene: scene
    back_project: Function = back_project
    view: Function = view
    intersect_sphere: Function = intersect_sphere
    intersect_plane: Function = intersect_plane
    nearest: Function = nearest
    sphere_normal: Function = sphere_normal
    normals: Function = lambda scene, met, normals: normals
    shade: Function = shade
    finish: Function = lambda scene, picture: picture
    sun_visible: Function = lambda scene, met, dark: ~dark

    def hit_points(self, scene: SceneDict) -> Any:
        """Where each pixel's ray first meets a sphere: points (H, W, 3) in the board's frame, metres; NaN for none."""
        scene = self.given(scene)
        met = self.meet(scene, scene["spheres"], [])
        points = np.where((met.which >= 0)[:, None], met.points, np.nan)
        return self.finish(scene, points.reshape(scene["height"], scene["width"], 3))

    def render(self, scene: SceneDict) -> Any:
        """The picture (H, W, 3), linear radiance, row 0 on top.

        Each pixel shows what the ray through its centre meets first: shaded by sun and sky, or the sky's radiance where
        it meets nothing. With scene["rung"] == "shadow" the sun does not reach points that another object hides from
        it; with "lambert" nothing casts shadows. Planes are rectangles, center ± half_u ± half_v, lit from both sides.
        """
        scene = self.given(scene)
        objects = [*scene["spheres"], *scene["planes"]]
        met = self.meet(scene, scene["spheres"], scene["planes"])
        picture = np.tile(scene["sky"]["radiance"], (len(met.t), 1))
        seen = np.ones(len(met.t), bool)
        if scene["rung"] == "shadow":
            seen = self.sun_visible(scene, met, self.dark(scene, met))
        normals = self.normals(scene, met, self._normals(scene, met))
        albedo = np.array([thing["albedo"] for thing in objects] or [[0.0] * 3])[met.which]
        for chosen, lit in (((met.which >= 0) & seen, 1.0), ((met.which >= 0) & ~seen, 0.0)):
            if chosen.any():
                sun, sky = scene["sun"], scene["sky"]
                light = sun["to_light"], lit * sun["irradiance"], sky["radiance"]
                picture[chosen] = self.shade(met.points[chosen], normals[chosen], albedo[chosen], *light)
        return self.finish(scene, picture.reshape(scene["height"], scene["width"], 3))

    def meet(self, scene: SceneDict, spheres: Any, planes: Any) -> Met:
        rays = self.back_project(scene["K"], scene["dist"], scene["width"], scene["height"])
        eye, d = self.view(scene, np.asarray(rays, float).reshape(-1, 3))
        origins = np.tile(eye, (len(d), 1))
        ts = self._distances(origins, d, spheres, planes)
        which = self.nearest(ts)
        return Met(which, np.where(which >= 0, ts[which, np.arange(len(d))], np.inf), origins, d)

    def _distances(self, origins: Any, d: Any, spheres: Any, planes: Any) -> np.ndarray:
        ts = [self.intersect_sphere(origins, d, s["center"], s["radius"]) for s in spheres]
        ts += [self.intersect_plane(origins, d, plane) for plane in planes]
        return np.array(ts) if ts else np.full((1, len(d)), np.inf)

    def _normals(self, scene: SceneDict, met: Met) -> np.ndarray:
        """Unit, to the eye: (N, 3)."""
        normals = np.zeros_like(met.directions)
        for i, thing in enumerate((*scene["spheres"], *scene["planes"])):
            here = met.which == i
            if "radius" in thing:
                normals[here] = self.sphere_normal(met.points[here], thing)
            else:
                n = np.cross(thing["half_u"], thing["half_v"])
                normals[here] = n / np.linalg.norm(n)
            away = here & ((normals * met.directions).sum(axis=-1) > 0)
            normals[away] *= -1
        return normals

    def dark(self, scene: SceneDict, met: Met) -> np.ndarray:
        """Does another object hide the sun from each point, or its own sphere round it?"""
        p = np.where((met.which >= 0)[:, None], met.points, 0.0)
        to_light = np.tile(scene["sun"]["to_light"], (len(p), 1))
        ts = self._distances(p, to_light, scene["spheres"], scene["planes"])
        own = np.arange(len(ts))[:, None] == met.which
        dark = (np.isfinite(ts) & ~own).any(axis=0)
        for i, sphere in enumerate(scene["spheres"]):
            inside = ((met.origins - sphere["center"]) ** 2).sum(axis=-1) < sphere["radius"] ** 2
            dark |= (met.which == i) & inside
        return np.asarray(dark & (met.which >= 0))


PARTS = ("back_project", "intersect_sphere", "shade")
"""The parts of Renderer that are stages of the contract."""

NEEDED = {"hit_points": PARTS[:2], "render": PARTS}
"""Of what a submission makes these end to end, where it has no function of that name."""


def compose(stages: Mapping[str, Function]) -> Renderer:
    """Our tracer with these stages in the place of its own."""
    return Renderer(**{name: stages[name] for name in PARTS if name in stages})


def made_of(stages: Collection[str], what: str = "render") -> str:
    """In words, what `compose` makes: `render is made of its shade, the rest is ours`."""
    own = [name for name in PARTS if name in stages]
    return f"{what} is made of its {' and '.join(own)}, the rest is ours" if own else ""


def changed(part: str, change: Callable[[Any], Function]) -> Callable[[Any], Function]:
    """A variant of `hit_points` or `render`, methods of a Renderer, by a change of one of its parts."""
    return lambda f: getattr(replace(f.__self__, **{part: change(getattr(f.__self__, part))}), f.__name__)
