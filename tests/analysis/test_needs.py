"""What a scene needs: the choice rerun, bounds against closed forms, and what the tool must refuse to say."""

from math import inf

import msgspec
import numpy as np
import pytest
from program import raytwin, refused
from truths import WHITE, from_element, grey, in_wedge, view_of, wedge

from raytwin import files, twin
from raytwin.analysis import recommend
from raytwin.analysis.light_parts import gone
from raytwin.analysis.recommend import needs, search
from raytwin.analysis.recommend.bounds import Bounds, shading
from raytwin.analysis.recommend.converged import measure
from raytwin.analysis.recommend.search import Search, Tried
from raytwin.analysis.recommend.simplify import still_terms
from raytwin.compare import METRICS
from raytwin.errors import InputError
from raytwin.lights.environment_map import environment_map
from raytwin.renderers.subject_renderers import Filled, PathTraced, Speculated, Supersampled
from raytwin.scene import Camera, Environment, Rectangle, Scene, Sphere, Sun
from raytwin.scene.lens import distort
from raytwin.speed import light_parts, walk
from raytwin.tracer import STAGES, sample_cosine_hemisphere, trace
from raytwin.tracer.world import intersect


@pytest.fixture(scope="module")
def fast() -> str:
    twin.activate()
    return "drjit32"


@pytest.fixture(scope="module")
def small(overlap) -> Scene:
    return overlap.with_camera(overlap.camera.resized(96, 72))


# ------------------------------------------------------------------------------------------------ bounds


