"""Pixels that show a mixture: what is seen at several places around their centres, averaged or drawn by chance."""

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from raytwin.diagnose.budget import Budget
from raytwin.diagnose.changes import SAMPLING, Fault, moved, row
from raytwin.diagnose.pixel_sample import PixelSample
from raytwin.diagnose.predict import RIGHT, Array, Pipeline, replaced

REACHES = (0.5, 1.0)
"""Pixels: predictions are made this far and half as far from each pixel's centre, to each side."""
MOST = 0.97
"""Least share of the wrong pixels that lies between what is seen around them."""
ALONG = 0.2
"""Least share of the pixels beside outlines that is wrong; rounding alone moves a few of them."""
BLENDED = 0.15
"""Least share of the wrong pixels at outlines that shows a mixture of both sides."""
APART = 0.1
"""Share of the difference between both sides: a value farther than this from everything seen around is a mixture."""
AT_RANDOM = 0.5
"""Mean product of neighbours' signs, below which errors inside objects go by chance: rays through places of their own,
where an object of another shape or place moves whole regions alike."""
BESIDE = row(
    "beside-the-centre", SAMPLING,
    "what your pixels show lies between what is seen around their centres: several rays a pixel are averaged, or rays "
    "go through places of their own, at random or a little off; here one ray goes through each pixel's centre, (u, v)",
)  # fmt: skip


def mean_of(places: Iterable[tuple[float, float]]) -> Pipeline:
    """The mean of rays through several places about the pixel's centre."""
    chosen = tuple(places)
    return replaced(spread=lambda _: chosen)


def grid(n: int, low: float, high: float) -> Pipeline:
    """The mean of n x n rays from `low` to `high` in both directions, pixels."""
    return mean_of(product(np.linspace(low, high, n).tolist(), repeat=2))


BLENDS = "each pixel is the mean of several rays (anti-aliasing), which blends outlines and the edges of shadows"
ONE_RAY = "here a pixel shows what the one ray through its centre, (u, v), meets"
AVERAGED = (
    row("averaged-over-pixel", SAMPLING, f"{BLENDS}: {ONE_RAY}",
        *(grid(n, 0.5 / n - 0.5, 0.5 - 0.5 / n) for n in (2, 3, 4)), *(grid(n, -0.5, 0.5) for n in (2, 3))),
    row("averaged-from-corner", SAMPLING,
        f"{BLENDS}, and the rays are spread to one side of (u, v) as if that were the pixel's corner: {ONE_RAY}",
        *(grid(n, 0.5 / n, 1 - 0.5 / n) for n in (2, 3, 4)), *(grid(n, 0.0, 1 - 1 / n) for n in (2, 3, 4)),
        grid(2, 0.0, 1.0)),
)  # fmt: skip


def along_outlines(samples: Sequence[PixelSample]) -> float:
    """The share of the pixels beside outlines that is wrong; of points, which have none, 0."""
    seen = [s for s in samples if not s.view.points]
    edge = sum(float((s.weight * s.edge).sum()) for s in seen)
    return sum(float((s.weight * s.edge * s.wrong).sum()) for s in seen) / edge if edge else 0.0


def between(samples: Sequence[PixelSample], budget: Budget | None = None) -> tuple[Fault, float] | None:
    """The fault, and the share of the squared error that it explains; None where it is not that, or time is up."""
    budget = budget or Budget()
    if any(s.view.points or s.view.scene is None for s in samples) or along_outlines(samples) <= ALONG:
        return None
    for reach in REACHES:
        inside, wrong, before, after, blends = 0.0, 0.0, 0.0, 0.0, []
        for s in samples:
            places = list(product((-reach, -reach / 2, 0.0, reach / 2, reach), repeat=2))
            rows = [s.predict(moved(x, y)) for x, y in budget.within(BESIDE.name, places)]
            if len(rows) < len(places):
                return None
            seen = np.stack(rows)
            near = np.clip(s.shown, seen.min(axis=0), seen.max(axis=0))
            wrong += float((s.weight * s.wrong).sum())
            close = (s.off(near) <= 4 * s.tau) & (s.off(near) <= s.errors(RIGHT) / 2)
            inside += float((s.weight * s.wrong * close).sum())
            blends.append(_blended(s, seen))
            before, after = before + s.squared(s.predict(RIGHT)), after + s.squared(near)
        blended = float(np.concatenate(blends).mean()) > BLENDED if sum(map(len, blends)) else False
        if wrong > 0 and inside > MOST * wrong and (blended or _signs(samples) < AT_RANDOM):
            return BESIDE, 1 - after / before if before > 0 else 1.0
    return None


def _blended(sight: PixelSample, seen: Array) -> Array:
    """Return for each wrong pixel beside an outline whether it shows a mixture of both sides; `seen` is (K, N, 3)."""
    span = (seen.max(axis=0) - seen.min(axis=0)).max(axis=-1)
    nearest = np.abs(sight.shown - seen).max(axis=-1).min(axis=0)
    return np.asarray((nearest > APART * span)[sight.wrong & sight.edge & (span > APART * sight.scale)])


def _signs(samples: Sequence[PixelSample]) -> float:
    """The mean product of the signs of two neighbouring errors, inside objects: 0 by chance, 1 of whole regions."""
    products = []
    for s in samples:
        assert s.view.right is not None
        off = s.view.shown - s.view.right
        signs = np.sign(off) * (np.abs(off) > s.tau) * ~s.whole[0][..., None]
        pairs = signs[:, 1:] * signs[:, :-1]
        products.append(pairs[pairs != 0])
    every = np.concatenate(products)
    return float(every.mean()) if every.size else 1.0
