import math

import msgspec
import numpy as np
import pytest
from scene_of import changed, scene_of
from truths import camera_above

from raytwin.errors import InputError
from raytwin.scene import Camera, Rectangle, Sky, Sphere, Sun
from raytwin.scene.scene_files import read_scene
from raytwin.twin import render

SUN, SKY = Sun(to_light=(0.0, 0.0, 1.0), irradiance=(3.0, 2.0, 1.0)), Sky((0.1, 0.2, 0.3))


def from_center(camera: Camera) -> np.ndarray:
    """Each pixel's distance from (cx, cy)."""
    v, u = np.indices((camera.height, camera.width))
    return np.hypot(u - camera.cx, v - camera.cy)


def test_a_head_on_sphere_is_a_disc_of_the_closed_forms_radius_and_area(scenes):
    single = read_scene(scenes / "single")
    small = single.with_camera(single.camera.resized(160, 120))
    image = render(small, "surface", cache=False)
    d, r = 0.4, 0.05
    radius = 200 * r / math.sqrt(d * d - r * r)
    assert (image.surface.mask == (from_center(small.camera) < radius)).all()
    assert image.surface.depth.max() < math.sqrt(d * d - r * r)
    nearest = small.camera.fx / math.hypot(small.camera.fx, math.sqrt(0.5))  # the cosine of the four middle pixels
    expected = d * nearest - math.sqrt(r * r - d * d * (1 - nearest**2))
    assert image.surface.depth[image.surface.mask].min() == pytest.approx(expected, rel=1e-6)
    assert image.variance is None
    black = changed(small, objects=(Sphere((0, 0, 0.05), r, (0, 0, 0)),), lights=(single.sky,))
    image = render(black, "lambert", sampling="area", samples=32, cache=False)
    covered = (1 - image.mean.astype(float) / single.sky.radiance)[..., 0]
    sigma = math.sqrt(image.variance[..., 0].sum(dtype=float)) / single.sky.radiance[0]
    assert covered.sum() == pytest.approx(math.pi * radius**2, abs=4 * sigma)
    edge = abs(from_center(small.camera) - radius) < 0.4
    assert ((covered[edge] > 0) & (covered[edge] < 1)).all()


def test_the_surface_is_coloured_by_its_normal_and_the_background_is_black():
    """(n + 1) / 2: where the sphere turns by 30 degrees to the right, (3/4, 1/2, (2 + sqrt 3) / 4)."""
    f, distance, radius = 100.0, 1.0, 0.25
    u = f * radius * 0.5 / (distance - radius * math.sqrt(0.75))
    camera = msgspec.structs.replace(
        camera_above(1.0, 65), K=((f, 0.0, 32 - (u - round(u))), (0.0, f, 32.0), (0.0, 0.0, 1.0))
    )
    scene = scene_of("s", camera, (Sphere((0, 0, 0), radius),), (SUN, SKY))
    mean = render(scene, "surface", cache=False).mean
    np.testing.assert_allclose(mean[32, 32 + round(u)], (0.75, 0.5, (2 + math.sqrt(3)) / 4), atol=2e-5)
    assert not mean[0, 0].any()


def test_inside_a_sphere_it_is_dark_and_normals_point_inwards():
    scene = scene_of("in", camera_above(0.5, 65), (Sphere((0, 0, 0), 1.0),), (SUN, SKY))
    assert render(scene, "path", samples=2, cache=False).mean.max() == 0
    image = render(scene, "shadow", cache=False)
    np.testing.assert_allclose(image.mean[32, 32], np.multiply(0.8, SKY.radiance), rtol=1e-6)
    np.testing.assert_allclose(image.surface.normal[32, 32], (0, 0, 1), atol=1e-6)
    assert image.surface.depth[32, 32] == pytest.approx(1.5)


def test_an_empty_scene_is_all_sky():
    scene = scene_of("none", camera_above(1.0, 9), (), (SUN, SKY))
    for rung in ("shadow", "path"):
        image = render(scene, rung, samples=2, cache=False)
        np.testing.assert_allclose(image.mean, np.tile(SKY.radiance, (9, 9, 1)), rtol=1e-6)
        assert (image.surface.ids == -1).all()
        assert not image.surface.depth.any()


def test_a_textured_plane_is_not_mirrored():
    """Looking down, +X is right and +Y is up: the picture must show the texture as an array is printed."""
    texture = np.zeros((40, 60, 3), np.float32)
    texture[:20, :30] = (1, 0, 0)
    texture[:20, 30:] = (0, 1, 0)
    texture[20:, :30] = (0, 0, 1)
    plane = Rectangle((0, 0, 0), (0.3, 0, 0), (0, 0.2, 0))
    scene = scene_of("t", camera_above(1.0, 65), (plane,), (Sun((0, 0, 1), (math.pi,) * 3),))
    for rung in ("lambert", "path"):
        mean = render(scene, rung, samples=2, textures={0: texture}, cache=False).mean
        corners = mean[[20, 20, 45, 45], [15, 50, 15, 50]]
        np.testing.assert_allclose(corners, [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)], atol=1e-5)
    # One pixel high: bilinear between the centres of two across, 0.2 and 0.6.
    row = render(scene, "lambert", textures={0: np.array([[0.2, 0.6]])}, cache=False).mean[32, :, 1]
    assert row[[6, 32, 58]] == pytest.approx((0.2, 0.4, 0.6), abs=1e-5)