def test_a_spheres_largest_share_is_howells_and_is_reached_above_it(rng):
    """F of a ball over a sheet is at most r²/d²; over any point of another ball below what the bound says."""
    ball = Sphere((0.1, 0.2, 0.9), 0.3, grey(0.5))
    sheet = Rectangle((0, 0, 0), (2, 0, 0), (0, 2, 0), grey(0.5))
    camera = view_of((0, 0, 0), (0, -3, 2), 3)
    bounds = Bounds(Scene("a ball over a sheet", camera, (sheet, ball), WHITE))
    assert bounds.shares[0, 1] == pytest.approx(from_element(3.0, 1.0), rel=1e-12)
    other = Sphere((0.9, -0.1, 1.2), 0.2, grey(0.5))
    most = Bounds(Scene("two balls", camera, (other, ball), WHITE)).shares[0, 1]
    n = rng.normal(size=(500, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    way = np.array(ball.center) - (np.array(other.center) + 0.2 * n)
    far = np.linalg.norm(way, axis=1)
    shares = [from_element(d / 0.3, float(c)) for d, c in zip(far, (n * way).sum(axis=1) / far, strict=True)]
    assert 0.5 * most < max(shares) <= most


@pytest.mark.parametrize("degrees", [60, 90, 120])
def test_in_a_wedge_the_bound_holds_for_every_bounce_and_is_the_geometric_tail(degrees):
    scene = Scene("wedge", view_of((0.1, 0, 0), (1, 0.5, 1), 1), wedge(degrees, 0.5, 0.5, 500.0), WHITE)
    bounds = Bounds(scene)
    for n in range(6):
        left_out = in_wedge(degrees, 0.5, 0.5, inf) - in_wedge(degrees, 0.5, 0.5, n)
        assert (
            left_out < bounds.beyond(n) == pytest.approx(0.5 * 0.5 ** (n + 1) / (1 - 0.5))
        )  # a L_s (a F)^n+1 / (1 - a F)


def test_between_two_albedos_the_bound_shrinks_by_both_in_turn():
    """Shares of 1 at most: L = .8, .3, then each times the other's: (.24 + .192) / (1 - .24) is left beyond none."""
    scene = Scene("wedge", view_of((0.1, 0, 0), (1, 0.5, 1), 1), wedge(90, 0.8, 0.3, 500.0), WHITE)
    bounds = Bounds(scene)
    assert bounds.beyond(0) == pytest.approx((0.24 + 0.192) / 0.76)
    assert bounds.beyond(2) == pytest.approx((0.24 + 0.192) / 0.76 * 0.24)
    for n in range(5):
        for one, other in ((0.8, 0.3), (0.3, 0.8)):
            assert in_wedge(90, one, other, inf) - in_wedge(90, one, other, n) < bounds.beyond(n)


def test_nothing_is_proven_of_a_white_furnace_and_all_of_a_convex_body():
    camera = view_of((0, 0, 0), (0, 0, 3), 3)
    white = Scene("furnace", camera, wedge(90, 1.0, 1.0, 5.0), WHITE)
    assert Bounds(white).beyond(5) == inf
    assert Bounds(white).of_metric("rmse", inf) is None
    alone = Bounds(Scene("ball", camera, (Sphere((0, 0, 0), 1.0, grey(1.0)),), (*WHITE, Sun((0, 0, 1.0)))))
    assert (alone.beyond(0), alone.occlusion(), alone.shadow()) == (0, 0, 0)


def test_a_sphere_round_the_eye_is_filled_by_itself():
    camera = view_of((0, 0, 0), (0, 0, 3), 3)
    assert Bounds(Scene("within", camera, (Sphere((0, 0, 0), 9.0, grey(0.5)),), WHITE)).shares.tolist() == [[1.0]]


@pytest.mark.parametrize("seed", range(12))
def test_no_object_that_shades_another_is_missed(seed):
    """Rays to the sun from points on an object meet no object that is not said to shade it."""
    rng = np.random.default_rng(seed)
    count, planes = int(rng.integers(1, 100)), int(rng.integers(0, 4))
    radii = rng.choice([0.02, 0.05, 0.6], count, p=[0.6, 0.35, 0.05]).tolist()
    spheres = tuple(Sphere(tuple(c), r) for c, r in zip(rng.uniform(-1, 1, (count, 3)).tolist(), radii, strict=True))
    leaves = tuple(
        Rectangle(tuple(c), (0.2, 0.0, 0.0), (0.0, 0.2, 0.1)) for c in rng.uniform(-1, 1, (planes, 3)).tolist()
    )
    scene = Scene("cloud", None, (*spheres, *leaves), (Sun(tuple(rng.uniform(-1, 1, 3).tolist())),))
    found = shading(scene)
    assert not np.diag(found).any()
    for j, thing in enumerate(scene.objects):
        if isinstance(thing, Sphere):
            way = rng.normal(size=(3, 40))
            off = thing.radius * way / np.linalg.norm(way, axis=0)
        else:
            off = np.array([thing.half_u, thing.half_v]).T @ rng.uniform(-1, 1, (2, 40))
        points = tuple(np.array(thing.center)[:, None] + off)
        for i in np.flatnonzero(~found[j]).tolist():
            with np.errstate(all="ignore"):
                meets = intersect(points, scene.sun.to_light, scene.objects[i], STAGES) < np.inf
            assert i == j or not meets.any(), (i, j)


@pytest.mark.parametrize("scale", [1.0, 50.0])
def test_a_caster_may_be_a_ten_thousandth_beyond_touching_for_float32_and_no_further(scale):
    """Of radii 0.1 and 0.05 under the zenith: 0.15 (1 + 1e-4), and 1e-6 of the largest coordinate for each."""
    room = 0.15 * 1.0001 + 2e-6

    def shaders(x: float, z: float) -> list[list[int]]:
        spheres = (Sphere((0.0, 0.0, 0.0), 0.1 * scale), Sphere((0.0, x * scale, z * scale), 0.05 * scale))
        found = shading(Scene("two", None, spheres, (Sun((0.0, 0.0, 1.0)),)))
        return [np.flatnonzero(row).tolist() for row in found]

    assert shaders(room - 2e-7, 1.0) == [[1], []]
    assert shaders(room + 2e-7, 1.0) == [[], []]
    assert shaders(0.0, -1.0) == [[], [0]]
    low = 0.15 * 1.0001 + 2e-6 * 0.15
    assert shaders(0.0, -low * (1 - 1e-6)) == [[1], [0]]
    assert shaders(0.0, -low * (1 + 1e-6)) == [[], [0]]


@pytest.mark.parametrize("name", ["overlap", "gloss", "studio"])
def test_no_part_of_the_light_exceeds_its_bound(scenes, fast, name):
    """Each pixel's mean over 64 samples has noise, so 4.5 standard errors are granted to the largest of them."""
    scene = files.read_scene(scenes / name).scene
    small = scene.with_camera(scene.camera.resized(96, 72))
    bounds, parts = Bounds(small), light_parts(small, fast, samples=64, depth=16)

    def largest(*names):
        mean, variance = (sum(getattr(parts[n], which).astype(float) for n in names) for which in ("mean", "variance"))
        return (np.abs(mean) - 4.5 * np.sqrt(len(names) * variance)).max()

    assert (0 < largest("shadow") <= bounds.shadow()) or name == "studio"  # which has no sun
    assert 0 < largest("occlusion") <= bounds.occlusion()
    assert 0 < largest("bounce 1", "bounce 2", "bounce 3+") <= bounds.beyond(0)
    assert largest("bounce 2", "bounce 3+") <= bounds.beyond(1)


@pytest.mark.parametrize("seed", range(4))
def test_harmonics_miss_a_maps_light_by_no_more_than_its_bound(seed):
    """E/π by 2¹⁴ directions of each normal's hemisphere, lights of a few texels; the largest even sky, too."""
    light = np.random.default_rng(seed).gamma(0.05, 10, (8, 16, 3)).astype(np.float32)
    tables = environment_map(Environment((16, 8), light.tobytes()))
    camera = view_of((0, 0, 0), (0, 0, 3), 3)
    bounds = Bounds(
        Scene("map", camera, (Sphere((0, 0, 0), 1.0, grey(1.0)),), (Environment((16, 8), light.tobytes()),))
    )
    a, b = ((i.ravel() + 0.5) / 128 for i in np.mgrid[:128, :128])
    worst, brightest = np.zeros(3), np.zeros(3)
    for n in np.random.default_rng(seed).normal(size=(40, 3)):
        n /= np.linalg.norm(n)
        d = sample_cosine_hemisphere(tuple(np.full(a.size, c) for c in n), a, b)
        even = np.array([channel.mean() for channel in tables.radiance(d)])
        worst = np.maximum(worst, np.abs(even - np.array(tables.diffuse_irradiance(tuple(n)))))
        brightest = np.maximum(brightest, even)
    assert (worst <= bounds.unlike).all()
    assert (worst > 0.03 * bounds.unlike).all()
    assert (brightest <= bounds.even).all()
    assert (bounds.even < 6 * brightest).all()


def test_what_a_taken_sphere_changes_stays_below_its_bound(small, fast):
    for i in range(3):
        others = tuple(gone(o) if k == i else o for k, o in enumerate(small.objects))
        alone = msgspec.structs.replace(small, objects=others)
        before, after = (walk(s, "path", fast, samples=64, depth=8, surface=False) for s in (small, alone))
        ids = trace(small, "surface").surface.ids, trace(alone, "surface").surface.ids
        same = (ids[0] == ids[1]) & (ids[0] != i)
        assert 0 < np.abs(after.mean - before.mean)[same].mean() <= Bounds(small).without(i)


# ------------------------------------------------------------------------------------------------ the lens


def camera(*dist: float) -> Camera:
    K = ((420.0, 0.0, 404.2), (0.0, 418.0, 297.1), (0.0, 0.0, 1.0))
    return Camera((800, 600), K, ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)), (0.0, 0.0, 1.0), dist)


