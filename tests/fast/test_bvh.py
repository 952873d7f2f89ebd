"""Trees of boxes: the same light as object by object, and nodes that hold what they say."""

import msgspec
import numpy as np
import pytest
from scene_of import changed

from raytwin.fast import ENGINES, bvh, walk
from raytwin.fast.frame import EyeScene
from raytwin.scene import Rectangle, Scene, Sphere
from raytwin.tracer import STAGES, intersect_sphere


def strewn(scene: Scene, rng: np.random.Generator, spheres: int = 60, sheets: int = 40) -> Scene:
    """Small spheres and sheets that turn every way, some of them in one another, over a ground that is a huge ball."""
    at = rng.uniform((-0.15, -0.12, 0.0), (0.15, 0.12, 0.1), (spheres + sheets, 3))
    radii = rng.uniform(0.002, 0.02, spheres)
    half = rng.normal(size=(sheets, 2, 3))
    half[:, 1] -= half[:, 0] * (half[:, :1] @ half[:, 1, :, None])[:, 0] / np.square(half[:, :1]).sum(axis=-1)
    half *= rng.uniform(0.002, 0.02, (sheets, 2, 1)) / np.linalg.norm(half, axis=2, keepdims=True)
    colour = [tuple(c) for c in rng.uniform(0.3, 0.9, (spheres + sheets, 3)).tolist()]
    balls = [Sphere(tuple(c), r, m) for c, r, m in zip(at.tolist(), radii.tolist(), colour, strict=False)]
    flat = [Rectangle(tuple(c), tuple(u), tuple(v), m)
            for c, (u, v), m in zip(at[spheres:].tolist(), half.tolist(), colour, strict=False)]  # fmt: skip
    return changed(scene, objects=(Sphere((0, 0, -100.0), 100.0), *balls, *flat))


@pytest.mark.parametrize(
    ("engine", "spheres", "sheets"),
    [("drjit32", 60, 40), ("drjit64", 60, 2), ("drjit64", 3, 40)],
    indirect=["engine"],
)
def test_many_objects_in_trees_give_the_light_of_one_after_the_other(overlap, engine, rng, spheres, sheets):
    """As NumPy tries them; float32's rounding sends one path in some fifty elsewhere at an edge."""
    scene = strewn(overlap.with_camera(overlap.camera.resized(16, 12)), rng, spheres, sheets)
    bits = ENGINES[engine].bits
    kinds = [type(tree.thing) for tree in EyeScene(scene, ENGINES[engine]).objects.trees]
    assert kinds == [Sphere, Rectangle]
    found, plain = (walk(scene, "path", name, samples=4, seed=2, depth=4).mean for name in (engine, f"numpy{bits}"))
    off = np.abs(found - plain).max(axis=-1)
    assert (off > 1e-4).mean() < 0.02 if bits == 32 else off.max() < 1e-6


@pytest.mark.parametrize("engine", ["drjit64"], indirect=True)
def test_a_step_that_meets_objects_beyond_their_boxes_is_asked_about_all(overlap, engine, rng):
    """A faulty sphere, twice as large as it says."""
    scene = strewn(overlap.with_camera(overlap.camera.resized(12, 9)), rng, 40, 0)
    large = STAGES._replace(
        intersect_sphere=lambda o, d, s: intersect_sphere(o, d, msgspec.structs.replace(s, radius=2 * s.radius))
    )
    found, plain = (walk(scene, "path", name, samples=2, depth=3, stages=large).mean for name in (engine, "numpy64"))
    np.testing.assert_allclose(found, plain, rtol=0, atol=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 100])
def test_every_object_is_in_one_leaf_and_in_every_box_above_it(n, rng):
    center, half = rng.normal(size=(n, 3)), rng.exponential(size=(n, 3))
    nodes = bvh.grow(center, half)
    assert sorted(nodes.thing[nodes.thing >= 0].tolist()) == list(range(n))
    for place in range(2 * n - 1):
        after = nodes.onward[place]
        held = [i for i in nodes.thing[place:after] if i >= 0]
        assert 2 * len(held) - 1 == after - place
        assert (nodes.thing[place] >= 0) == (len(held) == 1)
        low, high = (center - half)[held].min(axis=0), (center + half)[held].max(axis=0)
        assert (nodes.low[place] < low).all()
        assert (nodes.high[place] > high).all()
        np.testing.assert_allclose([nodes.low[place], nodes.high[place]], [low, high], rtol=0, atol=1e-4)


def test_objects_in_one_place_are_still_told_apart():
    nodes = bvh.grow(np.ones((5, 3)), np.ones((5, 3)))
    assert sorted(nodes.thing[nodes.thing >= 0].tolist()) == [0, 1, 2, 3, 4]
