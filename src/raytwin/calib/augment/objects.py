"""Draw a scene's objects into a photo: covered pixels replaced, shadows cast on what the photo shows.

Differential rendering (Debevec, "Rendering Synthetic Objects into Real Scenes", SIGGRAPH 1998): a photographed surface
keeps its pixels, multiplied in linear light by the irradiance that it gets with the objects over that without them:

    ratio = (E V max(0, n·l) + π Ls (1 - Σ F)) / (E V0 max(0, n·l) + π Ls)

V and V0: the sun's visibility with and without the drawn objects; F = (r/d)² cos θ: the share of the sky, weighed by
the cosine, that a sphere of radius r hides at distance d, θ off the normal, if it stands wholly above the surface (form
factor of a differential element to a sphere; Howell, "A Catalog of Radiation Heat Transfer Configuration Factors").
Under a sky that is a map, π Ls is its irradiance E(n), and what a sphere hides is π F times the map's mean over the
part that it covers (`hidden_sky`). Light that the objects send to the photographed surfaces is left out.

The sky of a scene is all around. With `ground` what spheres get from below the horizon is the light of the ground, as
the photo shows it, times that ratio (`ground_light`).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import pi
from typing import Any

import cv2
import msgspec
import numpy as np

from raytwin import files
from raytwin.calib.augment.ground_light import ground_for_sky
from raytwin.calib.augment.hidden_sky import CapMeans
from raytwin.calib.ground_rings import polynomials
from raytwin.calib.photos import lens_model
from raytwin.errors import InputError
from raytwin.image import Surface
from raytwin.lights import lighting
from raytwin.scene import Camera, Environment, Rectangle, Scene, Shape, Sphere
from raytwin.speed import background, draw, trace_points, trim_box

REGIONS = ("spheres", "shadows", "board", "rest")
SKY_REACH = 1 / 512
"""A share of the sky smaller than this changes no 8-bit pixel."""

MOST_UNEVEN = 8
"""Factor by which a sphere may hide more of a map's light than of a constant sky's; its shadow reaches farther."""

STRIP = 1 << 20
"""Pixels worked on at a time."""

FromBelow = tuple[int, Sphere, np.ndarray]
"""A sphere's id, the sphere, and its `ground_for_sky`."""


@dataclass(frozen=True, eq=False)
class Augmented:
    """`pixels` (H, W, 3) uint8 sRGB; `coverage` (H, W) by drawn objects; `ratio` (H, W, 3) that scaled the photo."""

    pixels: np.ndarray
    coverage: np.ndarray
    ratio: np.ndarray


def augment(
    photo: np.ndarray,
    scene: Scene,
    *,
    engine: str = "numpy32",
    subsamples: int = 4,
    shadows: bool = True,
    exposure: float | np.ndarray = 1.0,
    space: np.ndarray | None = None,
    ground: bool = False,
) -> Augmented:
    """Return `photo`, uint8 sRGB (H, W, 3) taken by `scene.camera`, with the scene's objects drawn in.

    Pixels on the edge of an object or a shadow are the mean of `subsamples`² rays; all others take one. `exposure` is
    the photo's linear value of radiance 1, or three of them, or those of each pixel (H, W, 3), which has the lens's
    falloff in it. Objects that the photo already shows (`in_photo`) only
    catch shadows. `space` (3, 3): the photo's linear RGB to Rec. 709, see `colour`. `ground`: spheres get the light of
    the ground that the photo shows. Without `shadows` the photo is taken to show the objects already. `engine`: a row
    of ENGINES, as for `compare_scene`. Raises InputError for a photo of another size than the camera's.
    """
    camera = scene.camera
    h, w = photo.shape[:2]
    if camera.image_size != (w, h):
        raise InputError("photo", f"{camera.width} x {camera.height} pixels, as the camera's", f"{w} x {h}")
    if space is not None and np.array_equal(space, np.eye(3)):
        space = None  # two products of all pixels that change none
    value_of_one = np.broadcast_to(np.asarray(exposure, np.float32), (h, w, 3))
    below = _from_below(photo, scene, value_of_one, space, shadows) if ground else []
    out, inside = photo.copy(), np.zeros((h, w), bool)
    coverage, ratio = np.zeros((h, w), np.float32), np.empty((h, w, 3), np.float32)
    # OpenCV compares whole numbers of 16 bits four times as fast; it has none of 32.
    state = np.full((h, w), -9, np.int16 if len(scene.objects) < 1 << 14 else np.float32)
    for part in _strips(_affected(scene, camera, shadows)):
        v, u = np.mgrid[part].astype(np.float32).reshape(2, -1)
        colour, scaled, drawn, seen = (
            a.reshape(*photo[part].shape[:2], *a.shape[1:]) for a in _shade(scene, u, v, engine, shadows, below)
        )
        coverage[part], ratio[part], state[part], inside[part] = drawn, scaled, seen, True
        out[part] = _mixed(photo[part], scaled, coverage[part], value_of_one[part] * colour, space)
    ratio[~inside] = 1
    # A pixel that differs from one of its eight neighbours lies on an edge.
    square = np.ones((3, 3), np.uint8)
    edge = (cv2.dilate(state, square) != cv2.erode(state, square)) & inside
    if subsamples > 1 and edge.any():
        at = np.nonzero(edge)
        offsets = ((np.arange(subsamples) + 0.5) / subsamples - 0.5).astype(np.float32)
        ev, eu = (a[:, None, None].astype(np.float32) for a in at)
        su = np.broadcast_to(eu + offsets[:, None], (len(eu), subsamples, subsamples))
        sv = np.broadcast_to(ev + offsets, su.shape)
        c, scaled, hit, _ = _shade(scene, su.reshape(-1), sv.reshape(-1), engine, shadows, below)
        c, scaled, hit = (x.reshape(len(eu), subsamples**2, *x.shape[1:]) for x in (c, scaled, hit))
        there = hit.sum(axis=1)[:, None]
        left = subsamples**2 - there
        coverage[at] = there[:, 0] / subsamples**2
        ratio[at] = np.where(left > 0, (scaled * ~hit[..., None]).sum(axis=1) / np.maximum(left, 1), 1)
        value = (c * hit[..., None]).sum(axis=1) / np.maximum(there, 1)
        out[at] = _mixed(photo[at], ratio[at], coverage[at], value_of_one[at] * value, space)
    return Augmented(out, coverage, ratio)