def test_terms_that_move_no_pixel_are_found_by_projecting_every_pixel_without_them():
    lens = camera(-0.05, 2e-6, 1e-5, -3e-6, 4e-6)
    moves = still_terms(lens)
    assert moves.terms == ("k2", "p1", "p2", "k3")
    # Ideal points all over what the frame sees: the border's are the farthest, so a little more does no harm inside.
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1.3, 1.3, 800), np.linspace(-1.0, 1.0, 800)))
    u, v = distort(x, y, lens.coefficients)
    inside = (abs(420 * u + 404.2 - 399.5) <= 400) & (abs(418 * v + 297.1 - 299.5) <= 300)
    plain = distort(x, y, (-0.05, 0, 0, 0, 0))
    farthest = np.hypot(420 * (u - plain[0]), 418 * (v - plain[1]))[inside].max()
    assert farthest <= moves.measured <= moves.bound < 0.05
    assert farthest == pytest.approx(moves.measured, rel=0.05)


def test_terms_are_left_out_together_only_while_their_sum_stays_still():
    one = still_terms(camera(0.0, 0.0, 3e-5))
    assert one.terms == ("p1",)
    assert 0.025 < one.bound < 0.05
    both = still_terms(camera(0.0, 0.0, 3e-5, 3e-5))
    assert len(both.terms) == 1
    assert still_terms(camera(-0.05, 0.01)).terms == ()
    assert still_terms(camera()).terms == ()


