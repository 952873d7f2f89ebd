"""Draw a scene's objects into a photo: covered pixels replaced, and the light changed on what the photo shows.

Differential rendering (Debevec, "Rendering Synthetic Objects into Real Scenes", SIGGRAPH 1998): a photographed surface
keeps its pixels, times the light L that the path tracer finds there with the objects over that without them:

    out = photo · L_with / L_without        and value of radiance 1 · L_with where an object covers the pixel

Both follow the same random rays, so that the ratio is 1 to rounding wherever none of them meets an object. Only the
pixels about the objects and their shadows are worked on. What the photo shows (`in_photo`) enters the ratio by its
shape, and the drawn objects' light by its albedo: a board's is the mean of what is `printed` on it.
"""

import math
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.fast import trace, trim_boxes, walk
from raytwin.images.photo_files import from_bytes, to_bytes
from raytwin.photos.boards.board import PAPER, Board, draw_board
from raytwin.scene import Camera, Rectangle, Scene, Shape

DEPTH = 4
"""Surfaces of a light path, as Mitsuba counts: sun, ground, ball, ground, eye has three."""

PATHS, MAX_PATHS_PER_PIXEL = 1 << 20, 4
"""Light paths in all; each pixel gets at least one."""

BLUR_PX = 20.0
"""Side of the square over which sky and bounced light, which vary slowly, are averaged within an object, in pixels with
one path each. With more paths per pixel it shrinks by the square root of their number."""

SKY_REACH = 1 / 400
"""Share of the sky whose loss changes no 8-bit pixel, half of it where the lost part is twice as bright as the rest."""

LEAST_SLOPE = 1e-6
"""Least cosine of the sun to a plane whose shadows are drawn."""

BOX_COLOUR = (255, 64, 64)
"""sRGB of the outlines of trim boxes."""

