"""Which objects each tile of pixels needs: computed once per image, before any ray."""

from typing import NamedTuple

import msgspec
import numpy as np

from raytwin.scene import Rectangle, Scene, Sphere
from raytwin.speed.boxes import ball_boxes
from raytwin.speed.shadows import fall

FEW = 64
"""Up to this number of objects, all pairs are compared without sorting them first."""

MOST = 20_000_000
"""Pairs, of two objects or of a tile and an object: more take over a gigabyte, and one list for all tiles does."""

PORTION = 2_000_000
"""Pairs compared at once: bounds the memory."""


class Lists(NamedTuple):
    """A list of ids for each tile: `flat[first:last]`; rectangles begin at `middle`. Each (tiles,) int32."""

    flat: np.ndarray
    first: np.ndarray
    middle: np.ndarray
    last: np.ndarray

    def at(self, tile: int) -> list[int]:
        ids: list[int] = self.flat[self.first[tile] : self.last[tile]].tolist()
        return ids


class Plan(NamedTuple):
    """Square tiles of `side` pixels, `columns` of them a row: a pixel's tile is (v // side) columns + u // side.

    `tiles`: the numbers of those with work. A tile's pixels may see the objects of its list in `seen`, and those of
    `casters` may stand between what they see and the sun.
    """

    side: int
    columns: int
    tiles: np.ndarray
    seen: Lists
    casters: Lists


