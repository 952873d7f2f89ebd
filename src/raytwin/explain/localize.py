"""Where pictures are wrong, in words: on which objects, lit or in shadow, at outlines or inside, in which scenes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from raytwin.explain.pixel_sample import PixelSample
from raytwin.explain.predict import Array, Predictor, Seen
from raytwin.scene import Scene

MUCH, LITTLE = 0.05, 0.005
"""Share of a region's pixels that are wrong: above the first the region is wrong, below the second it is correct."""
HARDLY = 1e-4
"""Share of a picture's pixels: if fewer are wrong, the whole picture counts as correct."""
KINDS = ("spheres", "planes", "the background")
LIGHTS = ("in sunlight", "facing away from the sun", "in cast shadow")


def whereabouts(samples: Sequence[PixelSample], errors: Sequence[Array]) -> str:
    """`wrong only in cast shadow on spheres, correct elsewhere`; `errors`: of each sample's pixels.

    Then which scenes are correct, and which spheres are wrong where others are not. Empty of unknown scenes.
    """
    known = [(s, s.bench, e > s.tau) for s, e in zip(samples, errors, strict=True) if isinstance(s.bench, Predictor)]
    share = [float((s.weight * bad).sum()) for s, _, bad in known]
    if not any(share):
        return "correct everywhere" if known else ""
    table = np.zeros((3, 3, 2, 2))  # kind, light, outline; pixels, and wrong ones
    correct, wrong = [], []
    for (s, bench, bad), some in zip(known, share, strict=True):
        if some < min(HARDLY, max(share)):
            correct.append(bench.scene.name)
            continue
        seen = bench.seen()
        wrong += _wrong_spheres(s, bench.scene, seen, bad)
        for k, weight in enumerate((s.weight, s.weight * bad)):
            np.add.at(table[..., k], (*_regions(bench.scene, seen), s.edge.astype(int)), weight)
    scenes = f"all of {', '.join(correct)} is correct" if correct else ""
    spheres = f"of the spheres only {'; '.join(wrong[:3])}" if wrong else ""
    return "; ".join(filter(None, (_said(table), scenes, spheres)))


def points_of_misses(samples: Sequence[PixelSample]) -> str:
    """In words, the hit point of a ray that meets nothing, if exactly the points of such rays are wrong; else empty."""
    spoilt = [(s, np.isnan(s.correct).any(axis=-1)) for s in samples if s.wrong.any()]
    if not all(s.view.points and np.array_equal(s.wrong, missed) for s, missed in spoilt):
        return ""
    s, missed = spoilt[0]
    return f"as ({', '.join(f'{x:.4g}' for x in s.shown[missed][0])})"


SIDES: dict[str, Any] = {
    "first row": np.s_[0, :], "last row": np.s_[-1, :], "first column": np.s_[:, 0], "last column": np.s_[:, -1],
}  # fmt: skip


def border_alone(samples: Sequence[PixelSample]) -> str:
    """Such as `the last row and the last column`, if they are wrong and nothing inside the border is; else empty."""
    spoilt = [s.frame for s in samples if s.wrong.any()]
    if any(frame.step > 1 or frame.wrong[1:-1, 1:-1].any() for frame in spoilt):
        return ""
    return _listed([f"the {side}" for side, at in SIDES.items() if any(f.wrong[at].mean() > 0.5 for f in spoilt)])


def _regions(scene: Scene, seen: Seen) -> tuple[Array, Array]:
    """For each pixel the index of its row in KINDS and in LIGHTS."""
    spheres = np.arange(len(scene.objects) + 1) < len(scene.spheres)
    kind = np.where(seen.ids < 0, 2, np.where(spheres[seen.ids], 0, 1))
    light = np.where(seen.cos <= 0, 1, np.where(seen.visible, 0, 2))
    return kind, np.where(kind == 2, 0, light)


def _said(table: Array) -> str:
    inside, outline = table[:, :, 0], table[:, :, 1]
    with np.errstate(all="ignore"):
        rate = inside[..., 1] / inside[..., 0]
    there = inside[..., 0] > 1e-3 * inside[..., 0].sum()
    wrong = there & (rate > MUCH)
    if not wrong.any():
        if outline[..., 1].sum() > 4 * inside[..., 1].sum():
            return "wrong only at outlines, correct inside"
        scattered = 100 * table[..., 1].sum() / table[..., 0].sum()
        kind, light = np.divmod(int(np.argmax(table[..., 1].sum(axis=2))), 3)
        most = _region(kind, *2 * [np.arange(3) == light])
        return f"wrong in single pixels ({scattered:.2g} %), most {most}"
    if wrong[there].all():
        return "wrong everywhere"
    named = [_region(k, wrong[k], there[k]) for k in range(3) if wrong[k].any()]
    clean = not (there & ~wrong & (rate > LITTLE)).any()
    text = _listed(named)
    return f"wrong only {text}, correct elsewhere" if clean else f"wrong {text}, mostly correct elsewhere"


def _region(kind: int, wrong: Array, there: Array) -> str:
    if kind == 2:
        return "in the background"
    lights = [] if (wrong == there).all() and there.sum() > 1 else [LIGHTS[k] for k in np.flatnonzero(wrong)]
    return f"{' or '.join(lights)} on {KINDS[kind]}".strip()


def _wrong_spheres(s: PixelSample, scene: Scene, seen: Seen, bad: Array) -> list[str]:
    """`sphere 1 of desk`, where some of a scene's spheres are wrong and others are not."""
    rates = {}
    for k, name in enumerate(scene.names[: len(scene.spheres)]):
        weight = s.weight * ((seen.ids == k) & ~s.edge)
        if weight.sum() > 1e-3:
            rates[name] = float((weight * bad).sum() / weight.sum())
    wrong = [name for name, rate in rates.items() if rate > MUCH]
    return [f"{_listed(wrong)} of {scene.name}"] if wrong and min(rates.values()) < LITTLE else []


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
