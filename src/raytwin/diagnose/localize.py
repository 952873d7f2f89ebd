"""Where pictures are wrong, in words: on which objects, lit or in shadow, at outlines or inside, in which scenes."""

from collections.abc import Sequence

import numpy as np

from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import Array, Predictor
from raytwin.scene import Scene, Sphere

MUCH, LITTLE = 0.05, 0.005
"""A region is wrong where more of its pixels are, and right where fewer are."""
KINDS = ("spheres", "planes", "the background")
LIGHTS = ("in sunlight", "facing away from the sun", "in cast shadow")


def whereabouts(samples: Sequence[PixelSample], errors: Sequence[Array]) -> str:
    """`wrong only in cast shadow on spheres, right elsewhere`; `errors`: of each sight's pixels."""
    known = [k for k, s in enumerate(samples) if isinstance(s.bench, Predictor)]
    if not known:
        return ""
    samples, errors = [samples[k] for k in known], [errors[k] for k in known]
    bad = [e > s.tau for e, s in zip(errors, samples, strict=True)]
    share = [float((s.weight * b).sum()) for s, b in zip(samples, bad, strict=True)]
    if not any(share):
        return "right everywhere"
    table = np.zeros((3, 3, 2, 2))  # kind, light, outline, (all, wrong)
    for s, b, some in zip(samples, bad, share, strict=True):
        if some < min(1e-4, max(share)):
            continue
        kind, light = _regions(s)
        for wrong in (0, 1):
            np.add.at(table[..., wrong], (kind, light, s.edge.astype(int)), s.weight * (b if wrong else 1.0))
    return _said(table) + _scenes(samples, share) + _objects(samples, bad)


def points_of_misses(samples: Sequence[PixelSample]) -> str:
    """A point of a ray that meets nothing, where such points alone are wrong: in words; else empty."""
    spoilt = [s for s in samples if s.wrong.any()]
    said = []
    for s in spoilt:
        if not (s.view.points and isinstance(s.bench, Predictor)):
            return ""
        missed = np.isnan(s.right).any(axis=-1)
        shown = s.shown[missed]
        if (s.wrong & ~missed).any() or (s.wrong & missed).sum() < 0.99 * missed.sum() or np.isnan(shown).any():
            return ""
        said.append(f"as ({', '.join(f'{x:.4g}' for x in shown[0])})")
    return said[0] if said else ""


def _regions(sight: PixelSample) -> tuple[Array, Array]:
    """Return for each pixel the index of its row in KINDS and in LIGHTS."""
    assert isinstance(sight.bench, Predictor)
    with np.errstate(all="ignore"):
        seen = sight.bench.seen()
    spheres = np.array([isinstance(x, Sphere) for x in sight.bench.scene.objects] + [False])
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
            return "wrong only at outlines, right inside"
        scattered = 100 * table[..., 1].sum() / table[..., 0].sum()
        most = np.unravel_index(np.argmax(table[..., 1].sum(axis=2)), (3, 3))
        return f"wrong in single pixels ({scattered:.2g} %), most {_name(int(most[0]), {int(most[1])}, {int(most[1])})}"
    if wrong[there].all():
        return "wrong everywhere"
    named = []
    for kind in range(3):
        has = {k for k in range(3) if there[kind, k]}
        at = {k for k in has if wrong[kind, k]}
        if at:
            named.append(_name(kind, at, has))
    clean = not (there & ~wrong & (rate > LITTLE)).any()
    text = _listed(named)
    return f"wrong only {text}, right elsewhere" if clean else f"wrong {text}, mostly right elsewhere"


def _name(kind: int, at: set[int], has: set[int]) -> str:
    if kind == 2:
        return "in the background"
    lights = "" if at == has and len(has) > 1 else " or ".join(LIGHTS[k] for k in sorted(at)) + " "
    return f"{lights}on {KINDS[kind]}" if lights else f"on {KINDS[kind]}"


def _scenes(samples: Sequence[PixelSample], share: Sequence[float]) -> str:
    right = [_scene(s).name for s, x in zip(samples, share, strict=True) if x < 1e-4]
    return f"; all of {', '.join(right)} is right" if right else ""


def _objects(samples: Sequence[PixelSample], bad: Sequence[Array]) -> str:
    """Where some of a scene's spheres are wrong and others are not."""
    said = []
    for s, b in zip(samples, bad, strict=True):
        assert isinstance(s.bench, Predictor)
        ids, names = s.bench.seen().ids, s.bench.scene.names
        inside = ~s.edge
        rates = {}
        for index, (name, thing) in enumerate(zip(names, s.bench.scene.objects, strict=True)):
            here = (ids == index) & inside
            if isinstance(thing, Sphere) and s.weight[here].sum() > 1e-3:
                rates[name] = float((s.weight * b)[here].sum() / s.weight[here].sum())
        wrong = [name for name, rate in rates.items() if rate > MUCH]
        if wrong and any(rate < LITTLE for rate in rates.values()):
            said.append(f"{_listed(wrong)} of {_scene(s).name}")
    return f"; of the spheres only {'; '.join(said[:3])}" if said else ""


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _scene(sight: PixelSample) -> Scene:
    assert isinstance(sight.bench, Predictor)
    return sight.bench.scene