def plan(scene: Scene, boxes: np.ndarray, size: tuple[int, int], side: int, shadows: bool = True) -> Plan:
    """Return which tile needs which object, from the objects' boxes (n, 4) of pixels: x0 <= u < x1, y0 <= v < y1."""
    n, is_flat = len(boxes), np.array([not isinstance(thing, Sphere) for thing in scene.objects], bool)
    columns, rows = -(-size[0] // side), -(-size[1] // side)
    tile, thing, full = _covered(boxes.reshape(-1, 4), side, columns)
    if n and ((boxes == (0, 0, *size)).all() or full):  # nothing is trimmed, or hardly anything
        every = one_list(columns * rows, is_flat)
        return Plan(side, columns, np.arange(columns * rows), every, every)
    seen = _lists(tile, thing, columns * rows, is_flat)
    casters = Lists(*(np.zeros(len(part), np.int32) for part in seen))
    if shadows:
        casters = _casters(scene, boxes.reshape(-1, 4), size, side, is_flat)
    return Plan(side, columns, np.flatnonzero(seen.last > seen.first), seen, casters)


def _covered(boxes: np.ndarray, side: int, columns: int) -> tuple[np.ndarray, np.ndarray, bool]:
    """The tiles that each box (n, 4) touches, and which box; none where they were more than MOST, then True."""
    x0, y0, x1, y1 = boxes.T
    left, top = x0 // side, y0 // side
    wide, high = np.maximum(-(-x1 // side) - left, 0), np.maximum(-(-y1 // side) - top, 0)
    if (wide * high).sum() > MOST:
        return np.zeros(0, int), np.zeros(0, int), True
    which, k = spread(wide * high)
    wide = np.maximum(wide, 1)[which]
    return (top[which] + k // wide) * columns + left[which] + k % wide, which, False


def _casters(scene: Scene, boxes: np.ndarray, size: tuple[int, int], side: int, is_flat: np.ndarray) -> Lists:
    """The casters of what the tiles see: on a rectangle, only those whose shadow's box touches the tile."""
    columns, rows = -(-size[0] // side), -(-size[1] // side)
    if (found := caster_pairs(scene)) is None:
        return one_list(columns * rows, is_flat)
    first, caster = found
    shaded = np.repeat(np.arange(len(is_flat)), np.diff(first))
    reach = boxes[shaded]
    if (flat := np.flatnonzero(is_flat[shaded])).size:
        fallen = fall(scene, shaded[flat], caster[flat])
        camera = msgspec.structs.replace(scene.camera, image_size=size)
        radius = fallen.reach * (1 + 1e-3) + 1e-5 * np.linalg.norm(fallen.middle, axis=1)  # for float32's rounding
        around = ball_boxes(fallen.middle, radius, camera)
        reach[flat, :2] = np.maximum(reach[flat, :2], around[:, :2])
        reach[flat, 2:] = np.minimum(reach[flat, 2:], around[:, 2:])
    tile, pair, full = _covered(reach, side, columns)
    if full:
        return one_list(columns * rows, is_flat)
    n = max(len(is_flat), 1)
    both = np.unique(tile.astype(np.int64) * n + caster[pair])
    return _lists(both // n, both % n, columns * rows, is_flat)


def one_list(tiles: int, is_flat: np.ndarray) -> Lists:
    """All objects for every tile."""
    n = len(is_flat)
    ends = (np.full(tiles, k, np.int32) for k in (0, n - np.count_nonzero(is_flat), n))
    return Lists(np.argsort(is_flat, kind="stable").astype(np.int32), *ends)


def spread(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each index i counts[i] times over, and beside it 0, 1, ... counts[i] - 1."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


def _lists(tile: np.ndarray, thing: np.ndarray, tiles: int, is_flat: np.ndarray) -> Lists:
    order = np.lexsort((thing, is_flat[thing], tile))
    last = np.cumsum(np.bincount(tile, minlength=tiles))
    first = last - np.bincount(tile, minlength=tiles)
    middle = first + np.bincount(tile[~is_flat[thing]], minlength=tiles)
    return Lists(*(a.astype(np.int32) for a in (thing[order], first, middle, last)))


def caster_pairs(scene: Scene) -> tuple[np.ndarray, np.ndarray] | None:
    """(first, flat): `flat[first[j]:first[j + 1]]` are the objects that may cast a shadow on object j; never too few.

    Both are put into balls. Seen along the sun's rays these are discs, which must overlap, and the caster's ball must
    not lie behind the other's. None where there are more than MOST pairs: 10 000 objects in a line to the sun.
    """
    things = scene.objects
    n = len(things)
    center = np.array([t.center for t in things]).reshape(-1, 3)
    radius = np.array([t.radius if isinstance(t, Sphere) else np.hypot(*_lengths(t)) for t in things])
    to_light = np.array(scene.sun.to_light)
    side = np.cross(to_light, np.eye(3)[np.abs(to_light).argmin()])
    axes = np.stack([side / np.linalg.norm(side), np.cross(to_light, side) / np.linalg.norm(side), to_light])
    x, y, height = axes @ center.T
    radius = radius * (1 + 1e-4) + 1e-6 * np.abs(center).max(initial=0)  # for float32's rounding
    x, y = (x, y) if n and np.ptp(x) > np.ptp(y) else (y, x)
    # Sorted along x, a small object's partners lie in a short stretch; large ones are compared with all.
    large = radius > 8 * np.median(radius) if n > FEW else np.ones(n, bool)
    small, big = np.flatnonzero(~large)[np.argsort(x[~large])], np.flatnonzero(large)
    reach = radius[small] + radius[small].max(initial=0)
    near = (np.searchsorted(x[small], x[small] + sign * reach) for sign in (-1, 1))
    # In the line of small and big objects, each shaded one's casters lie between `low` and `high`.
    line, whose, few = np.concatenate([small, big]), np.concatenate([small, small, big]), len(small)
    low, high = (
        np.concatenate([stretch, np.full(few, end[0]), np.full(n - few, end[1])])
        for stretch, end in zip(near, ((few, 0), (n, n)), strict=True)
    )
    counts = np.cumsum(high - low)
    if counts.max(initial=0) > 30 * MOST:
        return None
    cuts = np.searchsorted(counts, np.arange(PORTION, counts.max(initial=0), PORTION))
    found = []
    for part in np.split(np.arange(len(whose)), cuts):
        i, k = spread((high - low)[part])
        shaded, caster = whose[part][i], line[low[part][i] + k]
        both = radius[shaded] + radius[caster]
        over = (x[caster] - x[shaded]) ** 2 + (y[caster] - y[shaded]) ** 2 <= both**2
        keep = over & (height[caster] - height[shaded] >= -both) & (caster != shaded)
        found.append((shaded[keep].astype(np.int32), caster[keep].astype(np.int32)))
        if sum(len(s) for s, _ in found) > MOST:
            return None
    shaded, caster = (np.concatenate(p) for p in zip(*found, strict=True))
    order = np.lexsort((caster, shaded))
    first = np.concatenate([[0], np.cumsum(np.bincount(shaded, minlength=n))])
    return first, caster[order]


def _lengths(plane: Rectangle) -> tuple[float, float]:
    return float(np.linalg.norm(plane.half_u)), float(np.linalg.norm(plane.half_v))
