"""Which of two objects a ray meets that passes their outline within rounding: float64 decides.

Mitsuba's rays and shapes are float32, off by some 2⁻²⁴ of their distance from the eye: an outline strays by about
1e-4 px, and of a picture's millions of pixels one or two get the wrong object, or a shadow that is not theirs. They are
found from Mitsuba's own answer: a pixel with a neighbour of another answer, whose ray passes that neighbour's object
(or its own) so closely that float32 cannot tell. Those few rays alone are traced again, in float64, against everything.

Everywhere else Mitsuba's answer stands; and so it does in a crowd of some thousand objects (MOST), where tracing again
would take longer than all else.
"""

from typing import NamedTuple

import numpy as np

from raytwin.scene import Scene
from raytwin.twin.bodies import MOST_IN_DOUBLES, START, Body, distance, dot, normal, table, too_far
from raytwin.twin.rays import directions, lens_of
from raytwin.twin.twin_scene import UNIT

EDGE_TOLERANCE = 1e-5
"""How near to an outline, as a part of the distance from the eye, float32 may err: 168 of its steps.

Shadow rays start 4e-6 of the distance off the surface (`world.SHADOW_OFFSET`), so a shadow's outline strays by as much.
"""

MOST = 1 << 22
"""Pairs of rays and objects that are traced again at most, half a second's work; setting out counts as 1000 rays."""


class Seen(NamedTuple):
    """What the rays through the pixels' centres meet, row by row: (n,) and (n, 3).

    `ids` -1 where nothing is met, `depth` in metres, `normal` in the board frame, on the eye's side; `blocker` is the
    id of an object that hides the sun from there, -1 where none does.
    """

    ids: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    blocker: np.ndarray


def retrace_edges(scene: Scene, seen: Seen, shadows: bool) -> np.ndarray:
    """Trace the pixels in doubt again, in float64, into `seen`. Returns their numbers (k,), row by row."""
    camera, bodies = scene.camera, table(scene)
    R = np.asarray(camera.R_cam_board)
    sun = R @ scene.sun.to_light
    if not scene.objects:
        return np.zeros(0, int)
    ids, blockers = (x.reshape(camera.height, camera.width) for x in (seen.ids, seen.blocker))
    edge = borders(ids)
    doubtful = edge[_doubted(bodies, ids, edge, np.zeros((3, 1)), rays(scene, edge).T)]
    if shadows:
        edge = np.union1d(edge, borders(blockers))
        edge = edge[seen.ids[edge] >= 0]
        points = rays(scene, edge).T * seen.depth[edge] * UNIT
        # Only what a neighbour sees, or what shades a neighbour, is tested as what shades this pixel.
        shaded = [_doubted(bodies, met, edge, points, sun[:, None]) for met in (blockers, ids)]
        doubtful = np.union1d(doubtful, edge[shaded[0] | shaded[1]])
    if (len(doubtful) + 1000) * len(scene.objects) > MOST:
        return np.zeros(0, int)
    d = rays(scene, doubtful).T
    seen.ids[doubtful], t = trace(bodies, np.zeros((3, 1)), d)
    seen.depth[doubtful] = t / UNIT
    n = np.stack(normal(bodies.at(seen.ids[doubtful]), d * t)) * (seen.ids[doubtful] >= 0)
    n *= np.where(dot(n, d) > 0, -1, 1)
    seen.normal[doubtful] = n.T @ R
    if shadows:
        start = d * t + n * (START * t)
        seen.blocker[doubtful] = np.where(dot(n, sun) > 0, trace(bodies, start, sun[:, None])[0], -1)
    return np.asarray(doubtful)


