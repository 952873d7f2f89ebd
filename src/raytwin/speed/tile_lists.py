"""Which objects may cast a shadow on which: computed once per image, before any ray."""

import numpy as np

from raytwin.scene import Rectangle, Scene, Sphere

FEW = 64
"""Up to this number of objects, all pairs are compared without sorting them first."""

MOST = 20_000_000
"""Pairs: more take over a gigabyte."""

PORTION = 2_000_000
"""Pairs compared at once: bounds the memory."""


def spread(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each index i counts[i] times over, and beside it 0, 1, ... counts[i] - 1."""
    index = np.repeat(np.arange(len(counts)), counts)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)


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