STRIP_PIXELS = 1 << 18
"""Pixels worked on at a time."""


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
    subsamples: int = 3,
    shadows: bool = True,
    exposure: float | np.ndarray = 1.0,
) -> Augmented:
    """Return `photo`, uint8 sRGB (H, W, 3) taken by `scene.camera`, with the scene's objects drawn in.

    Each pixel is the mean of `subsamples`² places. `exposure` is the photo's linear value of radiance 1, or three of
    them, or those of each pixel (H, W, 3), which has the lens's falloff in it. Objects that the photo already shows
    (`in_photo`) are not drawn. Without `shadows` the photo is taken to show the objects already. `engine`: a row of
    ENGINES, as for `compare_scene`. Raises InputError for a photo of another size than the camera's.
    """
    height, width = photo.shape[:2]
    if scene.camera.image_size != (width, height):
        expected = f"{scene.camera.width} x {scene.camera.height} pixels, as the camera's"
        raise InputError("photo", expected, f"{width} x {height}")
    value_of_one = np.broadcast_to(np.asarray(exposure, np.float32), photo.shape)
    out, coverage, ratio = photo.copy(), np.zeros((height, width), np.float32), np.ones(photo.shape, np.float32)
    x0, y0, x1, y1 = _touched(scene, shadows)
    rows = max(1, STRIP_PIXELS // max(x1 - x0, 1))
    paths = min(max(PATHS // max((x1 - x0) * (y1 - y0), 1), 1), MAX_PATHS_PER_PIXEL)
    for top in range(y0, y1, rows):
        box = x0, top, x1, min(top + rows, y1)
        part = slice(top, box[3]), slice(x0, x1)
        drawn, coverage[part], ratio[part] = _light(scene, box, engine, subsamples, paths, shadows)
        light = from_bytes(photo[part]) * ratio[part] * (1 - coverage[part][..., None])
        out[part] = to_bytes(light + value_of_one[part] * drawn)
    return Augmented(out, coverage, ratio)


def printed(scene: Scene, board: Board) -> Scene:
    """Return the scene whose photographed board has the mean albedo of its print: that of paper and tags together.

    The board is what lies in its plane, holds its middle, and is at most twice as long and as wide.
    """
    sheet, (x0, x1, y0, y1) = draw_board(board, 500.0)
    share, middle = float(sheet.mean()) / PAPER, np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])

    def inked(thing: Shape) -> Shape:
        half = np.array(thing.extent(np.eye(3)))
        holds = np.abs(middle - thing.center) <= half + 1e-3
        if not (thing.in_photo and holds.all() and (half <= (x1 - x0, y1 - y0, 1e-3)).all()):
            return thing
        r, g, b = (share * a for a in thing.albedo)
        return msgspec.structs.replace(thing, albedo=(r, g, b))

    return scene.with_(objects=tuple(inked(thing) for thing in scene.objects))


def draw_boxes(photo: np.ndarray, scene: Scene) -> np.ndarray:
    """Return the photo (H, W, 3) with the outline of each sphere's trim box, as in the paper's figure 6."""
    out = np.ascontiguousarray(photo).copy()
    for x0, y0, x1, y1 in trim_boxes(scene.spheres, scene.camera).tolist():
        if x0 < x1:
            cv2.rectangle(out, (x0, y0), (x1 - 1, y1 - 1), BOX_COLOUR, max(1, round(out.shape[1] / 400)))
    return out


def _light(
    scene: Scene, box: tuple[int, int, int, int], engine: str, subsamples: int, paths: int, shadows: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for pixels x0, y0, x1, y1 the light of drawn objects (h, w, 3), their coverage (h, w), and the ratio that
    scales the photo (h, w, 3), each over `subsamples`² places per pixel."""
    x0, y0, x1, y1 = box
    size, step = (x1 - x0, y1 - y0), 1 / subsamples
    first = (step - 1) / 2
    pixels = scene.camera.grid(x0, y0, 1, size)
    places = scene.camera.grid(x0 + first, y0 + first, step, (subsamples * size[0], subsamples * size[1]))
    side = (max(1, round(BLUR_PX / math.sqrt(paths))),) * 2
    ours = np.array([*(not thing.in_photo for thing in scene.objects), False])  # the last: the background's, of id -1

    def sunlit(of: Scene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        image = trace(of.with_(camera=camera, sky=None), "shadow", engine)
        assert image.surface is not None
        return image.mean, image.surface.ids

    def pooled(values: np.ndarray) -> np.ndarray:
        return cv2.resize(np.float32(values), size, interpolation=cv2.INTER_AREA).reshape(*size[::-1], -1)

    def lit(of: Scene, sun: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the light of what is drawn, and of what the photo shows."""
        here = of.with_(camera=pixels)
        whole = walk(here, "path", engine, sampling="center", samples=paths, seed=y0, depth=DEPTH, surface=False)
        soft = whole.mean - sunlit(of, pixels)[0]
        found = [over := pooled(np.where(drawn[..., None], sun, 0)), pooled(sun) - over]
        for k in np.unique(ids_at_pixels[ids_at_pixels >= 0]):
            seen = (ids_at_pixels == k).astype(np.float32)
            total, weight = cv2.blur(soft * seen[..., None], side), np.maximum(cv2.blur(seen, side), 1e-6)
            found[0 if ours[k] else 1] += pooled(ids == k) * total / weight[..., None]
        return found[0], found[1]

    (sun, ids), ids_at_pixels = sunlit(scene, places), sunlit(scene, pixels)[1]
    drawn = ours[ids]
    over, after = lit(scene, sun)
    ratio = np.ones_like(after)
    if shadows and (after > 0).any():
        bare = scene.with_(objects=[thing for thing in scene.objects if thing.in_photo])
        before = lit(bare, sunlit(bare, places)[0])[1]
        ratio = np.divide(after, before, out=ratio, where=before > 0)
    return over, pooled(drawn)[..., 0], ratio


def _touched(scene: Scene, shadows: bool) -> tuple[int, int, int, int]:
    """Return x0, y0, x1, y1 of the pixels that an object may cover, or its shadow on a photographed plane may reach."""
    drawn = [thing for thing in scene.objects if not thing.in_photo]
    planes = [plane for plane in scene.planes if shadows and plane.in_photo]
    things = [*drawn, *(part for thing in drawn for plane in planes for part in _reach(thing, plane, scene))]
    boxes = trim_boxes(things, scene.camera) if things else np.zeros((1, 4), int)
    boxes = boxes[boxes[:, 0] < boxes[:, 2]]
    if not len(boxes):
        return 0, 0, 0, 0
    low, high = boxes[:, :2].min(axis=0) - 1, boxes[:, 2:].max(axis=0) + 1
    return (*np.maximum(low, 0).tolist(), *np.minimum(high, scene.camera.image_size).tolist())


def _reach(thing: Shape, plane: Rectangle, scene: Scene) -> list[Rectangle]:
    """Return squares of the plane that contain the object's shadow and the area where it hides the sky.

    It is taken for the sphere about it: one of radius r hides (r/d)² cos θ of the sky at distance d, θ off the normal.
    """
    center, radius = np.array(thing.center), math.hypot(*thing.sizes)
    offset, to_light = center - plane.center, np.array(scene.sun.to_light)
    normal = np.array(plane.normal) * (-1 if offset @ plane.normal < 0 else 1)
    height, slope = offset @ normal, to_light @ normal
    parts = [(center - height * normal, max((height * radius**2 / SKY_REACH) ** (1 / 3), radius))]
    if slope > LEAST_SLOPE:
        parts.append((center - height / slope * to_light, 1.001 * radius / slope))
    u, v = (np.array(half) / np.linalg.norm(half) for half in (plane.half_u, plane.half_v))
    return [
        msgspec.structs.replace(plane, center=tuple(middle.tolist()), half_u=tuple(half * u), half_v=tuple(half * v))
        for middle, half in parts
    ]
