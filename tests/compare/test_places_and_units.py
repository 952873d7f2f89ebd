"""Where the worst value is, in which units it is written, and whose degrees of freedom count."""

import numpy as np
import pytest

from raytwin.compare import compare
from raytwin.compare.decision import decide
from raytwin.compare.exact import count_noise_free
from raytwin.compare.noise import survey
from raytwin.compare.scale import Bound
from raytwin.image import Image


def test_the_worst_value_is_found_in_any_strip_and_its_share_is_counted():
    reference = np.ones((160, 1024, 3), np.float32)
    test = reference.copy()
    test[131, 700, 2] += 0.25
    test[90, 3:403, :] += 0.125
    quiet = count_noise_free(test, reference, Bound(1e-5, 1.0))
    assert (quiet.x, quiet.y, quiet.channel, quiet.error) == (700, 131, 2, 0.25)
    assert (quiet.over, quiet.values, quiet.outliers) == (1201, 491520, 401)
    first = compare(Image(test), Image(reference)).reasons[0]
    assert first.startswith("0.244 % of the noise-free values (1201 of 491520)")
    assert "(x=700, y=131), blue" in first


@pytest.mark.parametrize("swapped", [False, True])
def test_an_image_of_few_batches_is_trusted_less_however_well_the_other_is_known(swapped):
    rng = np.random.default_rng(6)
    truth = np.ones((48, 64, 3), np.float32)
    noisy = (truth + 0.1 * rng.normal(size=truth.shape)).astype(np.float32)
    v = np.full_like(truth, 0.01)
    known = Image(truth, v / 100, 4096, None, 256)
    pairs = [(Image(noisy, v, 256, None, n), known) for n in (4, 256)]
    few, many = (decide(*(pair[::-1] if swapped else pair), Bound(1e-5, 1.0), 1e-3) for pair in pairs)
    assert few.tile.detectable > 1.003 * many.tile.detectable
    assert few.value.worst.p > many.value.worst.p


def test_fireflies_at_the_borders_are_judged_by_their_neighbours_as_any_others():
    """Mirror images have mirrored fireflies: single ones, and pairs and clusters, which are none."""
    rng = np.random.default_rng(9)
    v = rng.uniform(0.5, 1, (40, 48, 3)).astype(np.float32) * np.float32(1e-4)
    single, pair, cluster = [(0, 5), (0, 0), (7, 0)], [(0, 20), (0, 21), (1, 20)], [(20, 0), (21, 0), (20, 1)]
    run = [(0, 32), (0, 33), (0, 34), (1, 33)]
    spots = [*single, *pair, *cluster, *run]
    for y, x in spots:
        v[y, x] = 1.0
    mean = np.full_like(v, 0.5)

    def places(flip) -> set[tuple[int, int]]:
        side = survey(Image(np.ascontiguousarray(flip(mean)), np.ascontiguousarray(flip(v)), 16, None, 16))
        assert side is not None
        marked = np.zeros(v.shape[:2])
        marked[side.fireflies[0], side.fireflies[1]] = 1
        return {(int(y), int(x)) for y, x in np.argwhere(flip(marked))}

    found = places(lambda x: x)
    assert found == set(single)
    for flip in (lambda x: x[::-1], lambda x: x[:, ::-1], lambda x: x[::-1, ::-1]):
        assert places(flip) == found
