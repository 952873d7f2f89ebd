"""Float64 decides where float32 cannot tell: at outlines, and on objects far larger than the eye is from them."""

import mpmath
import numpy as np
import pytest

from raytwin import speed
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.twin import render
from raytwin.twin.bodies import MOST_IN_DOUBLES, beyond_floats, distance, normal, table
from raytwin.twin.direct_light import albedos, first_light
from raytwin.twin.outlines import Seen, _doubted, _grazes, borders, trace
from raytwin.twin.rays import directions, lens_of
from raytwin.twin.twin_scene import UNIT

LIGHTS = (Sun((0.4, 0.5, 0.8)), Sky((0.5, 0.7, 1.0)))


def looking_at(point, eye, size=(160, 120), degrees=20.0, dist=()) -> Camera:
    """A camera at `eye` whose vertical field of view is `degrees`, world Z up in the picture."""
    z = np.subtract(point, eye) / np.linalg.norm(np.subtract(point, eye))
    x = np.cross(z, (0, 0, 1)) / np.linalg.norm(np.cross(z, (0, 0, 1)))
    R = np.stack([x, np.cross(z, x), z])
    f = size[1] / 2 / np.tan(np.radians(degrees / 2))
    K = ((f, 0.0, (size[0] - 1) / 2), (0.0, f, (size[1] - 1) / 2), (0.0, 0.0, 1.0))
    return Camera(size, K, tuple(map(tuple, R.tolist())), tuple((-R @ np.asarray(eye)).tolist()), dist)


