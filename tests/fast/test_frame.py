"""Whole images: closed forms, and every engine, rung and solver against each other."""

import math
import sys
from functools import partial

import msgspec
import numpy as np
import pytest
from scene_of import changed
from test_bvh import strewn

from raytwin.errors import InputError, MachineError
from raytwin.fast import ENGINES, trace
from raytwin.fast.engine import pixel_grid
from raytwin.fast.frame import EyeScene
from raytwin.scene import Sphere, Sun
from raytwin.tracer import RADIANCE, SOLVERS, STAGES, first_hit, intersect_sphere
from raytwin.tracer import trace as plain_trace

FLOAT32_AGREES = 1e-5


def quantile999(difference: np.ndarray) -> float:
    return float(np.quantile(np.abs(difference), 0.999))


def test_outline_depth_and_normal_of_a_head_on_sphere_are_the_textbooks(single, engine):
    """A disc of radius f r / √(d² - r²) round the principal point."""
    surface = trace(single.with_camera(single.camera.resized(320, 240)), "surface", engine).surface
    v, u = np.mgrid[:240, :320]
    tangent = np.hypot(u - 159.5, v - 119.5) / 400
    off = 400 * tangent - 400 * 0.05 / math.sqrt(0.4**2 - 0.05**2)
    sure = abs(off) > 1e-3
    assert sure.mean() > 0.999
    np.testing.assert_array_equal(surface.mask[sure], off[sure] < 0)
    cosine = 1 / np.sqrt(1 + tangent**2)
    inside = surface.mask & (off < -0.4)
    depth = 0.4 * cosine - np.sqrt(np.maximum(0.05**2 - 0.4**2 * (1 - cosine**2), 0))
    np.testing.assert_allclose(surface.depth[inside], depth[inside], rtol=2e-5)
    x, y = (u - 159.5) / 400 * cosine * depth, (119.5 - v) / 400 * cosine * depth
    normal = np.stack([x, y, 0.4 - cosine * depth], axis=-1) / 0.05
    np.testing.assert_allclose(surface.normal[inside], normal[inside], rtol=0, atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(surface.normal[surface.mask], axis=-1), 1, rtol=3e-6)
    assert (surface.depth[~surface.mask] == 0).all()
    assert (surface.normal[~surface.mask] == 0).all()


def test_a_scene_without_objects_is_all_sky(single, engine):
    empty = changed(single, objects=())
    image = trace(empty, "shadow", engine)
    np.testing.assert_array_equal(image.mean, np.broadcast_to(np.float32(single.sky.radiance), (480, 640, 3)))
    assert not image.surface.mask.any()
    assert not image.surface.depth.any()


def test_a_scene_far_from_the_origin_keeps_its_digits_in_float32(overlap, engine):
    # The same scene a kilometre away: only the eye's own coordinates lose digits, and those are in float64.
    away = np.array([1000.0, -700.0, 300.0])
    camera = overlap.camera
    t = np.asarray(camera.t_cam_board) - np.asarray(camera.R_cam_board) @ away

    def moved(things):
        return tuple(msgspec.structs.replace(x, center=tuple((np.asarray(x.center) + away).tolist())) for x in things)

    far = changed(
        overlap,
        camera=msgspec.structs.replace(camera, t_cam_board=tuple(t.tolist())),
        objects=moved(overlap.objects),
    )
    near_image, far_image = trace(overlap, "shadow", engine), trace(far, "shadow", engine)
    assert (near_image.surface.ids != far_image.surface.ids).sum() <= 2
    assert quantile999(near_image.mean - far_image.mean) < FLOAT32_AGREES