# ------------------------------------------------------------------------------------------------ the error's estimate


@pytest.mark.parametrize("metric", ["rmse", "relmse"])
def test_an_error_far_below_the_noise_of_a_pixel_is_told_and_its_interval_holds(metric, rng):
    """200 truths with ten times the error's noise: the mean is right to 4 standard errors, and the interval of two,
    which a correlation of channels and heavy tails make wider, misses in fewer than 1 in 20 (by chance 1e-4)."""
    error, noise, shape = 0.01, 0.1, (48, 64, 3)
    whole = np.full(shape, 0.5, np.float32)
    exact = error if metric == "rmse" else error**2 / 0.26
    found = []
    for _ in range(200):
        one, other = (error + noise * rng.standard_normal(shape).astype(np.float32) for _ in range(2))
        found.append(measure(metric, one, other, whole))
    assert all(e.least <= e.value <= e.most for e in found)
    assert sum(not e.least <= exact <= e.most for e in found) < 10
    squares = np.array([e.value**2 if metric == "rmse" else e.value for e in found])
    clipped = squares[squares > 0]
    assert len(clipped) > 100
    assert np.median(squares) == pytest.approx(
        exact**2 if metric == "rmse" else exact, abs=4 * 1.25 * squares.std() / 14
    )


# ------------------------------------------------------------------------------------------------ the choice


def test_nothing_at_all_needs_no_tracer(fast):
    found = needs(Scene("empty", view_of((0, 0, 0), (0, 0, 3), 3), (), WHITE), 1e-6, engine=fast)
    assert found.choice is not None
    assert (found.choice.rung, found.choice.error, found.truth.noise) == ("none", 0.0, 0.0)
    assert {n.what for n in found.not_needed} == {"shadows of the sun", "occlusion of the sky", "bounces"}
    assert {n.bound for n in found.not_needed} == {0.0}


@pytest.mark.parametrize(
    ("tolerance", "rungs"), [(0.1, {"lambert"}), (0.03, {"shadow"}), (0.008, {"path", "sky", "shadow"})]
)
def test_the_choice_rerun_meets_the_tolerance_and_the_next_cheaper_fails(small, fast, tolerance, rungs):
    """Against a truth of its own, with other random numbers; a tenth is granted to another seed's noise."""
    found = needs(small, tolerance, engine=fast)
    choice = found.choice
    assert choice is not None
    assert choice.rung in rungs
    assert choice.error_most <= tolerance
    assert found.truth.noise <= tolerance / 3
    whole = walk(small, "path", fast, samples=512, seed=77, depth=16, surface=False).mean
    again = rendered(small, choice, seed=5)
    assert METRICS["rmse"].function(again, whole) <= 1.1 * tolerance
    cheaper = found.rejected[0]
    assert cheaper.error > tolerance * 0.9
    assert METRICS["rmse"].function(rendered(small, cheaper, seed=5), whole) > 0.9 * tolerance