def by_float64(scene: Scene, rung: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ids (n,), depth (n,) and radiance (n, 3), every ray traced in float64 against everything: no Mitsuba."""
    n = scene.camera.width * scene.camera.height
    seen = Seen(np.full(n, -1, np.int32), np.zeros(n), np.zeros((n, 3)), np.full(n, -1, np.int32))
    bodies, lens, R = table(scene), lens_of(scene.camera), np.asarray(scene.camera.R_cam_board)
    v, u = np.divmod(np.arange(float(n)), scene.camera.width)
    d = np.stack(directions(np, lens, u, v))
    ids, t = trace(bodies, np.zeros((3, 1)), d)
    n_cam = np.stack(normal(bodies.at(ids), d * t)) * (ids >= 0)
    n_cam *= np.where((n_cam * d).sum(axis=0) > 0, -1, 1)
    sun = R @ scene.sun.to_light
    blocker = trace(bodies, d * t + n_cam * 1e-9 * t, sun[:, None])[0]
    blocker = np.where((n_cam.T @ sun > 0) & (rung == "shadow"), blocker, -1)
    seen = seen._replace(ids=ids, normal=n_cam.T @ R, blocker=blocker)
    return ids, t / UNIT, first_light(scene, ids, albedos(scene)[ids], seen.normal, d.T @ R, blocker, True)


def random_scene(k: int, size=(160, 120)) -> Scene:
    """Spheres and sheets on and above a table, as the shipped scenes have them; every third through a lens."""
    rng = np.random.default_rng(1000 + k)
    eye = (*rng.uniform(-0.5, 0.5, 2), rng.uniform(0.15, 0.8))
    dist = tuple((np.array([-0.12, 0.03, 0.001, -0.001]) * rng.random()).tolist()) if k % 3 == 0 else ()
    camera = looking_at((*rng.uniform(-0.1, 0.1, 2), 0.03), eye, size, rng.uniform(20, 70), dist)
    things = [
        Sphere((*rng.uniform(-0.15, 0.15, 2).tolist(), rng.uniform(0, 0.12)), rng.uniform(0.005, 0.06), Lambert(grey))
        for grey in [tuple(rng.uniform(0.1, 0.9, 3).tolist()) for _ in range(rng.integers(1, 12))]
    ]
    things += [Rectangle((0, 0, 0), (0.2, 0, 0), (0, 0.25, 0)), Rectangle((0, 0, -0.002), (1.5, 0, 0), (0, 1.5, 0))]
    u, v, _ = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    things.append(Rectangle((0.05, 0.05, 0.1), tuple((0.05 * u).tolist()), tuple((0.08 * v).tolist())))
    sun = Sun((*rng.normal(0, 0.6, 2).tolist(), 1.0))
    return Scene("random", camera, tuple(things), (sun, LIGHTS[1]))


@pytest.mark.parametrize("k", range(0, 224, 28))
def test_no_pixel_of_a_random_scene_differs_from_float64s_answer(k):
    """8 of 224 scenes (all 224 pass; the float32 of Mitsuba alone errs in some ten of their pixels)."""
    scene = random_scene(k)
    image = render(scene, "shadow", cache=False)
    ids, depth, colour = by_float64(scene, "shadow")
    assert (image.surface.ids.ravel() == ids).all()
    assert abs(image.mean.reshape(-1, 3) - colour).max() < 2e-4  # rounding of normals at a rim; a wrong shadow: 0.1
    np.testing.assert_allclose(image.surface.depth.ravel(), depth, rtol=1e-3)
    assert np.quantile(abs(image.surface.depth.ravel() - depth) / np.maximum(depth, 1e-9), 0.999) < 1e-5


def test_mitsubas_own_answer_stands_wherever_no_outline_is_within_a_hundredth_of_a_pixel(variant, monkeypatch):
    """Left to itself Mitsuba agrees with float64 in every pixel where rays moved by 0.01 px all meet the same."""
    scene = random_scene(9)
    monkeypatch.setattr("raytwin.twin.rendering.retrace_edges", lambda *_: np.zeros(0, int))
    image = render(scene, "shadow", cache=False, variant=variant)
    ids, _, colour = by_float64(scene, "shadow")
    alike = np.full(len(ids), True)
    for x, y in ((0.01, 0), (-0.01, 0), (0, 0.01), (0, -0.01)):
        (a, s, cx), (z, b, cy), last = scene.camera.K
        moved = Camera(scene.camera.image_size, ((a, s, cx - x), (z, b, cy - y), last), *_pose(scene.camera))
        beside, _, lit = by_float64(scene.with_camera(moved), "shadow")
        alike &= (beside == ids) & (abs(lit - colour).max(axis=1) < 0.02)
    assert alike.mean() > 0.95
    assert (image.surface.ids.ravel() == ids)[alike].all()
    assert abs(image.mean.reshape(-1, 3) - colour)[alike].max() < 2e-3


def _pose(camera: Camera) -> tuple:
    return camera.R_cam_board, camera.t_cam_board, camera.dist


def test_the_borders_of_an_image_are_the_pixels_with_another_value_beside_them():
    rng = np.random.default_rng(3)
    image = rng.integers(0, 2, (9, 11)) * (rng.random((9, 11)) < 0.2)
    padded = np.pad(image, 1, mode="edge")
    beside = np.stack([padded[1 + y : 10 + y, 1 + x : 12 + x] for y in (-1, 0, 1) for x in (-1, 0, 1)])
    assert (borders(image) == np.flatnonzero((beside != image).any(axis=0))).all()


AHEAD = Camera((5, 5), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0, 0, 0))
STRAIGHT = np.array([[0.0], [0.0], [1.0]])


def doubted(apart: float, *where: tuple[int, int]) -> bool:
    """Whether the middle pixel, which sees a sheet at 1 m, doubts it beside pixels that see another so far behind."""
    sheets = tuple(Rectangle((0, 0, 1 + z), (9, 0, 0), (0, 9, 0)) for z in (0, apart))
    met = np.zeros((5, 5), np.int32)
    for down, right in where:
        met[2 + down, 2 + right] = 1
    bodies = table(Scene("sheets", AHEAD, sheets))
    return bool(_doubted(bodies, met, np.array([12]), np.zeros((3, 1)), STRAIGHT)[0])


def test_the_first_objects_outline_is_doubted_as_any_others():
    """A ball's rim, a millionth of its distance beside the ray; then another object before it in the list."""
    ball = Sphere((0.1 * (1 + 1e-6), 0, 1), 0.1)
    for others in ((), (Sphere((0, 5, 1), 0.1),)):
        bodies = table(Scene("rim", AHEAD, (*others, ball)))
        for met, expected in ((len(others), True), (-1, False)):
            found = _doubted(bodies, np.full((5, 5), met, np.int32), np.array([12]), np.zeros((3, 1)), STRAIGHT)
            assert found[0] == expected


def test_a_pixel_is_doubted_where_one_of_eight_neighbours_lies_within_a_ten_thousandth_of_its_depth():
    assert doubted(0.99e-4, (0, 1))
    assert not doubted(1.01e-4, (0, 1))
    assert not doubted(0.5e-4)
    places = [(down, right) for down in range(-2, 3) for right in range(-2, 3) if down or right]
    for down, right in places:
        assert doubted(0.5e-4, (down, right)) == (max(abs(down), abs(right)) == 1)


def test_a_ray_grazes_a_rim_or_an_edge_that_it_passes_within_a_hundred_thousandth_of_the_way():
    for off in (-1.2, -0.8, 0.8, 1.2):
        aside = off * 1e-5 * 2.0
        things: list[Sphere | Rectangle] = [Sphere((r + aside, 0, 2.0), r) for r in (1e-4, 0.3)]
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            things.append(Rectangle(((0.5 + aside) * x, (0.5 + aside) * y, 2.0), (0.5, 0, 0), (0, 0.5, 0)))
        bodies = table(Scene("beside", AHEAD, tuple(things)))
        with np.errstate(all="ignore"):  # a sphere has no edges
            found = _grazes(bodies, np.zeros((3, 1)), STRAIGHT)
        assert (found == (abs(off) < 1)).all()


# ---------------------------------------------------------------------------------------------- far objects


def far_away(radii: float, count: int = 3, size=(64, 48)) -> Scene:
    """Balls on a floor, seen from `radii` radii away, as large in the picture at any distance."""
    rng, r = np.random.default_rng(7), 0.05
    side = r * max(2.5, 1.2 * count**0.5)
    eye = np.array((0.3, -0.8, 0.5)) / np.linalg.norm((0.3, -0.8, 0.5)) * radii * r
    camera = looking_at((0, 0, 0), tuple(eye.tolist()), size, np.degrees(2 * np.arctan(1.6 * side / radii / r)))
    things = [Sphere((*rng.uniform(-side, side, 2).tolist(), s), s, Lambert(tuple(rng.uniform(0.2, 0.9, 3).tolist())))
              for s in r * rng.uniform(0.9, 1, count)]  # fmt: skip
    return Scene("far", camera, (*things, Rectangle((0, 0, 0), (2 * side, 0, 0), (0, 2 * side, 0))), LIGHTS)


@pytest.mark.parametrize(
    ("variant", "radii"),
    [("llvm_ad_rgb", 130.0), ("scalar_rgb", 1e3), ("llvm_ad_rgb", 1e4), ("scalar_rgb", 1e5)],
    indirect=["variant"],
)
def test_spheres_at_any_distance_are_as_float64_sees_them_and_shade_the_floor_they_touch(variant, radii):
    """Mitsuba alone errs by 3e-5 at 1000 radii, 1e-4 at 10 000, and has wrong shadows at 100 000."""
    scene = far_away(radii)
    image = render(scene, "shadow", cache=False, variant=variant)
    ids, depth, colour = by_float64(scene, "shadow")
    assert (image.surface.ids.ravel() == ids).all()
    np.testing.assert_allclose(image.surface.depth.ravel(), depth, rtol=1e-7)
    assert abs(image.mean.reshape(-1, 3) - colour).max() < 5e-7


@pytest.mark.parametrize(
    ("variant", "count"), [("llvm_ad_rgb", MOST_IN_DOUBLES + 1), ("scalar_rgb", 300)], indirect=["variant"]
)
def test_in_a_crowd_of_far_spheres_what_the_eye_sees_is_float64s(variant, count):
    """Mitsuba alone errs by up to 1e-5."""
    scene = far_away(200.0, count)
    image = render(scene, "shadow", cache=False, variant=variant)
    ids, depth, colour = by_float64(scene, "shadow")
    assert (image.surface.ids.ravel() == ids).all()
    np.testing.assert_allclose(image.surface.depth.ravel(), depth, rtol=1e-6)
    assert abs(image.mean.reshape(-1, 3) - colour).max() < 5e-7


def test_light_is_followed_from_far_spheres_as_from_near_ones(compiled):
    """As the tracer follows it: |z| of each channel's mean below 4.5, by chance in 1 of 24 000 runs."""
    found = []
    for rung, radii in (("sky", 129.0), ("path", 1e5)):
        scene = far_away(radii, size=(24, 18))
        ours = render(scene, rung, samples=1024, seed=1, cache=False)
        theirs = speed.walk(scene, rung, "numpy64", sampling="center", samples=64, seed=2)
        error = (ours.mean.astype(float) - theirs.mean).mean(axis=(0, 1))
        sigma = np.sqrt((ours.variance.astype(float) + theirs.variance).sum(axis=(0, 1))) / (24 * 18)
        found.append(abs(error / sigma).max())
    assert max(found) < 4.5


def test_only_what_is_far_smaller_than_its_distance_from_the_eye_is_too_far():
    camera = looking_at((0, 0, 0), (0, -1.0, 0.0))
    for thing, far in (
        (Sphere((0, 0, 0), 1 / 127), False),
        (Sphere((0, 0, 0), 1 / 129), True),
        (Rectangle((0, 0, 0), (1 / 1023, 0, 0), (0, 0, 1e-6)), False),
        (Rectangle((0, 0, 0), (1 / 1025, 0, 0), (0, 0, 1e-6)), True),
    ):
        near = Sphere((0, 0, 0.5), 0.1)
        assert beyond_floats(table(Scene("s", camera, (near, thing)))) == [0, 1] * far
        assert beyond_floats(table(Scene("s", camera, (*[near] * MOST_IN_DOUBLES, thing)))) == []


# ---------------------------------------------------------------------------------------------- large objects


def weekend(radius: float, size=(160, 120)) -> Scene:
    """*Ray Tracing in One Weekend*'s last scene, the three large balls on the ground of this radius, under a sun."""
    ground = Sphere((0, 0, -radius), radius, Lambert((0.5, 0.5, 0.5)))
    balls = (Sphere((x, 0, 1), 1.0, Lambert((0.4, 0.2, 0.1))) for x in (0, -4, 4))
    return Scene("weekend", looking_at((0, 0, 0), (13, 3, 2), size), (ground, *balls), LIGHTS)


@pytest.mark.parametrize(
    ("variant", "radius"), [("llvm_ad_rgb", 100.0), ("scalar_rgb", 1e4), ("llvm_ad_rgb", 1e5)], indirect=["variant"]
)
def test_a_ground_of_any_radius_does_not_shade_itself(variant, radius):
    """Mitsuba alone shades 2180 of 19 200 pixels falsely at 1 km, 5846 at 10 km; its depth is off by 8e-5 and 7e-4."""
    scene = weekend(radius)
    image = render(scene, "shadow", cache=False, variant=variant)
    ids, depth, colour = by_float64(scene, "shadow")
    assert (image.surface.ids.ravel() == ids).all()
    np.testing.assert_allclose(image.surface.depth.ravel(), depth, rtol=1e-5)
    assert abs(image.mean.reshape(-1, 3) - colour).max() < 1e-4


@pytest.mark.parametrize(("variant", "half"), [("llvm_ad_rgb", 1e3), ("scalar_rgb", 1e5)], indirect=["variant"])
def test_a_floor_of_any_size_does_not_shade_itself(variant, half):
    """Mitsuba alone shades 1085 of 19 200 pixels of a floor of 10 km falsely, 7843 at 100 km."""
    floor = Rectangle((0.3, 0.2, 0), (half, 0, 0), (0, half, 0), Lambert((0.5, 0.5, 0.5)))
    scene = Scene("floor", looking_at((0, 0, 0), (13, 3, 2)), (Sphere((0, 0, 1), 1.0), floor), LIGHTS)
    image = render(scene, "shadow", cache=False, variant=variant)
    ids, depth, colour = by_float64(scene, "shadow")
    assert (image.surface.ids.ravel() == ids).all()
    np.testing.assert_allclose(image.surface.depth.ravel(), depth, rtol=1e-5)
    assert abs(image.mean.reshape(-1, 3) - colour).max() < 1e-4


def test_only_what_is_far_larger_than_its_distance_from_the_eye_is_too_large():
    camera = looking_at((0, 0, 0), (0, -1.0, 2.0))
    near, far = (0.0, -1.0), (0.0, 0.0)
    for thing, large in (
        (Sphere((*near, -29.9), 30.0), False),  # 1.9 m under the eye: 15.8 radii
        (Sphere((*near, -31.9), 32.0), True),  # 16.8
        (Sphere((*near, 2.0), 5.0), False),  # the eye is its centre
        (Sphere((*near, 2.0 - 32.0), 34.0), True),  # the eye inside, 2 m from its surface
        (Rectangle((*near, 0), (140, 0, 0), (0, 140, 0)), False),  # corner 198 m, 2 m under the eye
        (Rectangle((*near, 0), (143, 0, 0), (0, 143, 0)), True),
        (Rectangle((*far, -500), (1e4, 0, 0), (0, 1e4, 0)), False),
        (Rectangle((150, -1.0, 2.0), (100, 0, 0), (0, 100, 0)), False),  # in its plane, but 50 m beside it
    ):
        assert beyond_floats(table(Scene("s", camera, (thing,)))) == [0] * large
    assert beyond_floats(table(Scene("none", camera))) == []


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e6])
def test_distances_are_those_of_fifty_digits(radius):
    """To a billionth of the way, or of the sphere's size, from outside, from inside, and off the surface itself."""
    camera = Camera((8, 8), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0, 0, 0))
    rng = np.random.default_rng(5)
    sphere = Sphere((0.3 * radius, -0.2 * radius, 1.7 * radius), radius)
    sheet = Rectangle((0.1, 0.2, 3.0), (2, 0, 1), (0, 1.5, 0))
    bodies = table(Scene("s", camera, (sphere, sheet)))
    mpmath.mp.dps = 50
    found = 0
    for _ in range(60):
        o = rng.normal(0, 2, 3) * UNIT * radius
        d = 0.5 * rng.normal(size=3) + (np.array(sphere.center) * UNIT - o) / (radius * UNIT)
        d /= np.linalg.norm(d)
        f = [mpmath.mpf(float(a)) - mpmath.mpf(c) * 1024 for a, c in zip(o, sphere.center, strict=True)]
        dm = [mpmath.mpf(float(a)) for a in d]
        b, c = sum(p * q for p, q in zip(f, dm, strict=True)), sum(p * p for p in f) - (mpmath.mpf(radius) * 1024) ** 2
        dd = sum(q * q for q in dm)
        roots = [] if b * b < dd * c else [(-b + s * mpmath.sqrt(b * b - dd * c)) / dd for s in (-1, 1)]
        true = min((r for r in roots if r > 0), default=mpmath.inf)
        t = distance(np, bodies.at(0), o, d)
        assert np.isinf(t) == mpmath.isinf(true)
        if np.isfinite(t):
            found += 1
            assert abs(t - true) < 1e-9 * (true + radius * UNIT)
    assert found > 20
    for _ in range(60):
        o, d = rng.normal(0, 1, 3) * UNIT, rng.normal(size=3)
        d /= np.linalg.norm(d)
        A = np.stack([(2, 0, 1), (0, 1.5, 0), -d / UNIT], axis=1) * UNIT
        a, b, t = np.linalg.solve(A, o - np.array(sheet.center) * UNIT)
        expected = t if max(abs(a), abs(b)) <= 1 and t > 0 else np.inf
        assert distance(np, bodies.at(1), o, d) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("variant", "rung", "sampling"),
    [("llvm_ad_rgb", "path", "area"), ("llvm_ad_rgb", "sky", "center"), ("llvm_ad_rgb", "shadow", "area"),
     ("scalar_rgb", "path", "center"), ("scalar_rgb", "sky", "area"), ("scalar_rgb", "shadow", "center")],
    indirect=["variant"],
)  # fmt: skip
def test_own_rays_and_bounces_agree_with_mitsubas_pixel_by_pixel(variant, monkeypatch, rung, sampling):
    """A scene that Mitsuba can hold, all of it treated as too large for it: the same light, at every depth.

    Means of the whole picture within 4 standard errors (6 in 100 000 by chance); pixels scatter as their variances say.
    """
    scene = random_scene(9, (24, 18))
    options = {"sampling": sampling, "samples": 64 if variant == "scalar_rgb" else 2048, "cache": False}
    theirs = render(scene, rung, seed=1, variant=variant, **options)
    for engine in ("jit", "scalar"):
        monkeypatch.setattr(f"raytwin.twin.{engine}.beyond_floats", lambda bodies: list(range(len(bodies.radius))))
    ours = render(scene, rung, seed=2, variant=variant, **options)
    assert (ours.surface.ids == theirs.surface.ids).all()
    if ours.variance is None:
        np.testing.assert_allclose(ours.mean, theirs.mean, atol=2e-4)
        return
    z = (ours.mean.astype(float) - theirs.mean)[..., 1]
    variance = (ours.variance + theirs.variance)[..., 1].astype(float)
    assert abs(z.sum()) < 4 * np.sqrt(variance.sum())
    noisy = variance > 1e-9
    assert np.mean(z[noisy] ** 2 / variance[noisy]) == pytest.approx(1.15, abs=0.3)  # 15 degrees of freedom: 1.15
