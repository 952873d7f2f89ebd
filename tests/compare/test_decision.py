"""The decision on noisy images: what it sees, where, and by which numbers. Noise is made up."""

from dataclasses import replace

import numpy as np
import pytest
from measure import noise_models
from measure.noise_models import picture

from raytwin.compare import compare, decision
from raytwin.compare.decision import Deviations, decide, excluded_bias
from raytwin.compare.exact import Bound, count_noise_free
from raytwin.images.image import Image
from raytwin.scene import Tolerance

H, W = 40, 56
TRUTH = picture(H, W)
EXACT = noise_models.exact(TRUTH)


def render(rng, truth=TRUTH, **settings):
    return noise_models.render(rng, truth, **settings)


def decided(a, b, **options):
    return decide(a, b, Bound(1e-5, 1.0), 1e-3, **options)


def test_samples_that_all_agree_prove_little():
    """An occluder that hides p of the sky is missed by 64 samples with exp(-64 p), by those of 16 x 16 pixels never."""
    rng = np.random.default_rng(7)
    a, b = render(rng, samples=64), render(rng, samples=4096)
    for image in (a, b):
        image.mean[:, :20] = TRUTH[:, :20]
        image.variance[:, :20] = 0
    for p, pixels, verdict in (
        (0.1, np.s_[10, 5], "pass"),
        (1e-3, np.s_[8:16, 8:16], "pass"),
        (0.01, np.s_[:32, :16], "fail"),
        (1.0, np.s_[10, 5], "fail"),
    ):
        a.mean[:, :20] = TRUTH[:, :20].astype(np.float32)
        a.mean[pixels] *= np.float32(1 - p)
        c = compare(a, b)
        assert c.verdict == verdict, (p, pixels)
    assert any("the pixel (x=5, y=10)" in reason for reason in c.reasons)


def test_a_unit_of_radiance_changes_no_statistic():
    rng, unit = np.random.default_rng(9), np.float32(2.0**20)
    skewed = [render(rng, samples=16, kind="exp", sd=0.3) for _ in range(2)]
    skewed = [replace(one, third=np.full(one.shape, 1e-3, np.float32)) for one in skewed]
    large = [replace(i, mean=i.mean * unit, variance=i.variance * unit**2, third=i.third * unit**3) for i in skewed]
    assert compare(*large).statistics == compare(*skewed).statistics


def test_beside_a_noisy_reference_alone_the_samples_of_the_test_count_for_nothing():
    noisy, told = render(np.random.default_rng(10), samples=64), Image(TRUTH.astype(np.float32), samples=4)
    untold = replace(told, samples=0)
    assert compare(told, noisy, noise="reference").statistics == compare(untold, noisy, noise="reference").statistics


def test_noise_below_the_tolerance_is_no_noise():
    rng = np.random.default_rng(8)
    a, b = (render(rng, sd=1e-6) for _ in range(2))
    a.mean[10, 5] += np.float32(9e-5)
    assert compare(a, b).passed  # one pixel of few thousand beyond the tolerance, not beyond ten times it
    assert not compare(a, b, tolerance=Tolerance(p999_abs=1e-6)).passed
    for share, noisy in ((0.098, False), (0.102, True)):
        v = np.full((24, 24, 3), np.square(share * 1e-5), np.float32)
        a, b = (Image(np.full((24, 24, 3), 0.5, np.float32), v * k, 16, None, 16) for k in (1, 0))
        assert decided(a, b).noise_free.values == (0 if noisy else 24 * 24 * 3)


# ------------------------------------------------------------------------------------------------------------ power


def test_wrong_pixels_fail_and_are_located_whatever_their_neighbours():
    rng = np.random.default_rng(12)
    a, b = render(rng, samples=64), render(rng, samples=4096)
    a.mean[30, 7] = 2.0
    c = compare(a, b)
    (said,) = (r for r in c.reasons if "the pixel (x=7, y=30) is" in r)
    assert "other" not in said
    assert c.statistics.pixel_fail_fraction == pytest.approx(1 / (H * W))
    a.mean[11, 9] = 2.0
    assert any(r.endswith("; so is 1 other pixel") for r in compare(a, b).reasons)
    a, b = render(rng, samples=64), render(rng, samples=4096)
    a.variance[30, 8] *= 20  # with its neighbour's noise an error of 20 standard deviations would be one of 4
    a.mean[30, 7] += 20 * np.sqrt(a.variance[30, 7])
    worst = decided(a, b).value
    assert (worst.passed, worst.worst.x, worst.worst.y) == (False, 7, 30)
    a.mean[20], a.variance[20] = 0, 0
    assert not compare(a, b).passed


