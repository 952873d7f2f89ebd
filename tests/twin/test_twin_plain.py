"""Mitsuba left to itself agrees with the twin."""

import numpy as np
import pytest

from raytwin import twin
from raytwin.compare import METRICS
from raytwin.errors import MachineError
from raytwin.scene.scene_files import read_scene


@pytest.fixture(autouse=True)
def llvm():
    try:
        twin.activate("llvm_ad_rgb")
    except MachineError as error:
        pytest.skip(f"llvm_ad_rgb does not work here: {error.got}")


def scene_of(scenes, name: str):
    scene = read_scene(scenes / name)
    return scene.with_camera(scene.camera.resized(64, 48))


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "integrator", "rung"), [("overlap", "path", "path"), ("distorted", "direct", "sky")])
def test_a_plain_render_converges_to_the_twins(scenes, name, integrator, rung):
    """`distorted` takes the sensor that undoes the lens."""
    scene = scene_of(scenes, name)
    truth = twin.render(scene, rung, sampling="area", samples=512, cache=False)
    loaded = twin.load_plain(scene, integrator, "llvm_ad_rgb")
    errors = [METRICS["rmse"].function(twin.render_plain(loaded, n, seed=3), truth.mean) for n in (64, 1024)]
    noise = np.sqrt(truth.variance.mean())
    assert errors[1] < errors[0] / 2.5  # four times, less the truth's own noise
    assert errors[1] < 0.05
    assert errors[1] > noise
    assert twin.render_plain(loaded, 1024).mean() == pytest.approx(truth.mean.mean(), rel=2e-3)


def test_more_samples_than_one_launch_holds_are_added_up(scenes, monkeypatch):
    scene = scene_of(scenes, "overlap")
    loaded = twin.load_plain(scene, "direct", "llvm_ad_rgb")
    monkeypatch.setattr("raytwin.twin.mitsuba_render.LANES", 64 * 48 * 5)
    image = twin.render_plain(loaded, 16, seed=1)
    monkeypatch.undo()
    parts = [twin.render_plain(loaded, 4, seed=7 + i) for i in range(8)]
    assert np.abs(np.subtract(image, twin.render_plain(loaded, 16, seed=1))).max() > 0  # in launches of 4
    assert image.mean() == pytest.approx(np.mean(parts), rel=5e-3)
    assert np.var(image - np.mean(parts, axis=0)) < np.var(parts[0] - np.mean(parts, axis=0)) / 2