def test_variance_by_batches_predicts_the_spread_between_seeds(scenes):
    scene = read_scene(scenes / "overlap")
    scene = scene.with_camera(scene.camera.resized(40, 30))
    for rung, sampling, samples, within in (("path", "center", 16, 0.15), ("lambert", "area", 64, 0.25)):
        options = {"sampling": sampling, "samples": samples, "batches": 16, "cache": False}
        images = [render(scene, rung, seed=seed, **options) for seed in range(4)]
        assert images[0].samples == samples
        means = np.stack([image.mean.astype(float) for image in images])
        predicted = np.mean([image.variance for image in images], axis=0, dtype=float)
        assert means.var(axis=0, ddof=1).sum() / predicted.sum() == pytest.approx(1, abs=within)
        # Pixels are independent, too: the image's mean spreads as their sum says (one channel: all share their rays).
        z = (means[..., 1].mean(axis=(1, 2)) - means[..., 1].mean()) / np.sqrt(predicted[..., 1].sum()) * 40 * 30
        assert (z**2).sum() < 16.3  # chi squared, 3 degrees of freedom, 1e-3
        assert (render(scene, rung, seed=1, **options).mean == images[1].mean).all()


def test_more_samples_than_one_launch_holds_are_added_up(scenes, monkeypatch):
    scene, steps = read_scene(scenes / "overlap"), []
    scene = scene.with_camera(scene.camera.resized(40, 30))
    whole = render(scene, "path", samples=48, batches=4, cache=False)
    monkeypatch.setattr("raytwin.twin.twin_light.LANES", 500)
    pieces = render(scene, "path", samples=48, batches=4, cache=False, progress=lambda *step: steps.append(step))
    assert (pieces.surface.ids == whole.surface.ids).all()
    sigma = np.sqrt((whole.variance + pieces.variance).mean())
    assert np.sqrt(((whole.mean - pieces.mean) ** 2).mean()) == pytest.approx(sigma, rel=0.2)
    assert steps == sorted(steps)
    assert steps[-1] == ("twin", 100, 100)


def test_mean_variance_and_third_moment_are_those_of_all_samples():
    """60 000 pixels of 16 exponential samples in 8 batches: their mean's variance is 1/16, its third moment 2/256.

    Each within 4 standard errors over the pixels.
    """
    from drjit.llvm import Float64

    from raytwin.twin.twin_light import moments

    samples = np.random.default_rng(1).standard_exponential((60_000, 8, 2))
    means = Float64(samples.mean(axis=2).ravel())
    mean, variance, third = (part.numpy() for part in moments(means, 8))
    np.testing.assert_allclose(mean, samples.mean(axis=(1, 2)), rtol=1e-12)
    for found, expected in ((variance, 1 / 16), (third, 2 / 256)):
        assert abs(found.mean() - expected) < 4 * found.std() / 60_000**0.5
    assert not any(np.any(part.numpy()) for part in moments(means, 1)[1:])


def test_two_samples_or_more_always_measure_a_variance():
    scene = scene_of("s", camera_above(1.0, 9), (Sphere((0, 0, 0), 0.25),), (SUN, SKY))
    for samples, asked, batches in ((1, None, 1), (2, None, 2), (20, None, 10), (4, 1, 1)):
        image = render(scene, "lambert", sampling="area", samples=samples, batches=asked, cache=False)
        assert (image.samples, image.batches) == (samples, batches)
        assert (image.variance is None) == (batches == 1)


def test_wrong_arguments_are_named(subtests):
    scene = scene_of("s", camera_above(1.0, 65), (Sphere((0, 0, 0), 0.25),))
    for arguments, where in [
        ({"rung": "bounce"}, "rung"),
        ({"sampling": "corner"}, "sampling"),
        ({"samples": 0}, "samples"),
        ({"samples": 6, "batches": 7, "rung": "path"}, "batches"),
        ({"samples": 6, "batches": 0, "rung": "path"}, "batches"),
        ({"rung": "path", "max_depth": 1}, "max_depth"),
        ({"seed": -1}, "seed"),
    ]:
        with subtests.test(where), pytest.raises(InputError) as caught:
            render(scene, **arguments)
        assert caught.value.where == where


def test_a_narrow_rectangles_normal_is_exact():
    """Float32's inverse of its matrix turned it by 2e-5, so that correct tracers failed beside the twin."""
    turn, lean = 0.7, 0.4
    u = np.array([math.cos(turn), math.sin(turn), 0.0])
    v = np.array([-math.sin(turn) * math.cos(lean), math.cos(turn) * math.cos(lean), math.sin(lean)])
    strip = Rectangle((0.0, 0.0, 0.0), tuple((0.01 * u).tolist()), tuple((0.5 * v).tolist()))
    seen = render(scene_of("s", camera_above(1.0, 65), (strip,), (SUN, SKY)), "surface", cache=False).surface
    n = np.cross(u, v)
    assert seen.mask.sum() > 50
    np.testing.assert_allclose(seen.normal[seen.mask] @ n, 1, atol=1e-6)
    assert np.abs(seen.normal[seen.mask] - n * np.sign(n[2])).max() < 5e-7