def _mixed(
    photo: np.ndarray, ratio: np.ndarray, coverage: np.ndarray, value: np.ndarray, space: np.ndarray | None
) -> np.ndarray:
    """sRGB uint8 (..., 3): the photo times the ratio, and over it, by its coverage, what is drawn."""
    light = files.from_bytes(photo)
    if space is not None:
        light = light @ space.T.astype(np.float32)
    light *= ratio
    if (over := coverage > 0).any():
        a = coverage[over][:, None]
        light[over] = light[over] * (1 - a) + value[over] * a
    return files.to_bytes(light if space is None else light @ np.linalg.inv(space).T.astype(np.float32))


def _strips(area: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Rows and columns that hold all of `area` (H, W), some STRIP pixels at a time, without what lies around it."""
    rows = np.flatnonzero(area.any(axis=1))
    if not rows.size:
        return
    step = max(1, STRIP // area.shape[1])
    for y in range(int(rows[0]), int(rows[-1]) + 1, step):
        columns = np.flatnonzero(area[y : y + step].any(axis=0))
        if columns.size:
            yield slice(y, min(y + step, int(rows[-1]) + 1)), slice(int(columns[0]), int(columns[-1]) + 1)


def regions_of(result: Augmented, scene: Scene) -> dict[str, np.ndarray]:
    """name -> (H, W) bool, disjoint and together the whole photo: a row of REGIONS each.

    `board`: the visible part of the first photographed plane that is neither in `spheres` nor in `shadows`.
    """
    surface = Surface.empty(*scene.camera.image_size)
    draw(scene, background(scene), "surface", "numpy32", surface=surface)
    spheres = result.coverage > 0
    shadows = ~spheres & (result.ratio < 0.9).any(axis=-1)
    boards = [i for i, thing in enumerate(scene.objects) if _shown(thing)][:1]
    board = ~spheres & ~shadows & np.isin(surface.ids, boards)
    return {"spheres": spheres, "shadows": shadows, "board": board, "rest": ~(spheres | shadows | board)}


def errors_by_region(result: Augmented, truth: np.ndarray, scene: Scene) -> list[dict]:
    """Per region: its share of the pixels, and mean, rms and 95 % quantile of the error against `truth`.

    In linear light, 1 is white; `mean` is signed (augmented minus true), and `codes` is the mean absolute error in
    8-bit sRGB steps.
    """
    if truth.shape != result.pixels.shape:
        raise InputError("truth", f"pixels {result.pixels.shape}", truth.shape)
    error = files.from_bytes(result.pixels) - files.from_bytes(truth)
    codes = np.abs(result.pixels.astype(np.int16) - truth).mean(axis=-1)
    measures: dict[str, tuple[np.ndarray, Callable[[np.ndarray], Any]]] = {
        "mean": (error, np.mean),
        "rms": (error, lambda e: np.sqrt((e**2).mean())),
        "p95": (error, lambda e: np.quantile(np.abs(e), 0.95)),
        "codes": (codes, np.mean),
    }
    return [
        {"region": name, "share": float(mask.mean())}
        | {key: float(of(values[mask])) if mask.any() else None for key, (values, of) in measures.items()}
        for name, mask in (*regions_of(result, scene).items(), ("all", np.ones(truth.shape[:2], bool)))
    ]


def _shade(
    scene: Scene, u: np.ndarray, v: np.ndarray, engine: str, shadows: bool, below: list[FromBelow]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return at pixels (u, v): radiance; the photo's ratio (m, 3); if an object is drawn; a code that edges change."""
    found = trace_points(scene, u, v, "shadow", engine, point=True)
    ours = np.array([*(not _shown(thing) for thing in scene.objects), False])  # the last: the background, of id -1
    ratio = np.ones((len(u), 3), np.float32)
    lit = found.lit
    for index, plane in enumerate(scene.objects) if shadows else ():
        if not (isinstance(plane, Rectangle) and _shown(plane)):
            continue
        here = found.ids == index
        if here.any():
            # What was in shade before anything was drawn: only other photographed planes can have shaded it.
            at = slice(None) if here.all() else np.flatnonzero(here)
            before = lit.copy()
            asked = np.flatnonzero(here & (found.blocker >= 0) & ours[found.blocker])
            before[asked] = _lit_without(scene, u[asked], v[asked], engine)
            n, to_eye = np.array(plane.normal), np.array(scene.camera.eye) - np.array(plane.center)
            n = n if n @ to_eye > 0 else -n
            ratio[at] = _ratio(scene, n, np.asarray(found.point)[at], lit[at], before[at])
    for index, sphere, factors in below:
        mine = np.flatnonzero(found.ids == index)
        n = (np.asarray(found.point)[mine] - (np.array(sphere.center) - scene.camera.eye)) / sphere.radius
        reflected = np.array(sphere.albedo) + getattr(sphere.material, "specular", 0)
        found.colour[mine] = np.maximum(found.colour[mine] + reflected * (polynomials(n) @ factors), 0)
    return found.colour, ratio, ours[found.ids], 2 * found.ids + lit


def _lit_without(scene: Scene, u: np.ndarray, v: np.ndarray, engine: str) -> np.ndarray:
    """(m,) bool: the sun reaches the photographed planes there, were nothing drawn."""
    bare = msgspec.structs.replace(scene, spheres=(), planes=tuple(p for p in scene.planes if p.in_photo))
    if len(bare.objects) < 2 or not len(u):
        return np.ones(len(u), bool)
    return trace_points(bare, u, v, "shadow", engine).lit


def _shown(thing: Shape) -> bool:
    """The photo shows it already."""
    return isinstance(thing, Rectangle) and thing.in_photo


def _from_below(
    photo: np.ndarray, scene: Scene, value_of_one: np.ndarray, space: np.ndarray | None, shadows: bool
) -> list[FromBelow]:
    """What spheres get from the ground instead of the sky; the ground's light is that with all objects drawn in."""
    camera, eye = scene.camera, np.array(scene.camera.eye)
    R, t = np.array(camera.R_cam_board), np.array(camera.t_cam_board)

    def look(at: np.ndarray) -> np.ndarray:
        seen = lens_model.grows(at @ R.T + t, camera.dist)
        # What is behind the camera has no pixel, and may have no number.
        uv = np.where(seen[:, None], np.rint(lens_model.project(at, R, t, camera.K, camera.dist)), -1).astype(int)
        seen &= ((uv >= 0) & (uv < camera.image_size)).all(axis=1)
        if not shadows:
            seen &= ~_crossed(scene.spheres, eye, at - eye, 1.0)
        out = np.full((len(at), 3), np.nan)
        u, v = uv[seen].T
        light = files.from_bytes(photo[v, u])
        out[seen] = (light if space is None else light @ space.T) / np.maximum(value_of_one[v, u], 1e-6)
        if shadows:
            lit = ~_crossed(scene.spheres, at, np.array(scene.sun.to_light), np.inf)
            out *= _ratio(scene, np.array([0.0, 0.0, 1.0]), (at - eye).astype(np.float32), lit, np.ones(len(at), bool))
        return out

    spheres = ((index, thing) for index, thing in enumerate(scene.objects) if isinstance(thing, Sphere))
    return [(index, sphere, ground_for_sky(scene, sphere, look)) for index, sphere in spheres]


def _crossed(spheres: Iterable[Sphere], start: np.ndarray, along: np.ndarray, end: float) -> np.ndarray:
    """(m,) bool: some sphere meets the line from `start` to start + end along; either is (m, 3) or (3)."""
    met = np.zeros(np.broadcast_shapes(start.shape, along.shape)[0], bool)
    for sphere in spheres:
        to = np.array(sphere.center) - start
        t = np.clip((to * along).sum(axis=-1) / (along * along).sum(axis=-1), 0, end)
        met |= np.linalg.norm(to - t[:, None] * along, axis=-1) < sphere.radius
    return met


def _ratio(scene: Scene, n: np.ndarray, point: np.ndarray, lit: np.ndarray, lit_before: np.ndarray) -> np.ndarray:
    """(m, 3) float32 at surfaces of normal `n`; without any light before, 1. `point` (m, 3): from the eye."""
    around, n32 = scene.environment, n.astype(np.float32)
    sun = np.array(scene.sun.irradiance, np.float32) * np.float32(max(0.0, float(n @ np.array(scene.sun.to_light))))
    sky = np.float32(pi) * np.array(lighting(scene).sky.diffuse_irradiance(tuple(n.tolist())), np.float32)
    x, y, z = (np.ascontiguousarray(point[:, k]) for k in range(3))
    hidden = np.zeros((len(point), 3) if around else len(point), np.float32)
    for sphere in scene.spheres:
        dx, dy, dz = (np.float32(c - e) - p for c, e, p in zip(sphere.center, scene.camera.eye, (x, y, z), strict=True))
        squared = dx * dx + dy * dy + dz * dz
        far = np.sqrt(squared)
        share = np.float32(sphere.radius**2) * np.maximum(dx * n32[0] + dy * n32[1] + dz * n32[2], 0) / (squared * far)
        if around is None:
            hidden += share * (share >= SKY_REACH)
            continue
        near = np.flatnonzero(share >= SKY_REACH / MOST_UNEVEN)
        angle, to = np.arcsin(np.minimum(sphere.radius / far[near], 1)), np.stack([dx, dy, dz], axis=1)[near]
        hidden[near] += np.float32(pi) * share[near, None] * _cap_means(around)(to / far[near, None], angle)
    out = np.empty((len(point), 3), np.float32)
    for c in range(3):
        before = sun[c] * lit_before + sky[c]
        left = sky[c] - (hidden[:, c] if around else sky[c] * hidden)
        out[:, c] = np.divide(sun[c] * lit + np.maximum(left, 0), before, out=np.ones_like(left), where=before > 0)
    return out


@lru_cache(maxsize=4)
def _cap_means(around: Environment) -> CapMeans:
    return CapMeans(around)


def _affected(scene: Scene, camera: Camera, shadows: bool) -> np.ndarray:
    """(H, W) bool: the pixels that an object may cover, or its shadow on a photographed plane may reach."""
    area = np.zeros((camera.height, camera.width), bool)
    boxes = [trim_box(t, camera) for t in scene.objects if not _shown(t)]
    for plane in scene.planes if shadows else ():
        if not plane.in_photo:
            continue
        if any(not p.in_photo for p in scene.planes):
            boxes.append(trim_box(plane, camera))  # a rectangle's shadow: anywhere on the plane
            continue
        for sphere in scene.spheres:
            boxes += [trim_box(part, camera) for part in _reach(sphere, plane, scene)]
    for x0, y0, x1, y1 in boxes:
        area[max(y0 - 1, 0) : y1 + 1, max(x0 - 1, 0) : x1 + 1] = True
    return area


def _reach(sphere: Sphere, plane: Rectangle, scene: Scene) -> list[Rectangle]:
    """Return squares of the plane that contain the sphere's shadow from the sun and the area where it hides the sky."""
    n, to_light = np.array(plane.normal), np.array(scene.sun.to_light)
    c, o = np.array(sphere.center), np.array(plane.center)
    if (c - o) @ n < 0:
        n = -n
    height = (c - o) @ n
    foot = c - height * n
    u = np.array(plane.half_u) / np.linalg.norm(plane.half_u)
    v = np.array(plane.half_v) / np.linalg.norm(plane.half_v)
    # h r² / d³ = reach, with d the distance to the sphere's centre
    reach = SKY_REACH / (1 if scene.environment is None else MOST_UNEVEN)
    parts = [(foot, max((height * sphere.radius**2 / reach) ** (1 / 3), sphere.radius))]
    if (slope := to_light @ n) > 1e-3:
        parts.append((c - height / slope * to_light, 1.001 * sphere.radius / slope))
    elif slope > 0:
        return [plane]
    return [
        msgspec.structs.replace(
            plane, center=tuple(p.tolist()), half_u=tuple((s * u).tolist()), half_v=tuple((s * v).tolist())
        )
        for p, s in parts
    ]
