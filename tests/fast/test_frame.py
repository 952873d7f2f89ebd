"""Whole images: closed forms, and every engine, rung and solver against each other."""

import math
import os
import subprocess
import sys

import msgspec
import numpy as np
import pytest
from scene_of import changed

from raytwin.errors import InputError, MachineError
from raytwin.fast import ENGINES, frame, trace
from raytwin.fast.engine import pixel_grid
from raytwin.fast.fast_world import ObjectList
from raytwin.fast.frame import EyeScene, with_solver
from raytwin.scene import Lambert, Rectangle, Sphere, Sun
from raytwin.tracer import (
    RADIANCE,
    SOLVERS,
    STAGES,
    PlainWorld,
    first_hit,
    intersect_rectangle,
    intersect_sphere,
)
from raytwin.tracer import trace as plain_trace

FLOAT32_AGREES = 1e-5


def quantile999(difference: np.ndarray) -> float:
    return float(np.quantile(np.abs(difference), 0.999))


# ------------------------------------------------------------------------------------------------ closed forms


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


def test_the_nearest_of_many_objects_is_seen(rng):
    spheres = [Sphere(tuple(rng.uniform(-1, 1, 3).tolist()), float(rng.uniform(0.05, 0.4))) for _ in range(12)]
    planes = [Rectangle(tuple(rng.uniform(-1, 1, 3).tolist()), (0.5, 0.0, 0.0), (0.0, 0.3, 0.4)) for _ in range(4)]
    d = rng.normal(size=(3, 2000))
    d /= np.linalg.norm(d, axis=0)
    origin = (0.0, 0.0, -3.0)
    with np.errstate(all="ignore"):
        found = first_hit(PlainWorld((*spheres, *planes), STAGES), origin, tuple(d))
        t = np.array(
            [intersect_sphere(origin, tuple(d), s) for s in spheres]
            + [intersect_rectangle(origin, tuple(d), p) for p in planes]
        )
    np.testing.assert_array_equal(found.t, t.min(axis=0))
    np.testing.assert_array_equal(found.ids, np.where(t.min(axis=0) < np.inf, t.argmin(axis=0), -1))
    seen = found.ids >= 0
    normal = np.stack(found.normal)
    assert 50 < seen.sum() < 1950
    assert ((normal * d).sum(axis=0)[seen] <= 0).all()
    np.testing.assert_allclose(np.linalg.norm(normal[:, seen], axis=0), 1, rtol=1e-12)
    on_sphere = seen & (found.ids < len(spheres))
    centers = np.array([s.center for s in spheres])[found.ids[on_sphere].astype(int)].T
    radii = np.array([s.radius for s in spheres])[found.ids[on_sphere].astype(int)]
    np.testing.assert_allclose(np.linalg.norm(np.stack(found.point)[:, on_sphere] - centers, axis=0), radii, rtol=1e-12)


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


@pytest.mark.nightly
def test_a_crowd_on_a_table_is_the_same_for_every_engine_and_without_boxes(engine, rng, single):
    # More objects than are held against each other unsorted, some of them large, and rectangles among them.
    balls = [
        Sphere((x, y, r), r)
        for x, y, r in zip(*rng.uniform(-0.2, 0.2, (2, 90)), rng.uniform(0.002, 0.012, 90), strict=True)
    ]
    balls.append(Sphere((0.05, 0.02, 0.09), 0.05, Lambert((0.2, 0.4, 0.9))))
    table = Rectangle((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.2, 0.0))
    leaf = Rectangle((0.1, 0.1, 0.1), (0.05, 0.0, 0.0), (0.0, 0.05, 0.02))
    scene = changed(
        single, camera=single.camera.resized(320, 240), objects=(*balls, table, leaf),
        lights=(Sun((0.3, -0.2, 1.0)), single.sky),
    )  # fmt: skip
    exact = trace(scene, "shadow", "numpy64", trim="none")
    image = trace(scene, "shadow", engine)
    assert len(np.unique(exact.surface.ids)) > 50
    assert 0.02 < (exact.mean < trace(scene, "lambert", "numpy64").mean).any(axis=-1).mean() < 0.6
    assert (image.surface.ids != exact.surface.ids).sum() <= 2
    # A shadow's edge may fall on the other side of a pixel's centre; float32 turns a small ball's normal by 1e-4.
    assert (np.abs(image.mean - exact.mean) > 1e-3).any(axis=-1).mean() < 3e-4