def refine(scene: Scene, seen: Seen) -> np.ndarray:
    """Compute depth and normal again, in float64, of what is too far for float32. Returns the pixels' numbers (k,).

    For a scene of too many objects for `retrace_edges`, which Mitsuba intersects: its answer is what each ray meets.
    """
    bodies = table(scene)
    far = too_far(bodies) & bodies.round
    if len(far) <= MOST_IN_DOUBLES or not far.any():
        return np.zeros(0, int)
    pixels = np.flatnonzero((seen.ids >= 0) & far[seen.ids])
    d, met = rays(scene, pixels).T, bodies.at(seen.ids[pixels])
    with np.errstate(all="ignore"):
        t = distance(np, met, np.zeros((3, 1)), d)
    hit = np.isfinite(t)
    pixels, d, t, met = pixels[hit], d[:, hit], t[hit], met.at(hit)
    seen.depth[pixels] = t / UNIT
    n = np.stack(normal(met, d * t))
    n *= np.where(dot(n, d) > 0, -1, 1)
    seen.normal[pixels] = n.T @ np.asarray(scene.camera.R_cam_board)
    return pixels


def rays(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """The unit directions (k, 3), camera frame, through the centres of the pixels of these numbers, row by row."""
    v, u = np.divmod(pixels, scene.camera.width)
    return np.stack(directions(np, lens_of(scene.camera), u.astype(float), v.astype(float)), axis=1)


def borders(image: np.ndarray) -> np.ndarray:
    """The numbers, row by row, of the pixels of which one of the eight neighbours has another value."""
    found = np.zeros(image.shape, bool)
    for one, other in _PAIRS:
        differ = image[one] != image[other]
        found[one] |= differ
        found[other] |= differ
    return np.flatnonzero(found)


_ALL, _LOW, _HIGH = slice(None), slice(None, -1), slice(1, None)
_PAIRS = (((_ALL, _LOW), (_ALL, _HIGH)), ((_LOW, _ALL), (_HIGH, _ALL)), ((_LOW, _LOW), (_HIGH, _HIGH)),
          ((_LOW, _HIGH), (_HIGH, _LOW)))  # fmt: skip


def _doubted(bodies: Body, met: np.ndarray, pixels: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Which of the pixels' rays from o along d, components (3, k) or (3, 1), float32 may have judged wrongly: (k,).

    `met` (H, W): what Mitsuba says that each pixel's ray meets, -1 for nothing.
    """
    doubted = np.zeros(len(pixels), bool)
    v, u = np.divmod(pixels, met.shape[1])
    own = met[v, u]
    first = np.where(own >= 0, distance(np, bodies.at(own), o, d), np.inf)
    for down, right in np.ndindex(3, 3):
        near = met[np.clip(v + down - 1, 0, met.shape[0] - 1), np.clip(u + right - 1, 0, met.shape[1] - 1)]
        body = bodies.at(near)
        with np.errstate(all="ignore"):
            t = distance(np, body, o, d)
            alike = (near != own) & (abs(t - first) < 10 * EDGE_TOLERANCE * t)  # where two objects cut each other
            doubted |= (near >= 0) & (alike | _grazes(body, o, d))
    return doubted


def _grazes(body: Body, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether the ray passes the body's outline within EDGE_TOLERANCE of the distances from the eye."""
    f = o - body.center
    b, away, far = dot(f, d), dot(f, f), np.sqrt(dot(o, o))
    off_rim = abs(np.sqrt(np.maximum(away - b * b, 0)) - body.radius)
    toward = dot(d, body.n)
    t = -dot(f, body.n) / toward
    p = f + t * d
    off_edge = np.minimum(*(abs(abs(dot(p, e)) - 1) / np.sqrt(dot(e, e)) for e in (body.u, body.v)))
    to_rim, to_edge = (
        off_rim < EDGE_TOLERANCE * (far + np.sqrt(away)),
        ~(off_edge * abs(toward) > EDGE_TOLERANCE * (far + abs(t))),
    )
    return np.asarray(np.where(body.round, to_rim, to_edge))


def trace(bodies: Body, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the rays from o along d, components (3, k) or (3, 1), meet first: ids (k,), -1 for nothing, and how far."""
    k = max(o.shape[1], d.shape[1])
    ids, t = np.full(k, -1, np.int32), np.full(k, np.inf)
    with np.errstate(all="ignore"):
        for i in range(len(bodies.radius)):
            here = distance(np, bodies.at(i), o, d)
            ids, t = np.where(here < t, np.int32(i), ids), np.minimum(here, t)
    return ids, np.where(ids < 0, 0, t)
