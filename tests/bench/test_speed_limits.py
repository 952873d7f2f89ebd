"""The speed limits' bench at toy size: what it reports, never how fast; and the two trim boxes beside each other."""

import numpy as np
import pytest

from raytwin import twin
from raytwin.bench.limits import speed_limits, trim_table, two_spheres
from raytwin.files import read_scene
from raytwin.scene import Camera, Scene, Sphere
from raytwin.tracer import trace


def test_the_two_spheres_cover_five_percent():
    scene = two_spheres(403, 302)
    assert trace(scene, "surface").surface.mask.mean() == pytest.approx(0.05, abs=0.004)


def test_every_ratio_comes_from_one_run():
    if twin.activate().variant == "scalar_rgb":
        pytest.skip("no LLVM on this machine: Dr.Jit's engines have nothing to run on")
    found = speed_limits((160, 120), repeats=2)
    assert {len(s) for s in found["seconds"].values()} == {2}
    ratio = {row["what"]: row["measured"] for row in found["ratios"]}
    m = {name: np.median(s) for name, s in found["seconds"].items()}
    assert ratio["Dr.Jit trimmed frame / one fill"] == pytest.approx(m["drjit32 trimmed"] / m["fill"])
    assert ratio["Mitsuba direct / Dr.Jit full frame"] == pytest.approx(m["mitsuba direct"] / m["drjit32 full"])
    assert all(np.isfinite(value) for value in ratio.values())
    assert ratio["careful speculation's p99.9 error / peak"] < 1e-3


@pytest.mark.parametrize("name", ["single", "overlap", "distorted", "grazing"])
def test_the_conic_box_cuts_nothing_and_wastes_less(scenes, name):
    rows = trim_table(read_scene(scenes / name))
    conic = [r for r in rows if r["trim"] == "conic"]
    corners = [r for r in rows if r["trim"] == "corners"]
    assert all(r["cut"] == 0 for r in conic)
    spheres = len(read_scene(scenes / name).spheres)
    for a, b in zip(conic[:spheres], corners[:spheres], strict=True):
        assert a["pixels"] < b["pixels"]


def test_the_eight_corner_box_cuts_a_floor_that_the_lens_bends(scenes):
    floor = [r for r in trim_table(read_scene(scenes / "distorted")) if r["object"] == 4]
    assert {r["trim"]: r["cut"] > 0 for r in floor} == {"corners": True, "conic": False}


def test_the_eight_corner_box_cuts_a_sphere_that_reaches_behind_the_camera():
    """Its outline runs out of a wide frame to the right, past every corner that lies before the eye."""
    K = ((140.0, 0.0, 199.5), (0.0, 140.0, 149.5), (0.0, 0.0, 1.0))
    wide = Camera((400, 300), K, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)), (0.0, 0.0, 0.5))
    corners, conic = trim_table(Scene("across", wide, (Sphere((0.1, 0.0, 0.44), 0.1),)))
    assert conic["cut"] == 0
    assert corners["cut"] > 100
