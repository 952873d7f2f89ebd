"""The test of a shift: how often it sees a quarter of a pixel, and how often it sees one that is not there."""

import numpy as np
from measure.noise_models import render

from raytwin.compare import compare
from raytwin.compare.shift import find_shift
from raytwin.compare.significance import two_sided


def wave(dx: float, height: int = 48, width: int = 64) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return (0.5 + 0.2 * np.sin((x - dx) / 3) + 0.2 * np.sin(y / 4))[..., None] * np.array([1, 0.8, 0.6])


def test_more_samples_see_a_shift_no_worse():
    """Exponential noise: 85 of 100 renders of 16 samples show a quarter of a pixel, and all of more."""
    seen = []
    for samples in (16, 64, 256, 1024, 4096):
        rng = np.random.default_rng(samples)
        pairs = [
            (
                render(rng, wave(0.25), samples=samples, kind="exp", sd=1.0),
                render(rng, wave(0.0), samples=16384, kind="exp", sd=1.0),
            )
            for _ in range(6)
        ]
        seen.append(sum("shifted by" in " ".join(compare(*pair).reasons) for pair in pairs))
    assert seen[0] >= 3
    assert seen[1:] == [6, 6, 6, 6]


def test_a_shift_is_seen_where_there_is_none_as_seldom_as_its_sigma_says():
    """At a level of 1 %, at most 7 of 100 pairs of either kind: chance exceeds that once in 100 000 times."""
    for kind in ("gauss", "exp"):
        rng, wrong = np.random.default_rng([8, len(kind)]), 0
        for _ in range(100):
            shift = find_shift(*(render(rng, wave(0.0), samples=n, kind=kind, sd=1.0).mean for n in (16, 256)))
            assert shift is not None
            wrong += float(two_sided(max(abs(shift.dx), abs(shift.dy)) / shift.sigma, shift.dof)) < 0.005
        assert wrong <= 7