def rendered(scene: Scene, row: recommend.Row, seed: int) -> np.ndarray:
    if row.rung == "none":
        return Filled()(scene).mean
    if row.rung in ("sky", "path"):
        return walk(
            scene, row.rung, row.engine, sampling=row.sampling, samples=row.samples, seed=seed, depth=row.depth
        ).mean
    if row.samples > 1:
        return Supersampled(row.rung, row.engine, row.samples)(scene).mean
    if row.speculation > 1:
        return Speculated(row.rung, row.engine, n=row.speculation)(scene).mean
    return trace(scene, row.rung).mean


def test_the_sphere_behind_the_camera_is_spared_and_one_that_shades_what_is_seen_is_not(scenes, fast):
    grazing = files.read_scene(scenes / "grazing").scene
    thin = grazing.with_camera(grazing.camera.resized(96, 72))
    spared = {n.what: n for n in needs(thin, 1.0, engine=fast).not_needed}
    assert "no pixel sees it" in spared[grazing.names[3]].why
    above = Sphere((0.0, 0.0, 2.2), 0.3, grey(0.5))
    floor = Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), grey(0.5))
    lit = Scene("shade", view_of((0, 0, 0), (0, -1.0, 1.0), 1.0, 32), (floor, above), (Sun((0, 0, 1.0)), *WHITE))
    assert not Bounds(lit).seen[1]
    assert not any(n.what.startswith("sphere") for n in needs(lit, 0.1, engine=fast).not_needed)


def test_a_map_is_as_fine_as_its_shading_needs(small, fast):
    """A map that hardly changes from row to row lights the same averaged; one with a lamp does not."""
    rows = np.where(np.arange(16) % 2, 0.29, 0.31)[:, None, None] * np.ones((16, 32, 3))
    lamp = np.full((16, 32, 3), 0.1)
    lamp[3, 5:9] = 40.0
    kept = {}
    for name, texels in (("even", rows), ("lamp", lamp)):
        around = Environment((32, 16), texels.astype("<f4").tobytes())
        found = needs(msgspec.structs.replace(small, lights=(small.sun, around)), 0.05, engine=fast)
        kept[name] = [int(n.what.split()[-2]) for n in found.not_needed if n.what.startswith("a map of more than")]
    assert kept["even"][0] <= 4
    assert kept["lamp"] == [] or kept["lamp"][0] > kept["even"][0]


def test_a_truth_too_noisy_for_the_tolerance_says_so_and_claims_nothing(small, fast, monkeypatch):
    monkeypatch.setattr(search, "MOST_WALKS", 1)
    monkeypatch.setattr(search, "MOST_WALKS_NUMPY", 1)
    found = needs(small, 1e-4, engine=fast)
    assert found.choice is None
    assert found.not_needed == ()
    assert found.reason.startswith("cannot tell")


def test_a_tolerance_or_metric_that_is_none_is_refused(small):
    for tolerance in (0.0, -1.0, float("nan"), inf):
        with pytest.raises(InputError, match="--tolerance: expected a finite number > 0"):
            needs(small, tolerance)
    with pytest.raises(InputError, match="--metric: expected one of rmse"):
        needs(small, 0.1, "psnr")


def test_the_command_writes_what_it_says(tmp_path):
    run = raytwin("needs", "single", "--tolerance", "0.1", "--size", "80x60", "--json", tmp_path / "a.json")
    assert run.returncode == 0, run.stderr
    assert "Cheapest          lambert" in run.stdout
    found = msgspec.json.decode((tmp_path / "a.json").read_bytes(), type=recommend.Needs)
    assert found.tolerance == 0.1
    assert found.rejected[0].rung == "none"
    refused(raytwin("needs", "single", "--tolerance", "0"), "--tolerance")


def test_samples_are_halved_until_half_of_them_fail():
    found = Search.__new__(Search)
    found.meet, found.fail, found._verify = [], [], lambda tried: None
    found._meets = lambda tried: tried.method.samples >= 12
    method = PathTraced(samples=64)
    found._fewer(Tried(method, 6.4), method)
    assert [(t.method.samples, t.guess) for t in found.meet] == [(32, 3.2), (16, 1.6)]
    assert [(t.method.samples, t.guess) for t in found.fail] == [(8, 0.8)]
