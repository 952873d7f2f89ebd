"""Other tools' tests against closed forms, and a small run of the bench over all of them."""

import json
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import ttest_ind

from raytwin.bench.bench_verdict import FAULTS, bench_verdict
from raytwin.bench.verdict_tools import (
    Tiles,
    sees_welch,
    sees_welch_of_images,
    sees_z_test,
    tile_sums,
    tiles_of_image,
    tiles_of_renders,
    welch_p,
)
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.image_pool import ImagePool
from raytwin.report.verdict_chart import verdict_lines, write_verdict_charts

SHAPE = (24, 32, 3)


def renders(rng: np.random.Generator, n: int, mean: float = 1.0, sd: float = 0.3) -> list[Image]:
    return [Image(rng.normal(mean, sd, SHAPE).astype(np.float32), samples=1) for _ in range(n)]


def pooled(images: list[Image]) -> Image:
    pool = ImagePool()
    for image in images:
        pool.add(image)
    return pool.image


def test_welchs_p_values_are_scipys():
    rng = np.random.default_rng(0)
    a, b = renders(rng, 7), renders(rng, 5, sd=0.9)
    expected = ttest_ind(tile_sums(a), tile_sums(b), equal_var=False).pvalue
    np.testing.assert_allclose(welch_p(tiles_of_renders(a), tiles_of_renders(b)), expected, rtol=1e-9)
    assert expected.shape == (12, 3)


def test_welch_sees_a_bias_and_where_nothing_is_wrong_its_p_values_are_level():
    """36 p-values each of 30 pairs: the Kolmogorov distance of 1080 is above 0.05 once in 100."""
    rng = np.random.default_rng(1)

    def found(tiles: Callable[[list[Image]], Tiles]) -> np.ndarray:
        return np.sort([welch_p(tiles(renders(rng, 8)), tiles(renders(rng, 8))).ravel() for _ in range(30)], axis=None)

    for p in (found(tiles_of_renders), found(lambda images: tiles_of_image(pooled(images)))):
        assert np.abs(p - (np.arange(p.size) + 0.5) / p.size).max() < 0.05
    assert sees_welch(renders(rng, 8, 1.2), renders(rng, 8))
    assert sees_welch_of_images(pooled(renders(rng, 8, 1.05)), pooled(renders(rng, 8)))


def test_the_bench_has_every_tool_and_fault_and_writes_its_charts(tmp_path):
    found = bench_verdict(["wedge"], repeats=1, most=8)
    rows = {(row.fault, row.tool): row for row in found.rows}
    assert {fault for fault, _ in rows} == {fault.name for fault in FAULTS}
    gross = rows["30 % too bright", "in rounds"]
    assert (gross.verdict, gross.samples) == ("fail", 4)
    assert gross.seconds > 0
    assert rows["30 % too bright", "best fixed number"].samples == 4
    assert rows["nothing wrong", "in rounds"].verdict == "pass"
    assert {row.tool: row.alarms for row in found.alarms}["in rounds"] == 0
    assert all(ratio > 0 for ratio in found.ratios())
    write_verdict_charts(found, tmp_path)
    for name in ("verdict-samples.svg", "verdict-seconds.svg"):
        assert "best fixed number" in (tmp_path / name).read_text()
    assert json.dumps(found.table())
    assert any("30 % too bright" in line for line in verdict_lines(found))


@pytest.mark.parametrize(("options", "match"), [({"repeats": 0}, "--repeats"), ({"most": 6}, "--samples")])
def test_wrong_numbers_are_refused_before_anything_is_rendered(options, match):
    with pytest.raises(InputError, match=match):
        bench_verdict(["wedge"], **options)


def test_mitsubas_test_passes_what_it_is_known_to_pass():
    """Up to a quarter per cent of the pixels may be black; one more fails."""
    rng = np.random.default_rng(0)
    variance = np.full((64, 64, 3), 1e-4, np.float32)
    reference = Image(np.ones((64, 64, 3), np.float32), variance, samples=1000)
    mean = (1 + 1e-3 * rng.standard_normal((64, 64, 3))).astype(np.float32)
    mean.reshape(-1, 3)[:10] = 0
    assert not sees_z_test(Image(mean, variance, 1000), reference)
    mean.reshape(-1, 3)[:12] = 0
    assert sees_z_test(Image(mean, variance, 1000), reference)
