"""The decision on noisy images: how often it fails correct ones, and what it sees. Noise is made up."""

from dataclasses import replace

import numpy as np
import pytest
from measure import noise_models
from measure.noise_models import KINDS, UNSEEN, picture

from raytwin.compare import compare
from raytwin.compare.decision import decide
from raytwin.compare.exact import count_noise_free
from raytwin.compare.scale import Bound
from raytwin.images.image import Image, Surface
from raytwin.scene import Tolerance

H, W = 40, 56
TRUTH = picture(H, W)


def render(rng, truth=TRUTH, **settings):
    return noise_models.render(rng, truth, **settings)


def exact():
    return noise_models.exact(TRUTH)


# ----------------------------------------------------------------------------------------------------- false alarms

RATE, TRIALS, MOST = 0.05, 32, 8
"""Nine alarms in 32 have a probability of 2e-5 at the stated rate, and of a sixth at four times it."""

SMALL = picture(24, 32)

LARGE = ("rare events against the exact image",)
"""In a picture of 768 pixels some meet no event at all: 16 of 60 alarms."""


FILMS, MOST_OF_FILMS = ("tent filter", "Mitsuba's default film", "Gaussian filter, 1 pixel"), 5
"""Kinds that take longest: half as many trials, of which six alarm with a probability of 8e-5 at the stated rate."""


def alarms(name, understated=1.0):
    rng = np.random.default_rng(sum(map(ord, name)))
    count = 0
    for _ in range(TRIALS // 2 if name in FILMS else TRIALS):
        pair = [
            i if i.variance is None else replace(i, variance=i.variance / np.float32(understated))
            for i in KINDS[name](rng, TRUTH if name in LARGE else SMALL)
        ]
        count += compare(*pair, false_alarm_rate=RATE).verdict == "fail"
    return count


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in KINDS if name != UNSEEN])
def test_noise_alone_fails_no_more_often_than_stated(name):
    assert alarms(name) <= (MOST_OF_FILMS if name in FILMS else MOST)


def test_the_count_of_false_alarms_would_show_a_variance_that_is_too_small():
    assert alarms("Gaussian against a reference", understated=4.0) > MOST


def test_a_render_that_missed_every_rare_event_is_excused_by_a_reference_that_saw_them():
    rng = np.random.default_rng(19)
    rare = {"p": 1e-4, "size": 1e2, "sd": 0.0}
    missed = Image(TRUTH.astype(np.float32), np.full(TRUTH.shape, 1e-34, np.float32), 16, None, 16)
    assert compare(missed, render(rng, samples=4096, **rare)).verdict != "fail"


def calm_beside_noise(seed, surface=None):
    """Renders of 64 and 4096 samples, in 20 columns of which all samples agree."""
    rng = np.random.default_rng(seed)
    a, b = render(rng, samples=64), render(rng, samples=4096)
    for image in (a, b):
        image.mean[:, :20] = TRUTH[:, :20]
        image.variance[:, :20] = 0
    return a, replace(b, surface=surface)


def test_the_background_of_a_sampled_image_is_compared_exactly():
    seen = Surface.empty(W, H)
    seen.ids[:, 20:] = 0
    a, b = calm_beside_noise(7, seen)
    assert compare(a, b).passed
    a.mean[10, 5] += np.float32(1e-3)
    c = compare(a, b)
    assert not c.passed
    assert "(x=5, y=10)" in c.reasons[0]


@pytest.mark.parametrize(("p", "size", "samples"), [(0.003, 2.0, 16), (0.01, 1.0, 16), (0.003, -0.9, 24)])
def test_a_correct_render_does_not_fail_by_events_that_tiles_have_missed(p, size, samples):
    """Events of a few per cent of the light, of which tiles have 3, 10 or 5; the last are dark (stated 1e-3).

    Where only the largest bright ones were counted, in units of radiance, most of these renders failed.
    """
    rng, events = np.random.default_rng(29), {"p": p, "size": size, "proportional": True}
    reference = noise_models.exact(TRUTH, **events)
    for _ in range(10):
        assert compare(render(rng, samples=samples, sd=0.03, kind="exp", **events), reference).verdict != "fail"


def test_samples_that_all_agree_may_have_missed_what_is_rare():
    """An occluder that hides p of the sky is missed by 64 samples with exp(-64 p), by those of 16 x 16 pixels never."""
    a, b = calm_beside_noise(7)
    b.variance[:, :20] = 0
    exact_part = TRUTH[:, :20].astype(np.float32)
    for p, pixels, verdict in (
        (0.1, np.s_[10, 5], "pass"),
        (1e-3, np.s_[8:16, 8:16], "pass"),
        (0.01, np.s_[:32, :16], "fail"),
        (1.0, np.s_[10, 5], "fail"),
    ):
        a.mean[:, :20] = exact_part
        a.mean[pixels] *= np.float32(1 - p)
        assert compare(a, b).verdict == verdict, (p, pixels)