def test_a_wrong_tile_is_seen_among_many_fireflies():
    """Among 16 fireflies a tile that is a fifth too dark inflated its own variance, and was seen once in four."""
    rng, gain, seen = np.random.default_rng(15), np.ones((H, W, 1), np.float32), 0
    gain[16:32, 32:48] = 0.8
    for _ in range(8):
        a = noise_models.times(render(rng, samples=64, p=1e-3, size=30.0), gain)
        seen += compare(a, noise_models.exact(TRUTH, 1e-3, 30.0)).verdict == "fail"
    assert seen >= 5


def test_a_pass_says_what_it_could_have_seen_and_a_dim_channel_hides_nothing():
    """Sixteen times the samples see a quarter of the error."""
    rng = np.random.default_rng(17)
    reference = render(rng, samples=4096)
    found = [compare(render(rng, samples=n), reference) for n in (16, 256)]
    biases = [c.statistics.minimum_detectable_bias for c in found]
    for c, bias in zip(found, biases, strict=True):
        assert c.passed
        assert f"a brightness error of {100 * bias:.2g} %" in c.reasons[0]
        assert "in any 24 x 24 patch" in c.reasons[0]
    assert biases[0] / biases[1] == pytest.approx(4, rel=0.15)
    grey = compare(render(np.random.default_rng(19), TRUTH), EXACT).statistics.minimum_detectable_bias
    for dim in (0.0, 1e-4):
        dimmed = TRUTH * np.array([1.0, 0.5, dim])
        c = compare(render(np.random.default_rng(19), dimmed), noise_models.exact(dimmed))
        assert c.statistics.minimum_detectable_bias == pytest.approx(grey, rel=0.3), dim


def test_a_bias_of_the_minimum_detectable_size_is_found_nine_times_in_ten_and_a_third_of_it_seldom():
    rng = np.random.default_rng(18)
    bias = compare(render(rng), EXACT, false_alarm_rate=0.01).statistics.minimum_detectable_bias
    for size, least, most in ((bias, 40, 50), (bias / 3, 0, 20)):
        pairs = [(render(rng, TRUTH * (1 + size)), EXACT) for _ in range(50)]
        assert least <= sum(not compare(*pair, false_alarm_rate=0.01).passed for pair in pairs) <= most


# ------------------------------------------------------------------------------------------------------- the tests


def test_four_kinds_of_tests_share_the_rate_and_each_its_own_among_its_values():
    """40 x 56 pixels: 5 x 7 tiles of 8, 4 x 6 of 16, in three channels."""
    rng = np.random.default_rng(20)
    made = decided(render(rng), render(rng, samples=4096))
    share = 1 - (1 - 1e-3) ** (1 / 4)
    for family, tests in ((made.value, H * W * 3), (made.tile, 3 * (5 * 7 + 4 * 6)), (made.image, 3)):
        assert family.tests == tests
        assert family.level == pytest.approx(1 - (1 - share) ** (1 / tests), rel=1e-9)
        assert family.passed == (family.worst.p >= family.level)
    assert decided(render(rng), render(rng, samples=4096), by_value=False).value.worst.p == 1


def test_the_worst_tile_and_the_image_tell_their_own_place_size_and_mean_error():
    rng = np.random.default_rng(21)
    a, b = render(rng, samples=256), render(rng, samples=4096)
    for sign in (1, -1):
        a.mean[8:24, 16:32, 1] = b.mean[8:24, 16:32, 1] + np.float32(0.1 * sign)
        made = decided(a, b)
        w = made.tile.worst
        assert (w.x, w.y, w.width, w.height, w.channel) == (16, 8, 16, 16, 1)
        assert w.error == pytest.approx(0.1 * sign, rel=1e-5)
        assert w.signed == sign * w.z
        assert w.z > 10
    image = made.image.worst
    assert (image.x, image.y, image.width, image.height) == (0, 0, W, H)
    assert image.error == pytest.approx(float((a.mean - b.mean)[..., image.channel].mean(dtype=float)), rel=1e-4)
    assert image.radiance == pytest.approx(float(b.mean[..., image.channel].mean(dtype=float)), rel=1e-4)
    a = render(np.random.default_rng(22), sd=0.2)  # no rare events and no filter: Σ v / n²
    image = decided(a, EXACT).image.worst
    sd = np.sqrt(a.variance[..., image.channel].sum(dtype=float)) / (H * W)
    granted = 1e-5 * max(1.0, TRUTH[..., image.channel].mean())
    assert image.z == pytest.approx((abs(image.error) - granted) / sd, rel=1e-3)


