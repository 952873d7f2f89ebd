import math

import numpy as np
import pytest

from raytwin.compare import METRICS, measure
from raytwin.compare.metrics import nth_largest
from raytwin.errors import InputError

R = np.full((20, 30, 3), 0.5, np.float32)


def of(name, test, reference):
    return METRICS[name].function(test, reference)


def test_a_constant_error_has_the_closed_form_of_every_metric():
    t = R + np.float32(0.25)
    expected = {
        "rmse": 0.25,
        "relmse": 0.0625 / (0.25 + 0.01),
        "relmse_trimmed": 0.0625 / (0.25 + 0.01),
        "mae": 0.25,
        "max_abs": 0.25,
        "p999_abs": 0.25,
        "p999_rel": 0.25 / 0.51,
        "psnr": 20 * math.log10(0.5 / 0.25),
        "mean_ratio": 1.5,
    }
    for name, value in expected.items():
        assert of(name, t, R) == pytest.approx(value, rel=1e-6), name
        none = {"psnr": math.inf, "mean_ratio": 1.0}.get(name, 0.0)
        assert of(name, R, R.copy()) == pytest.approx(none, abs=1e-6), name
    assert math.isnan(of("mean_ratio", R, 0 * R))


def test_uneven_errors_are_averaged_in_double_precision_and_the_worst_trimmed():
    """72 fireflies in 143 thousand values."""
    t, r = np.random.default_rng(3).random((2, 143_417), np.float32)
    plain, d = of("relmse_trimmed", t, r), t.astype(float) - r
    relative = d**2 / (r.astype(float) ** 2 + 0.01)
    for name, value in (("rmse", np.sqrt(np.mean(d**2))), ("relmse", relative.mean()), ("max_abs", np.abs(d).max())):
        assert of(name, t, r) == pytest.approx(value, rel=1e-5), name
    t[::2000] = 1e4
    relative = np.sort((t.astype(float) - r) ** 2 / (r.astype(float) ** 2 + 0.01))
    assert of("relmse_trimmed", t, r) == pytest.approx(relative[: -(t.size // 1000)].mean(), rel=1e-5)
    assert of("relmse_trimmed", t, r) == pytest.approx(plain, rel=0.05)
    assert of("relmse", t, r) > 1e5 * plain


def test_the_nth_largest_is_that_of_sorting_whatever_the_sample_says():
    rng, hidden = np.random.default_rng(4), np.full(300_000, 0.1)
    hidden[::6] = 5
    for values in (rng.random(200_003), hidden, np.zeros(1000), np.r_[np.zeros(99_999), 1.0], rng.random(3)):
        t = values.astype(np.float32)
        for above in (0, 1, len(t) // 1000, len(t) - 1):
            assert nth_largest(above, np.asarray, t) == np.sort(t)[::-1][above]
        assert of("p999_abs", t, 0 * t) == np.sort(t)[math.ceil(0.999 * len(t)) - 1]


def test_flip_of_black_beside_white_follows_from_the_papers_equations():
    """Radiance 100 is white at every exposure: lightness 100 apart, where green and blue, the farthest, are 203.3."""
    far, distance = 203.3**0.7, 100**0.7
    expected = 0.95 + 0.05 * (distance - 0.4 * far) / (0.6 * far)
    for t, r in ((0 * R, 0 * R + 100), (0 * R + 100, 0 * R)):
        assert of("flip_hdr", t, r) == pytest.approx(expected, abs=1e-4)


def test_flip_sees_five_exposures_from_minus_2_to_2_stops(monkeypatch):
    import OpenImageIO as oiio

    made, wrapped = [], oiio.ImageBufAlgo.FLIP_diff

    def keep(*images, **options):
        made.append(wrapped(*images, **options))
        return made[0]

    monkeypatch.setattr(oiio.ImageBufAlgo, "FLIP_diff", keep)
    of("flip_hdr", R, 2 * R)
    told = {attribute.name: attribute.value for attribute in made[0].spec().extra_attribs}
    assert told["FLIP:startExposure"] == pytest.approx(-2, abs=1e-5)
    assert told["FLIP:stopExposure"] == pytest.approx(2, abs=2e-5)
    assert told["FLIP:numExposures"] == 5


def test_flip_refuses_nan_and_wrong_shapes():
    bad = R.copy()
    bad[0, 0, 0] = np.nan
    four, flat = np.ones((8, 8, 4), np.float32), np.ones((8, 8), np.float32)
    for pair in ((bad, R), (R[:5], R), (four, four), (flat, flat)):
        with pytest.raises(InputError, match="FLIP"):
            of("flip_hdr", *pair)


def test_metrics_are_those_of_the_finite_values_and_null_without_any():
    ones = np.ones((10, 10, 3), np.float32)
    spoilt = ones.copy()
    spoilt[0, 0, 0] = 1.1
    spoilt[5, 5] = np.nan
    names = ("mae", "max_abs", "flip_hdr")
    numbers = measure(spoilt, ones, iter(names))
    assert numbers == {"mae": pytest.approx(0.1 / 297, rel=1e-5), "max_abs": pytest.approx(0.1), "flip_hdr": None}
    assert measure(np.full_like(ones, np.nan), ones, names) == dict.fromkeys(names)
    assert measure(ones[:5], ones, names) == dict.fromkeys(names)
    assert measure(ones, ones, ["psnr"]) == {"psnr": None}  # infinite
