"""Draw a scene's objects into a photo: covered pixels replaced, shadows cast on what the photo shows.

Differential rendering (Debevec, "Rendering Synthetic Objects into Real Scenes", SIGGRAPH 1998): a photographed surface
keeps its pixels, multiplied in linear light by the irradiance that it gets with the objects over that without them:

    ratio = (E V max(0, n·l) + π Ls (1 - Σ F)) / (E V0 max(0, n·l) + π Ls)

V and V0: the sun's visibility with and without the drawn objects; F = (r/d)² cos θ: the share of the sky, weighed by
the cosine, that a sphere of radius r hides at distance d, θ off the normal, if it stands wholly above the surface (form
factor of a differential element to a sphere; Howell, "A Catalog of Radiation Heat Transfer Configuration Factors").
Light that the objects send to the photographed surfaces is left out.
"""

from dataclasses import dataclass
from math import pi

import msgspec
import numpy as np

from raytwin import files
from raytwin.errors import InputError
from raytwin.image import Surface
from raytwin.scene import Camera, Rectangle, Scene, Shape, Sphere
from raytwin.speed import background, draw, trace_points, trim_box

REGIONS = ("spheres", "shadows", "board", "rest")
SKY_REACH = 1 / 512
"""A share of the sky smaller than this changes no 8-bit pixel."""


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
    exposure: float = 1.0,
    space: np.ndarray | None = None,
) -> Augmented:
    """The scene's objects drawn into `photo`, uint8 sRGB (H, W, 3), taken by `scene.camera`.

    Pixels on an edge, of an object or of a shadow, are the mean of `subsamples`² rays; the others take one. `exposure`:
    the photo's linear value of radiance 1. Objects that the photo already shows (`in_photo`) only catch shadows.
    `space` (3, 3): the photo's linear RGB to Rec. 709, see `colour`.
    """
    camera = scene.camera
    h, w = photo.shape[:2]
    if camera.image_size != (w, h):
        raise InputError("photo", f"{camera.width} x {camera.height} pixels, as the camera's", f"{w} x {h}")
    area = _affected(scene, camera, shadows)
    v, u = np.nonzero(area)
    colour, keep, ids, lit = _shade(scene, u, v, engine, shadows)
    state = np.full((h, w), -9, np.int32)
    state[v, u] = 2 * ids + lit
    edge = _edges(state) & area
    value, ratio = np.zeros((h, w, 3), np.float32), np.ones((h, w, 3), np.float32)
    coverage = np.zeros((h, w), np.float32)
    drawn = keep == 0
    value[v, u] = np.where(drawn[:, None], colour, 0)
    ratio[v, u] = np.where(drawn[:, None], 1, colour)
    coverage[v, u] = drawn
    if subsamples > 1 and edge.any():
        ev, eu = np.nonzero(edge)
        offsets = (np.arange(subsamples) + 0.5) / subsamples - 0.5
        su = (eu[:, None, None] + offsets[None, :, None] + 0 * offsets[None, None, :]).reshape(-1)
        sv = (ev[:, None, None] + 0 * offsets[None, :, None] + offsets[None, None, :]).reshape(-1)
        c, k, _, _ = _shade(scene, su, sv, engine, shadows)
        c, k = c.reshape(len(eu), -1, 3), k.reshape(len(eu), -1)
        coverage[ev, eu] = 1 - k.mean(axis=1)
        value[ev, eu] = (c * (1 - k[..., None])).sum(axis=1) / np.maximum((1 - k).sum(axis=1), 1)[:, None]
        ratio[ev, eu] = np.where(
            k.any(axis=1)[:, None], (c * k[..., None]).sum(axis=1) / np.maximum(k.sum(axis=1), 1)[:, None], 1
        )
    touched = (coverage > 0) | (ratio != 1).any(axis=-1)
    out = photo.copy()
    a = coverage[touched][:, None]
    M = np.eye(3, dtype=np.float32) if space is None else space.astype(np.float32)
    light = files.from_bytes(photo[touched]) @ M.T
    mixed = light * ratio[touched] * (1 - a) + exposure * value[touched] * a
    out[touched] = files.to_bytes(mixed @ np.linalg.inv(M).T)
    return Augmented(out, coverage, ratio)


