"""The hot paths: `pip install -e ".[bench]"`, then `pytest tests/measure/hot_paths.py`; not part of the tests.

`--benchmark-autosave` keeps a run, `--benchmark-compare` sets the next beside it. RAYTWIN_BENCH_MP: megapixels (0.75).
"""

import os
from pathlib import Path

import pytest

from raytwin import twin
from raytwin.compare import compare
from raytwin.fast import background, draw, trace
from raytwin.fast.speculation import speculate
from raytwin.scene.scene_files import read_scene
from raytwin.show import compare_page
from raytwin.study.bench import sized
from raytwin.study.compare_scene import compare_scene

SCENES = Path(__file__).resolve().parents[2] / "scenes"


@pytest.fixture(scope="module", params=["single", "distorted"])
def scene(request):
    twin.activate()
    found = read_scene(SCENES / request.param)
    return found.with_camera(sized(found.camera, float(os.environ.get("RAYTWIN_BENCH_MP", "0.75"))))


@pytest.mark.parametrize("trim", ["none", "corners", "conic"])
@pytest.mark.parametrize("engine", ["numpy32", "numpy64", "drjit32", "drjit64"])
def test_draw(benchmark, scene, engine, trim):
    out = background(scene)
    benchmark(draw, scene, out, "shadow", engine, trim=trim)


@pytest.mark.parametrize("way", ["paper", "careful"])
def test_speculate(benchmark, scene, way):
    benchmark(speculate, scene, 8, "shadow", "numpy32", way)


def test_twin_without_noise(benchmark, scene):
    benchmark(twin.render, scene, "shadow", cache=False)


def test_twin_of_four_samples(benchmark, scene):
    benchmark(twin.render, scene, "path", sampling="area", samples=4, cache=False)


def test_compare(benchmark, scene):
    a, b = trace(scene, engine="numpy64"), trace(scene, engine="numpy32")
    benchmark(compare, a, b)


def test_report(benchmark, scene, tmp_path):
    result = compare_scene(SCENES / scene.name, size=scene.camera.image_size, engine="numpy32")
    benchmark(compare_page.write_report, result, tmp_path / "report.html")