def test_an_excluded_bias_is_ten_times_less_likely_than_none():
    """Wald's likelihood ratio of a bias b beyond what is granted: exp((b² / 2 - b |error|) / sd²)."""
    error, sd, granted = np.random.default_rng(15).uniform(0.1, 2, (3, 50, 3))
    found = excluded_bias(Deviations(error, sd, np.full(error.shape, np.inf), granted, error, error, error)) - granted
    np.testing.assert_allclose((found**2 / 2 - found * error) / sd**2, np.log(10), rtol=1e-9)


def test_every_tile_that_fails_is_told_and_none_that_does_not():
    """Two wrong corners of a noisy picture, and two wrong pixels of one without noise."""
    rng, truth, sd = np.random.default_rng(3), np.full((96, 128, 3), 0.5, np.float32), np.float32(0.02)
    noisy = [(truth + sd * rng.normal(size=truth.shape)).astype(np.float32) for _ in range(2)]
    wrong = np.zeros(truth.shape[:2], bool)
    wrong[8:24, 96:112] = wrong[64:72, 16:24] = True
    noisy[0][wrong] += 0.1
    told = np.zeros_like(wrong)
    for x, y, w, h in compare(*(Image(i, np.full_like(truth, sd**2), 64, batches=16) for i in noisy)).failing:
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
    quiet = count_noise_free(np.abs(test - reference), test.size, Bound(1e-5, 1.0), reference)
    assert (quiet.x, quiet.y, quiet.channel, quiet.error) == (700, 131, 2, 0.25)
    assert (quiet.over, quiet.values, quiet.outliers) == (1201, 491520, 401)
    first = compare(Image(test), Image(reference)).reasons[0]
    assert first.startswith("0.244 % of the noise-free values (1201 of 491520)")
    assert "(x=700, y=131), blue" in first


def test_an_image_of_few_batches_is_trusted_less_however_well_the_other_is_known():
    rng, truth = np.random.default_rng(6), np.ones((48, 64, 3), np.float32)
    noisy, v = (truth + 0.1 * rng.normal(size=truth.shape)).astype(np.float32), np.full_like(truth, 0.01)
    known = Image(truth, v / 100, 4096, None, 256)
    for swap in (1, -1):
        few, many = (decided(*(Image(noisy, v, 256, None, n), known)[::swap]) for n in (4, 256))
        assert few.tile.detectable > 1.003 * many.tile.detectable
        assert few.value.worst.p > many.value.worst.p


def test_a_value_is_forgiven_the_light_of_events_that_its_block_may_have_missed():
    """One block, sd 0.01: it may lack 0.25 per pixel, or have 0.5 too much. What lies beyond counts."""
    reference = Image(np.ones((8, 8, 3), np.float32))
    for error, z in ((-0.2, 0), (-0.28, 3), (0.4, 0), (0.53, 3)):
        test = Image(reference.mean + np.float32(error), np.full((8, 8, 3), 1e-4, np.float32), 64, None, 16)
        known = decision._known(test, reference, Bound(1e-5, 1.0), 1e-3, None, 1.0)
        (part,) = decision._strips(known)
        missed = 64 * np.array([0.25, 0.5]).reshape(2, 1, 1, 1) * np.ones(3)
        sums = decision._sums(known, [part])._replace(missed_light=missed)
        family = decision.Family(decision.Worst(), 1e-3, 0, 192)
        found, _ = decision._values(family, part, sums, np.full((2, 1, 1, 3), 1e-4), known)
        assert found.worst.z == pytest.approx(z, abs=0.01)