def regions_of(result: Augmented, scene: Scene) -> dict[str, np.ndarray]:
    """name -> (H, W) bool, disjoint and together the whole photo: a row of REGIONS each.

    `board` is what of the first photographed plane neither an object covers nor a sun's shadow reaches.
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
    rows = []
    for name, mask in (*regions_of(result, scene).items(), ("all", np.ones(truth.shape[:2], bool))):
        if not mask.any():
            rows.append({"region": name, "share": 0.0, "mean": None, "rms": None, "p95": None, "codes": None})
            continue
        e = error[mask]
        rows.append(
            {
                "region": name,
                "share": float(mask.mean()),
                "mean": float(e.mean()),
                "rms": float(np.sqrt((e**2).mean())),
                "p95": float(np.quantile(np.abs(e), 0.95)),
                "codes": float(codes[mask].mean()),
            }
        )
    return rows


def _shade(scene: Scene, u: np.ndarray, v: np.ndarray, engine: str, shadows: bool):
    """At pixels (u, v): a drawn object's radiance or the ratio for the photo; 0 or 1, which of them; ids and lit."""
    found = trace_points(scene, u, v, "shadow", engine, point=True)
    keep = ~np.isin(found.ids, drawn_ids(scene))
    ratio = np.ones((len(u), 3), np.float32)
    bare = msgspec.structs.replace(scene, objects=tuple(thing for thing in scene.objects if _shown(thing)))
    for index, plane in enumerate(scene.objects) if shadows else ():
        here = np.flatnonzero(found.ids == index)
        if isinstance(plane, Rectangle) and plane.in_photo and len(here):
            # What the photo shows in the shade already: only other photographed planes can be at fault.
            lit_before = np.ones(len(here), bool)
            if len(bare.objects) > 1:
                lit_before = trace_points(bare, u[here], v[here], "shadow", engine).lit
            ratio[here] = _ratio(scene, plane, np.asarray(found.point)[here], found.lit[here], lit_before)
    return np.where(keep[:, None], ratio, found.colour), keep.astype(np.int8), found.ids, found.lit


def drawn_ids(scene: Scene) -> list[int]:
    """The ids of the objects that the photo does not show yet."""
    return [i for i, thing in enumerate(scene.objects) if not _shown(thing)]


def _shown(thing: Shape) -> bool:
    """The photo shows it already."""
    return isinstance(thing, Rectangle) and thing.in_photo


def _ratio(scene: Scene, plane: Rectangle, point: np.ndarray, lit: np.ndarray, lit_before: np.ndarray) -> np.ndarray:
    n, eye = np.array(plane.normal), np.array(scene.camera.eye)
    n = n if n @ (eye - np.array(plane.center)) > 0 else -n
    sun = np.array(scene.sun.irradiance) * max(0.0, float(n @ np.array(scene.sun.to_light)))
    sky = pi * np.array(scene.sky.radiance)
    hidden = np.zeros(len(point), np.float32)
    for sphere in scene.spheres:
        to = (np.array(sphere.center) - eye).astype(np.float32) - point
        height = to @ n.astype(np.float32)
        squared = (to * to).sum(axis=-1)
        hidden += np.where(height > 0, sphere.radius**2 * height / (squared * np.sqrt(squared)), 0)
    hidden = np.where(hidden < SKY_REACH, 0, np.minimum(hidden, 1))[:, None]
    before = sun * lit_before[:, None] + sky
    after = sun * (lit & lit_before)[:, None] + sky * (1 - hidden)
    return np.where(before > 0, after / np.where(before > 0, before, 1), 1).astype(np.float32)


def _affected(scene: Scene, camera: Camera, shadows: bool) -> np.ndarray:
    """(H, W) bool: the pixels that an object may cover, or its shadow on a photographed plane may reach."""
    area = np.zeros((camera.height, camera.width), bool)
    boxes = [trim_box(t, camera) for t in scene.objects if not _shown(t)]
    for plane in scene.rectangles if shadows else ():
        if not plane.in_photo:
            continue
        if any(not p.in_photo for p in scene.rectangles):
            boxes.append(trim_box(plane, camera))  # a rectangle's shadow: anywhere on the plane
            continue
        for sphere in scene.spheres:
            boxes += [trim_box(part, camera) for part in _reach(sphere, plane, scene)]
    for x0, y0, x1, y1 in boxes:
        area[max(y0 - 1, 0) : y1 + 1, max(x0 - 1, 0) : x1 + 1] = True
    return area


def _reach(sphere: Sphere, plane: Rectangle, scene: Scene) -> list[Rectangle]:
    """The squares of the plane that hold the sphere's shadow from the sun, and its hold on the sky."""
    n, to_light = np.array(plane.normal), np.array(scene.sun.to_light)
    c, o = np.array(sphere.center), np.array(plane.center)
    if (c - o) @ n < 0:
        n = -n
    height = (c - o) @ n
    foot = c - height * n
    u = np.array(plane.half_u) / np.linalg.norm(plane.half_u)
    v = np.array(plane.half_v) / np.linalg.norm(plane.half_v)
    # h r² / d³ = reach, with d the distance to the sphere's centre
    parts = [(foot, max((height * sphere.radius**2 / SKY_REACH) ** (1 / 3), sphere.radius))]
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


def _edges(state: np.ndarray) -> np.ndarray:
    """Pixels whose state differs from a neighbour's, of the eight."""
    out = np.zeros(state.shape, bool)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = state[: state.shape[0] - dy, max(0, -dx) : state.shape[1] - max(0, dx)]
        b = state[dy:, max(0, dx) : state.shape[1] + min(0, dx)]
        differ = a != b
        out[: state.shape[0] - dy, max(0, -dx) : state.shape[1] - max(0, dx)] |= differ
        out[dy:, max(0, dx) : state.shape[1] + min(0, dx)] |= differ
    return out