@pytest.mark.parametrize(("count", "size"), [(70, (213, 160)), (2000, (80, 60))])
def test_a_cloud_of_spheres_is_the_plain_tracers_to_the_last_bit(engine, rng, single, monkeypatch, count, size):
    """Dr.Jit rounds otherwise: there lists, trees and one object after the other give the same bits."""
    at, r = rng.uniform((-0.15, -0.12, 0.0), (0.15, 0.12, 0.1), (count, 3)), rng.uniform(0.04, 0.15, count) / count**0.5
    spheres = tuple(Sphere(tuple(c), radius) for c, radius in zip(at.tolist(), r.tolist(), strict=True))
    sun = Sun((0.6, -0.3, 0.5))
    scene = changed(single, camera=single.camera.resized(*size), objects=spheres, lights=(sun, single.sky))
    exact, image = plain_trace(scene, "shadow"), trace(scene, "shadow", engine)
    assert len(np.unique(exact.surface.ids)) > min(count, 500) / 2
    assert (exact.mean < plain_trace(scene, "lambert").mean).any(axis=-1).mean() > 0.05
    assert (image.surface.ids != exact.surface.ids).sum() <= (0 if ENGINES[engine].bits == 64 else 5)
    compared = [exact] if engine == "numpy64" else [trace(scene, "shadow", engine, trim="none")]
    monkeypatch.setattr(frame, "MAX_OBJECTS_PER_TILE", 0)
    for other in (*compared, trace(scene, "shadow", engine)):
        np.testing.assert_array_equal(image.mean, other.mean)
        for layer in ("ids", "depth", "normal"):
            np.testing.assert_array_equal(getattr(image.surface, layer), getattr(other.surface, layer))


# -------------------------------------------------------------------------------- engines, rungs, solvers


@pytest.mark.parametrize("name", [n for n, e in ENGINES.items() if e.is_numpy])
def test_numpy_stays_in_the_precision_that_was_asked_for(overlap, name):
    # One float64 scalar among float32 arrays would quietly double the work.
    wide = msgspec.structs.replace(overlap.camera, dist=(-0.1, 0.02))
    engine = ENGINES[name]
    for rung in RADIANCE:
        for solver in SOLVERS:
            view = EyeScene(overlap.with_camera(wide), engine, with_solver(STAGES, solver))
            world = view.world(*[ObjectList(view.table, range(4))] * 2)
            with np.errstate(all="ignore"):
                hit = first_hit(world, (0.0, 0.0, 0.0), view.ray(*pixel_grid(engine, (0, 0, 64, 48))))
                colour = RADIANCE[rung](hit, view.light, world, view.camera)
            arrays = (hit.t, *hit.point, *hit.normal, *hit.albedo, *colour)
            assert {a.dtype.name for a in arrays} == {engine.precision}, (rung, solver)


def test_every_rung_returns_a_whole_image(overlap, engine):
    small = overlap.with_camera(overlap.camera.resized(107, 80))
    for rung in RADIANCE:
        image = trace(small, rung, engine)
        assert image.mean.shape == (80, 107, 3)
        assert image.mean.dtype == image.surface.depth.dtype == image.surface.normal.dtype == np.float32
        assert image.surface.ids.dtype == np.int32
        assert image.variance is None
        for layer in (image.mean, image.surface.depth, image.surface.normal):
            assert np.isfinite(layer).all()
        assert image.mean.min() >= 0
        assert set(np.unique(image.surface.ids)) == set(range(-1, len(small.objects)))
        background = np.float32((0, 0, 0) if rung == "surface" else small.sky.radiance)
        assert (image.mean[~image.surface.mask] == background).all()


def test_a_shadow_only_takes_light_away(overlap):
    lit, shaded = trace(overlap, "lambert"), trace(overlap, "shadow")
    assert (shaded.mean <= lit.mean).all()
    taken = (shaded.mean < lit.mean).any(axis=-1)
    assert 0.02 < taken.mean() < 0.5
    albedo = np.array([x.material.albedo for x in overlap.objects])[shaded.surface.ids[taken]]
    np.testing.assert_allclose(shaded.mean[taken], albedo * overlap.sky.radiance, rtol=1e-6)


# ------------------------------------------------------------------------------------------------ wrong input


def test_an_unknown_row_is_named_with_those_that_exist(single):
    for field in ("rung", "engine", "solver", "trim"):
        with pytest.raises(InputError, match=f"^{field}: expected one of .*, got nonsense"):
            trace(single, **{field: "nonsense"})


def test_objects_in_any_order_give_the_same_pixels(overlap, engine):
    """Only the ids follow the order."""
    small = overlap.with_camera(overlap.camera.resized(213, 160))
    order = [2, 0, 1, 3]
    assert len(small.objects) == len(order)
    mixed = changed(small, objects=tuple(small.objects[i] for i in order))
    a, b = trace(small, "shadow", engine), trace(mixed, "shadow", engine)
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.surface.ids, np.array([*order, -1])[b.surface.ids])


def test_an_engine_that_the_machine_lacks_is_refused(single, packages):
    if "llvm" not in packages or "cuda" in packages:
        pytest.skip("for a machine with Dr.Jit but without CUDA")
    with pytest.raises(MachineError, match="engine: expected a machine with cuda"):
        trace(single, engine="cuda32")


def test_dr_jit_is_not_left_to_choose_a_libllvm_by_itself(scenes):
    """A wrong one aborts the process at the first kernel: only one that was tried, or the user's, is taken."""
    code = (
        "import sys; from raytwin import read_scene; from raytwin.fast import trace\n"
        f"try: trace(read_scene({str(scenes / 'single')!r}), engine='drjit32')\n"
        "except Exception as error: print(error, 'drjit' in sys.modules)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "DRJIT_LIBLLVM_PATH"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.startswith(
        "engine: expected a libLLVM that was seen to work: call raytwin.twin.activate() first"
    )
    assert done.stdout.endswith("False\n")