@pytest.mark.parametrize("hidden", [1e-4, 1e-3, 5e-3])
def test_a_closed_form_is_not_failed_by_samples_that_missed_a_rare_occluder(hidden):
    """Of 20 renders whose samples see all of the sky but for a share that nearly all miss none fails (1e-3 stated)."""
    rng = np.random.default_rng(8)
    y = np.linspace(0, 1, H)[:, None, None]
    truth = 1 - hidden * (1 - y) * np.ones((H, W, 3))
    truth[-8:] = 0.5  # where the occluder is near, all is noisy
    test = Image(truth.astype(np.float32), np.zeros(truth.shape, np.float32), 64, None, 16)
    for _ in range(20):
        seen = rng.binomial(4, truth[None, ..., :1], (16, H, W, 1)).repeat(3, axis=-1) / 4
        reference = Image(seen.mean(0).astype(np.float32), (seen.var(0, ddof=1) / 16).astype(np.float32), 64, None, 16)
        assert compare(test, reference).verdict != "fail"


def test_noise_below_the_tolerance_is_no_noise():
    rng = np.random.default_rng(8)
    a, b = (render(rng, sd=1e-6) for _ in range(2))
    assert compare(a, b).passed
    a.mean[10, 5] += np.float32(9e-5)
    assert compare(a, b).passed  # one pixel of few thousand beyond the tolerance, not beyond ten times it
    assert not compare(a, b, tolerance=Tolerance(p999_abs=1e-6)).passed


# ------------------------------------------------------------------------------------------------------------ power


def test_one_wrong_pixel_fails_and_is_located():
    rng = np.random.default_rng(12)
    a = render(rng, samples=64)
    a.mean[30, 7] = 2.0
    c = compare(a, render(rng, samples=4096))
    assert not c.passed
    (said,) = (r for r in c.reasons if "the pixel (x=7, y=30) is" in r)
    assert "other" not in said
    assert c.statistics.pixel_fail_fraction == pytest.approx(1 / (H * W))
    a.mean[11, 9] = 2.0
    two = compare(a, render(rng, samples=4096))
    assert any(r.endswith("; so is 1 other pixel") for r in two.reasons), two.reasons


def test_a_noisy_neighbour_excuses_no_wrong_pixel():
    """An error of 20 standard deviations; with the neighbour's it would be one of 4."""
    rng = np.random.default_rng(23)
    a, b = render(rng, samples=64), render(rng, samples=4096)
    a.variance[30, 8] *= 20
    a.mean[30, 7] += 20 * np.sqrt(a.variance[30, 7])
    worst = decided(a, b).value
    assert (worst.passed, worst.worst.x, worst.worst.y) == (False, 7, 30)


def test_black_rows_fail_even_with_no_variance_of_their_own():
    rng = np.random.default_rng(13)
    a = render(rng)
    a.mean[20], a.variance[20] = 0, 0
    assert not compare(a, render(rng, samples=4096)).passed


def test_one_firefly_does_not_hide_a_wrong_tile():
    rng = np.random.default_rng(15)
    truth = TRUTH.copy()
    truth[16:32, 32:48] *= 1.1
    a = render(rng, truth, samples=64)
    a.mean[3, 3] += 5
    a.variance[3, 3] = 25
    c = compare(a, render(rng, samples=4096))
    assert any("tile at (x=32, y=16)" in r for r in c.reasons)


def test_a_shift_of_a_tenth_of_a_pixel_fails_before_any_tile_tells():
    rng = np.random.default_rng(16)

    def disc(dx):
        y, x = np.mgrid[:96, :128]
        return (0.2 + 0.6 * np.clip(30.5 - np.hypot(x - 60 - dx, y - 45), 0, 1))[..., None] * np.ones(3)

    reference = render(rng, disc(0), samples=1024, sd=0.25)
    c = compare(render(rng, disc(0.1), sd=0.25), reference)
    assert len(c.reasons) == 1
    assert c.reasons[0].startswith("the test image is shifted by (+0.1")
    assert compare(render(rng, disc(0), sd=0.25), reference).passed


def test_a_pass_says_what_it_could_have_seen_and_more_samples_see_more():
    rng = np.random.default_rng(17)
    reference = render(rng, samples=4096)
    few, many = (compare(render(rng, samples=n), reference) for n in (16, 256))
    for c in (few, many):
        assert c.passed
        bias = c.statistics.minimum_detectable_bias
        assert f"a brightness error of {100 * bias:.2g} %" in c.reasons[0]
        assert "in any 24 x 24 patch" in c.reasons[0]
    ratio = few.statistics.minimum_detectable_bias / many.statistics.minimum_detectable_bias
    assert ratio == pytest.approx(4, rel=0.15)


@pytest.mark.parametrize("dim", [0.0, 1e-4])
def test_a_channel_that_is_all_but_black_hides_no_error_of_the_others(dim):
    """What could be seen is told of the channels that give light."""
    colour = np.array([1.0, 0.5, dim])
    found = [compare(render(np.random.default_rng(19), TRUTH * c), noise_models.exact(TRUTH * c)) for c in (1, colour)]
    assert all(c.passed for c in found)
    seen = [c.statistics.minimum_detectable_bias for c in found]
    assert seen[1] == pytest.approx(seen[0], rel=0.3)