@pytest.mark.parametrize(("count", "size"), [(70, (213, 160)), (2000, (80, 60))])
def test_a_cloud_of_spheres_is_the_plain_tracers_to_the_last_bit(engine, rng, single, count, size):
    """Dr.Jit rounds otherwise: there trees and one object after the other give the same bits."""
    at, r = rng.uniform((-0.15, -0.12, 0.0), (0.15, 0.12, 0.1), (count, 3)), rng.uniform(0.04, 0.15, count) / count**0.5
    spheres = tuple(Sphere(tuple(c), radius) for c, radius in zip(at.tolist(), r.tolist(), strict=True))
    sun = Sun((0.6, -0.3, 0.5))
    scene = changed(single, camera=single.camera.resized(*size), objects=spheres, lights=(sun, single.sky))
    exact, image = plain_trace(scene, "shadow"), trace(scene, "shadow", engine)
    assert len(np.unique(exact.surface.ids)) > min(count, 500) / 2
    assert (exact.mean < plain_trace(scene, "lambert").mean).any(axis=-1).mean() > 0.05
    assert (image.surface.ids != exact.surface.ids).sum() <= (0 if ENGINES[engine].bits == 64 else 5)
    other = exact if engine == "numpy64" else trace(scene, "shadow", engine, trim="none")
    np.testing.assert_array_equal(image.mean, other.mean)
    for layer in ("ids", "depth", "normal"):
        np.testing.assert_array_equal(getattr(image.surface, layer), getattr(other.surface, layer))


@pytest.mark.parametrize("name", [n for n, e in ENGINES.items() if e.is_numpy])
def test_numpy_stays_in_the_precision_that_was_asked_for(overlap, name):
    # One float64 scalar among float32 arrays would quietly double the work.
    wide = msgspec.structs.replace(overlap.camera, dist=(-0.1, 0.02))
    engine = ENGINES[name]
    for rung in RADIANCE:
        for solver in SOLVERS:
            stages = STAGES._replace(intersect_sphere=partial(intersect_sphere, solver=solver))
            view = EyeScene(overlap.with_camera(wide), engine, stages)
            world = view.world()
            with np.errstate(all="ignore"):
                hit = first_hit(world, (0.0, 0.0, 0.0), view.ray(*pixel_grid(engine, (0, 0, 64, 48))))
                colour = RADIANCE[rung](hit, view.light, world, view.camera)
            arrays = (hit.t, *hit.point, *hit.normal, *hit.albedo, *colour)
            assert {a.dtype.name for a in arrays} == {engine.precision}, (rung, solver)


@pytest.mark.parametrize("shiny", [0, 3])
def test_many_objects_keep_the_highlight_of_each(overlap, engine, rng, shiny):
    """Looked up in a table: the first object's as well as another's."""
    objects = list(strewn(overlap, rng, 20, 6).objects)
    objects[shiny] = msgspec.structs.replace(objects[shiny], albedo=(0.2,) * 3, specular=(0.5, 0.4, 0.3), exponent=20.0)
    scene = changed(overlap, camera=overlap.camera.resized(48, 36), objects=tuple(objects))
    found, plain = trace(scene, "shadow", engine), plain_trace(scene, "shadow")
    assert (np.abs(found.mean - plain.mean).max(axis=-1) > 1e-4 * plain.mean.max()).mean() < 0.005
    assert (plain.surface.ids == shiny).any()


def test_an_unknown_row_is_named_with_those_that_exist(single):
    for field in ("rung", "engine", "solver", "trim"):
        with pytest.raises(InputError, match=f"^{field}: expected one of .*, got nonsense"):
            trace(single, **{field: "nonsense"})


def test_an_engine_that_the_machine_lacks_is_refused(single, packages):
    if "llvm" not in packages or "cuda" in packages:
        pytest.skip("for a machine with Dr.Jit but without CUDA")
    with pytest.raises(MachineError, match="engine: expected a machine with cuda"):
        trace(single, engine="cuda32")


def test_dr_jit_is_not_left_to_choose_a_libllvm_by_itself(monkeypatch):
    """A wrong one aborts the process at the first kernel: only one that was tried, or the user's, is taken."""
    monkeypatch.delitem(sys.modules, "drjit", raising=False)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    with pytest.raises(MachineError, match=r"a libLLVM that was seen to work: call raytwin\.twin\.activate\(\) first"):
        _ = ENGINES["drjit32"].float_type
    assert "drjit" not in sys.modules
