"""What a scene does not need: each thing by measurement, beside what closed forms prove of it."""

from collections.abc import Iterable
from typing import NamedTuple

import msgspec
import numpy as np

from raytwin.analysis.light_parts import gone
from raytwin.analysis.recommend.converged import Error, measure
from raytwin.analysis.recommend.recommendation import NotNeeded
from raytwin.analysis.recommend.search import Search
from raytwin.scene import Camera, Environment, Scene
from raytwin.scene.lens import distort, newton, without_ray

STILL = 0.05
"""Pixels: a term of the lens that moves none by more is not needed."""

TERMS = "k1", "k2", "p1", "p2", "k3"


class Moves(NamedTuple):
    """Terms of a distortion, and by how many pixels leaving them out moves any: `measured`, and the `bound`."""

    terms: tuple[str, ...]
    measured: float
    bound: float


def still_terms(camera: Camera) -> Moves:
    """The terms that can be left out together, the others as they are, without moving a pixel by STILL.

    Each term moves the ideal point (x, y) by a homogeneous polynomial of degree 3, 5, 7 (k) or 2 (p), which grows along
    every ray from the middle: the largest move is on the frame's border. Between two places there, half a pixel apart,
    it is less than the larger of both and an eighth of the second difference; the bound takes all of that, and adds the
    terms up. None where the lens folds back within the frame.
    """
    if not any(camera.dist) or without_ray(camera) is not None:
        return Moves((), 0.0, 0.0)
    w, h = camera.image_size
    us, vs = np.linspace(-0.5, w - 0.5, 2 * w + 1), np.linspace(-0.5, h - 0.5, 2 * h + 1)
    sides = [(us, -0.5 + 0 * us), (w - 0.5 + 0 * vs, vs), (us[::-1], h - 0.5 + 0 * us), (-0.5 + 0 * vs, vs[::-1])]
    u, v = (np.concatenate(a) for a in zip(*sides, strict=True))
    x, y = newton((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, camera.coefficients)
    moves = {}
    for i, term in enumerate(TERMS):
        if camera.coefficients[i]:
            only = [c if k == i else 0.0 for k, c in enumerate(camera.coefficients)]
            dx, dy = (after - before for after, before in zip(distort(x, y, only), (x, y), strict=True))
            moves[term] = np.stack([camera.fx * dx, camera.fy * dy])
    bounds = {term: float(np.hypot(*move).max() + _bend(move)) for term, move in moves.items()}
    left: list[str] = []
    for term in sorted(bounds, key=bounds.__getitem__):
        if sum(bounds[t] for t in (*left, term)) < STILL:
            left.append(term)
    together = sum((moves[t] for t in left), np.zeros((2, 1)))
    return Moves(tuple(t for t in TERMS if t in left), float(np.hypot(*together).max()), sum(bounds[t] for t in left))


def _bend(move: np.ndarray) -> float:
    """The largest second difference along the border: corners, where it turns, make it larger, never smaller."""
    return float(np.abs(np.diff(move, 2, axis=1)).max())


def not_needed(look: Search) -> tuple[NotNeeded, ...]:
    """Each thing alone: what lies below the tolerance by measurement, beside what is proven of it."""
    return (*_lens(look), *_light(look), *_map(look), *_bounces(look), *_unseen(look))


def _lens(look: Search) -> Iterable[NotNeeded]:
    moves = still_terms(look.scene.camera)
    if moves.terms:
        why = f"without {' and '.join(moves.terms)} no pixel moves by {STILL:g} px"
        yield NotNeeded(f"distortion {', '.join(moves.terms)}", why, moves.bound, moves.measured)


def _light(look: Search) -> Iterable[NotNeeded]:
    parts = (
        ("shadow", "shadows of the sun", look.bounds.shadow()),
        ("occlusion", "occlusion of the sky", look.bounds.occlusion()),
    )
    for part, what, largest in parts:
        error = look.low.of(look.metric, part)
        if error.most <= look.tolerance:
            yield NotNeeded(what, _below(look, error), look.bound(largest), error.value)


def _bounces(look: Search) -> Iterable[NotNeeded]:
    names = [name for name in look.low.parts[0] if name.startswith("bounce")]
    for n in range(len(names)):
        error = look.low.of(look.metric, *names[n:])
        if error.most <= look.tolerance:
            bounds = ((k, look.bound(look.bounds.beyond(k))) for k in range(n, 1000))
            proven = next((k for k, most in bounds if most is not None and most <= look.tolerance), None)
            why = _below(look, error) + (
                f"; beyond bounce {proven} the bound alone proves it" if proven is not None else ""
            )
            what = "bounces" if n == 0 else f"bounces beyond {n}"
            yield NotNeeded(what, why, look.bound(look.bounds.beyond(n)), error.value)
            return


def _unseen(look: Search) -> Iterable[NotNeeded]:
    """Spheres whose boxes hold no pixel, taken away one by one, from the same random numbers."""
    scene = look.thin
    unseen = [i for i, thing in enumerate(scene.objects) if thing in scene.spheres and not look.bounds.seen[i]][:8]
    for i in unseen:
        others = tuple(gone(thing) if i == k else thing for k, thing in enumerate(scene.objects))
        error = _changed(look, msgspec.structs.replace(scene, objects=others))
        if error.most <= look.tolerance:
            why = f"no pixel sees it, and what it does to the light of others is {_below(look, error)}"
            yield NotNeeded(scene.names[i], why, look.bound(look.bounds.without(i)), error.value)


def _map(look: Search) -> Iterable[NotNeeded]:
    """The coarsest map, texels averaged two by two, with which all lower rungs of that ladder meet the tolerance."""
    around, found = look.thin.environment, None
    texels = around.radiance if around is not None else np.empty((0, 0, 3))
    while len(texels) >= 4 and len(texels) % 2 == 0:
        rows = len(texels) // 2
        edges = np.cos(np.arange(2 * rows + 1) * np.pi / (2 * rows))
        weight = -np.diff(edges).reshape(rows, 2)
        pairs = texels.reshape(rows, 2, 2 * rows, 2, 3).mean(axis=3)
        texels = np.einsum("rp,rpcd->rcd", weight / weight.sum(axis=1, keepdims=True), pairs)
        coarse = Environment((2 * rows, rows), np.ascontiguousarray(texels, "<f4").tobytes())
        lights = tuple(coarse if isinstance(light, Environment) else light for light in look.thin.lights)
        error = _changed(look, msgspec.structs.replace(look.thin, lights=lights))
        if error.most > look.tolerance:
            break
        found = rows, error
    if found:
        why = f"{look.metric} {found[1].value:.2g} <= {look.tolerance:g} with a map of {found[0]} rows"
        yield NotNeeded(f"a map of more than {found[0]} rows", why, None, found[1].value)


def _changed(look: Search, scene: Scene) -> Error:
    """How far the image of another `scene` is from that of the probed one, from the same random numbers."""

    def whole(seed: int, scene: Scene | None = None) -> np.ndarray:
        return np.asarray(sum(look.parts(min(look.low.samples, 64), seed, scene).values(), np.float32(0)))

    one, other = (whole(seed, scene) - whole(seed) for seed in (1, 2))
    return measure(look.metric, one, other, look.low.mean, look.low.sampled)


def _below(look: Search, error: Error) -> str:
    return f"{look.metric} {error.value:.2g} <= {look.tolerance:g} without"
