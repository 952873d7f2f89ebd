"""A tree of boxes (BVH) for scenes of many objects: a ray that misses a box misses all objects in it.

The nodes are in depth-first order, and each says which node follows when its box is missed (Smits, "Efficiency Issues
for Ray Tracing", JGT 3(2), 1998): a loop without a stack, within Dr.Jit's kernel. On NumPy, a tree
saved only a quarter of the time, so it tests one object after the other.
"""

from typing import Any, NamedTuple

import numpy as np

BOX_MARGIN = 2e-6
"""How much larger a box is than its contents, as a share of the scene's extent: more than float32's rounding."""


class Nodes(NamedTuple):
    """The 2n - 1 nodes of a binary tree over n objects, depth first. `low`, `high` (2n - 1, 3): the box. `thing`: the
    object of a leaf, -1 for others. `onward`: the node that follows when the box is missed; when it is met, the next
    one does. Arrays of NumPy, or columns in the engine's numbers."""

    low: Any
    high: Any
    thing: Any
    onward: Any


def grow(center: np.ndarray, extent: np.ndarray) -> Nodes:
    """Halve the objects along the axis on which their centres spread most, until each is alone.

    `center`, and half of the size along each axis, `extent`: (n, 3), n > 0. All nodes of a level at once.
    """
    n, order = len(center), np.arange(len(center))
    extent = extent + BOX_MARGIN * (np.abs(center) + extent).max()
    low, high = np.zeros((2, 2 * n - 1, 3))
    thing, onward = np.full(2 * n - 1, -1), np.zeros(2 * n - 1, int)
    first, count, place = np.zeros(1, int), np.array([n]), np.zeros(1, int)
    while len(first):
        # A node's objects are order[first:first + count], its own index is `place`.
        starts, here = np.cumsum(count) - count, np.repeat(np.arange(len(first)), count)
        at = np.arange(len(here)) + (first - starts)[here]
        held = order[at]
        low[place] = np.minimum.reduceat((center - extent)[held], starts)
        high[place] = np.maximum.reduceat((center + extent)[held], starts)
        onward[place], alone = place + 2 * count - 1, count == 1
        thing[place[alone]] = order[first[alone]]
        spread = np.maximum.reduceat(center[held], starts) - np.minimum.reduceat(center[held], starts)
        order[at] = held[np.lexsort((center[held, spread.argmax(axis=1)[here]], here))]
        first, count, place = first[~alone], count[~alone], place[~alone]
        half = count // 2
        first, place = np.concatenate([first, first + half]), np.concatenate([place + 1, place + 2 * half])
        count = np.concatenate([half, count - half])
    return Nodes(low, high, thing, onward)
