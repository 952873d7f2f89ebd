"""The tracer that is read against the one that runs: the same pixels, whatever makes them fast."""

from functools import partial

import msgspec
import numpy as np
import pytest
from engines import SHIPPED, TRIED
from scene_of import changed

from raytwin import fast as fast_package
from raytwin import tracer
from raytwin.errors import InputError
from raytwin.fast.boxes import TRIMS
from raytwin.rungs import RUNGS
from raytwin.scene.lens import without_ray

FLOAT32_AGREES = 1e-5


@pytest.mark.parametrize("trim", TRIMS)
def test_in_float64_the_fast_way_gives_the_plain_ones_pixels(shipped, trim):
    """Each scene with each kind of boxes; rungs in turn."""
    rung = list(tracer.RADIANCE)[(SHIPPED.index(shipped.name) + list(TRIMS).index(trim)) % 3]
    small = shipped.with_camera(shipped.camera.resized(160, 120))
    plain, fast = tracer.trace(small, rung), fast_package.trace(small, rung, "numpy64", trim=trim)
    # The paper's boxes cut a sphere that reaches behind the camera: there they may only lose.
    kept = fast.surface.mask if trim == "corners" else np.ones((120, 160), bool)
    assert kept.mean() > 0.1
    for layer in ("ids", "depth", "normal"):
        np.testing.assert_array_equal(getattr(fast.surface, layer)[kept], getattr(plain.surface, layer)[kept])
    np.testing.assert_array_equal(fast.mean[kept], plain.mean[kept])


def test_every_engine_gives_the_plain_ones_pixels_with_every_solver(shipped, engine):
    """Each scene and each engine with each solver, in a Latin square."""
    solver = list(tracer.SOLVERS)[(SHIPPED.index(shipped.name) + TRIED.index(engine)) % len(tracer.SOLVERS)]
    small = shipped.with_camera(shipped.camera.resized(160, 120))
    stages = tracer.STAGES._replace(intersect_sphere=partial(tracer.intersect_sphere, solver=solver))
    plain, fast = tracer.trace(small, "shadow", stages), fast_package.trace(small, "shadow", engine, solver)
    if solver == "robust":
        np.testing.assert_array_equal(fast.surface.ids, plain.surface.ids)
        assert np.quantile(np.abs(fast.surface.depth - plain.surface.depth), 0.999) <= FLOAT32_AGREES
        assert np.quantile(np.abs(fast.surface.normal - plain.surface.normal), 0.999) <= 10 * FLOAT32_AGREES
    # Float32 loses digits with the other solvers, at grazing pixels all of them.
    assert (fast.surface.ids != plain.surface.ids).mean() < 1e-3
    assert np.quantile(np.abs(fast.mean - plain.mean), 0.99) <= FLOAT32_AGREES


def test_a_replaced_stage_replaces_it_in_the_plain_tracer_and_in_every_engine(overlap, engine):
    def without_clamp(albedo, normal, to_light, irradiance, visible, sky):
        n_l = sum(n * c for n, c in zip(normal, to_light, strict=True))
        return albedo / np.pi * irradiance * visible * n_l + albedo * sky

    faulty, overlap = tracer.STAGES._replace(lambert=without_clamp), overlap.with_camera(overlap.camera.resized(80, 60))
    plain, fast = (
        tracer.trace(overlap, "lambert", faulty),
        fast_package.trace(overlap, "lambert", engine, stages=faulty),
    )
    assert plain.mean.min() < -0.1
    assert (tracer.trace(overlap, "lambert").mean >= 0).all()
    assert np.quantile(np.abs(fast.mean - plain.mean), 0.999) <= FLOAT32_AGREES


def test_a_replaced_lens_is_not_undone_behind_the_stages_back(scenes, engine):
    from raytwin.scene.scene_files import read_scene

    written = read_scene(scenes / "distorted")
    scene = written.with_camera(written.camera.resized(160, 120))
    straight = scene.with_camera(msgspec.structs.replace(scene.camera, dist=()))
    faulty = tracer.STAGES._replace(undistort=lambda xd, yd, dist: (xd, yd))
    fast = fast_package.trace(scene, "surface", engine, trim="none", stages=faulty)
    np.testing.assert_array_equal(fast.surface.ids, fast_package.trace(straight, "surface", engine).surface.ids)
    assert (fast.surface.ids != fast_package.trace(scene, "surface", engine).surface.ids).mean() > 0.01


def test_a_lens_that_folds_over_most_of_the_image_is_refused_by_both(single):
    folding = single.with_camera(msgspec.structs.replace(single.camera, dist=(-4.0,)))
    for trace in (tracer.trace, fast_package.trace):
        with pytest.raises(InputError, match=r"camera\.dist: expected a distortion that can be undone"):
            trace(folding)


@pytest.mark.filterwarnings("ignore::raytwin.scene.lens.Folds")
def test_past_where_a_lens_folds_over_both_are_black_and_meet_nothing(single, engine):
    """The sphere reaches 30 degrees off the axis, 0.577, and k1 folds at 1 / √3.9 = 0.506."""
    camera = msgspec.structs.replace(single.camera, dist=(-1.3,)).resized(320, 240)
    (sphere,) = single.objects
    folding = changed(single, camera=camera, objects=(msgspec.structs.replace(sphere, radius=0.2),))
    lost = without_ray(camera)
    plain, fast = tracer.trace(folding), fast_package.trace(folding, engine=engine)
    assert 0.2 < lost.mean() < 0.5
    for image in (plain, fast):
        assert not image.mean[lost].any()
        assert (image.surface.ids == np.where(lost, -1, 0)).all()
        assert not image.surface.depth[lost].any()
        assert (image.mean[~lost].min(axis=-1) > 0.05).all()
    np.testing.assert_allclose(fast.mean, plain.mean, rtol=0, atol=FLOAT32_AGREES)
    held = np.full((240, 320, 3), 7, np.float32)  # a photo that is drawn into keeps what it shows there
    fast_package.draw(folding, held, engine=engine)
    assert (held[lost] == 7).all()
    assert (held[~lost] != 7).all()
    for way in fast_package.WAYS:
        guessed, _ = fast_package.speculate(folding, 4, engine=engine, way=way)
        assert not guessed[lost].any()


def test_the_tracer_climbs_the_first_rungs_of_the_ladder(single):
    assert list(RUNGS)[: len(tracer.RADIANCE)] == list(tracer.RADIANCE)
    with pytest.raises(InputError, match=r"^rung: expected one of surface, lambert, shadow, got path$"):
        tracer.trace(single, "path")