def test_a_bias_of_the_minimum_detectable_size_is_found_nine_times_in_ten_and_a_third_of_it_seldom():
    rng = np.random.default_rng(18)
    reference = exact()
    bias = compare(render(rng), reference, false_alarm_rate=0.01).statistics.minimum_detectable_bias

    def found(size):
        return sum(
            not compare(render(rng, TRUTH * (1 + size)), reference, false_alarm_rate=0.01).passed for _ in range(50)
        )

    assert found(bias) >= 40
    assert found(bias / 3) <= 20


# ------------------------------------------------------------------------------------------------------- the tests


def decided(a, b, **options):
    return decide(a, b, Bound(1e-5, 1.0), 1e-3, **options)


def test_four_kinds_of_tests_share_the_rate_and_each_its_own_among_its_values():
    """40 x 56 pixels: 5 x 7 tiles of 8, 4 x 6 of 16, then every second: 1 x 2 of 32, in three channels."""
    rng = np.random.default_rng(20)
    made = decided(render(rng), render(rng, samples=4096))
    share = 1 - (1 - 1e-3) ** (1 / 4)
    tiles = 3 * (5 * 7 + 4 * 6)
    for family, tests in ((made.value, H * W * 3), (made.tile, tiles), (made.image, 3)):
        assert family.tests == tests
        assert family.level == pytest.approx(1 - (1 - share) ** (1 / tests), rel=1e-9)
        assert family.passed == (family.worst.p >= family.level)
    assert decided(render(rng), render(rng, samples=4096), by_value=False).value.worst.p == 1


def test_the_worst_tile_tells_its_own_place_size_and_mean_error():
    rng = np.random.default_rng(21)
    a, b = render(rng, samples=256), render(rng, samples=4096)
    a.mean[8:24, 16:32, 1] += np.float32(0.1)
    tile = decided(a, b).tile
    w = tile.worst
    assert (w.x, w.y, w.width, w.height, w.channel) == (16, 8, 16, 16, 1)
    assert w.error == pytest.approx(float((a.mean - b.mean)[8:24, 16:32, 1].mean()), rel=1e-5)
    assert w.signed == w.z > 10
    a.mean[8:24, 16:32, 1] -= np.float32(0.2)
    w = decided(a, b).tile.worst
    assert w.signed == -w.z < -10
    image = decided(a, b).image.worst
    assert (image.x, image.y, image.width, image.height) == (0, 0, W, H)
    c = image.channel
    assert image.error == pytest.approx(float((a.mean - b.mean)[..., c].mean(dtype=float)), rel=1e-4)


def test_a_mean_s_deviation_is_that_of_independent_pixels():
    """Σ v / n² against the truth, beyond what is granted; no fireflies and no filter here."""
    rng = np.random.default_rng(22)
    a = render(rng, sd=0.2)
    image = decided(a, exact()).image.worst
    d = (a.mean - TRUTH)[..., image.channel].mean()
    sd = np.sqrt(a.variance[..., image.channel].sum(dtype=float)) / (H * W)
    granted = 1e-5 * max(1.0, TRUTH[..., image.channel].mean())
    assert image.z == pytest.approx((abs(d) - granted) / sd, rel=1e-3)


@pytest.mark.parametrize(("share", "noisy"), [(0.098, False), (0.102, True)])
def test_a_deviation_below_a_tenth_of_the_tolerance_is_silence(share, noisy):
    v = np.full((24, 24, 3), np.square(share * 1e-5), np.float32)
    a, b = (Image(np.full((24, 24, 3), 0.5, np.float32), v * k, 16, None, 16) for k in (1, 0))
    assert decided(a, b).noise_free.values == (0 if noisy else 24 * 24 * 3)


def test_every_tile_that_fails_is_told_and_none_that_does_not():
    """Two wrong corners of a noisy picture, and two wrong pixels of one without noise."""
    rng = np.random.default_rng(3)
    truth = np.full((96, 128, 3), 0.5, np.float32)
    sd = np.float32(0.02)
    noisy = [
        Image(
            (truth + sd * rng.normal(size=truth.shape)).astype(np.float32), np.full_like(truth, sd**2), 64, batches=16
        )
        for _ in range(2)
    ]
    noisy[0].mean[8:24, 96:112] += 0.1
    noisy[0].mean[64:72, 16:24] += 0.1
    wrong = np.zeros(truth.shape[:2], bool)
    wrong[8:24, 96:112] = wrong[64:72, 16:24] = True
    told = np.zeros_like(wrong)
    for x, y, w, h in compare(*noisy).failing:
        assert wrong[y : y + h, x : x + w].any()
        told[y : y + h, x : x + w] = True
    assert told[wrong].all()

    truth = truth[:90, :120]  # the last blocks are cut at both edges
    exact = Image(truth.copy())
    exact.mean[3, 5], exact.mean[80, 119, 1] = 0.6, 0.7
    assert set(compare(exact, Image(truth)).failing) == {(0, 0, 16, 16), (112, 80, 8, 10)}
    assert compare(Image(truth), Image(truth)).failing == ()


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
