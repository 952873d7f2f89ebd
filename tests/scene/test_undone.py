"""Can this lens be undone: against closed forms, a march by other means, and everybody who asks."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raytwin.errors import InputError
from raytwin.scene import Camera
from raytwin.scene.lens import (
    CELLS,
    LEAST_DETERMINANT,
    MAX_SHARE_WITHOUT_RAYS,
    Folds,
    check_lens,
    determinant,
    distort,
    inverse,
    undone,
    without_ray,
)

SIZE = (640, 480)
UNTURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def camera_of(f=600.0, center=(319.5, 239.5), dist=(), fy=None) -> Camera:
    K = ((f, 0.0, center[0]), (0.0, fy or f, center[1]), (0.0, 0.0, 1.0))
    return Camera(SIZE, K, UNTURNED, (0.0, 0.0, 0.0), tuple(dist))


def fault_of(camera: Camera) -> str:
    return undone(camera.K, camera.dist, camera.image_size).fault


@st.composite
def cameras(draw) -> Camera:
    """From mild to absurd: about a quarter cannot be undone."""
    unit = st.floats(-1, 1)
    size = draw(st.sampled_from([0.05, 0.3, 1.0, 3.0]))
    dist = [draw(unit) * size * share for share in (1, 1, 0.1, 0.1, 1)][: draw(st.integers(1, 5))]
    center = 320 + 320 * draw(unit), 240 + 240 * draw(unit)
    f = draw(st.floats(200, 1500))
    return camera_of(f, center, dist, f * draw(st.floats(0.9, 1.1)))


@pytest.mark.parametrize("k1", [-3.0, -0.4])
def test_the_inverse_ends_where_k1_alone_folds(k1):
    """r (1 + k1 r²) is greatest at r = 1 / √(-3 k1), where it is 2/3 of that. Below, Viète: r is a sine of a third."""
    camera, s = camera_of(300.0, dist=(k1,)), math.sqrt(-3 * k1)
    known = undone(camera.K, camera.dist, SIZE)
    wanted = np.linalg.norm((known.pixels - (319.5, 239.5)) / 300, axis=1)
    assert not known.found[wanted > 2 / 3 / s].any()
    assert known.found[wanted < 0.9999 * 2 / 3 / s].all()
    r = 2 / s * np.sin(np.arcsin(1.5 * s * wanted[known.found]) / 3)
    np.testing.assert_allclose(np.linalg.norm(known.ideal[known.found], axis=1), r, rtol=0, atol=1e-9)


def dipping(m: float, least: float) -> tuple[float, ...]:
    """k1 = -2 c m / 3, k2 = c / 5 with c = (1 - least) / m²: its slope is c (r² - m)² + least."""
    c = (1 - least) / m**2
    return -2 * c * m / 3, c / 5, 0.0, 0.0, 0.0


def test_no_inverse_lies_past_a_shallow_fold_where_the_polynomial_comes_back():
    rng = np.random.default_rng(20251121)
    for m, dip in zip(rng.uniform(0.05, 1, 15), 10 ** rng.uniform(-4, -0.5, 15), strict=True):
        dist = dipping(m, -dip)
        r = math.sqrt(m - m * math.sqrt(dip / (1 + dip)))
        fold = r * (1 + dist[0] * r**2 + dist[1] * r**4)
        wanted = np.geomspace(0.05, 100, 200) * math.sqrt(m)
        turn = rng.uniform(0, 2 * math.pi)
        _, _, found = inverse(wanted * math.cos(turn), wanted * math.sin(turn), dist)
        assert not found[wanted > 1.0001 * fold].any()
        assert found[wanted < 0.99 * fold].all()


def test_a_place_that_is_squeezed_two_thousandfold_counts_as_a_fold_and_a_hundredfold_does_not():
    wanted = np.array([0.3, 2.0])  # before and past it
    for least, passes in ((5e-4, False), (1e-2, True)):
        _, _, found = inverse(wanted, 0 * wanted, dipping(0.5, 2 * least))  # the determinant: the slope times r'/r
        assert found.tolist() == [True, passes]


def test_a_fold_of_the_tangential_part_is_found_where_every_radial_slope_grows():
    """With p1 alone, above the middle y' = y + 3 p1 y²: it turns at y = -1 / (6 p1), pixel v = cy - fy / (12 p1)."""
    for p1, folds in ((0.3, True), (0.1, False)):
        camera = camera_of(600.0, dist=(0.0, 0.0, p1))
        known = undone(camera.K, camera.dist, SIZE)
        top = np.flatnonzero((known.pixels == (319.5, -0.5)).all(axis=1))[0]
        turn = 600 / (12 * p1)
        assert (turn < 240) is folds
        assert known.found[top] == (not folds)
        assert (fault_of(camera) != "") is folds


def test_the_pixel_that_cannot_be_undone_is_named_in_one_line():
    with pytest.raises(InputError) as caught:
        check_lens(camera_of(dist=(-2.5,)))
    assert str(caught.value) == (
        "camera.dist: expected a distortion that can be undone over most of the image, "
        "got [-2.5], which cannot at pixel (-0.5, -0.5): two directions share it, or Newton's method does not come to "
        "the one, nor over 81 % of it"
    )
    check_lens(camera_of(2000.0, dist=(-2.5,)))  # a longer lens sees only the part before the fold


def test_pixels_past_a_fold_and_those_within_a_cell_of_it_have_no_ray_and_a_warning_counts_them():
    """k1 folds at the distorted radius 2/3 / √(-3 k1): here at 0.4 of 600 px, where the frame's corner is at 0.667."""
    camera = camera_of(dist=(-((2 / 3 / 0.4) ** 2) / 3,))
    with pytest.warns(Folds, match=r"no ray belongs to (\d+) of 307200 pixels \(\d+ %\): left black") as said:
        lost = without_ray(camera)
    assert str(lost.sum()) in str(said[0].message)
    v, u = np.mgrid[:480, :640]
    away = np.hypot(u - 319.5, v - 239.5)
    assert lost[away >= 240].all()
    assert not lost[away < 240 - np.hypot(640, 480) / CELLS].any()
    assert without_ray(camera_of(dist=(-0.1,))) is None
    check_lens(camera)


def test_what_newtons_method_does_not_find_its_way_through_has_no_ray_either():
    camera = camera_of(401.0, (101.0, 409.0), (0.853, -0.066, -0.01, -0.114, -0.089))
    known = undone(camera.K, camera.dist, SIZE)
    xd, yd = ((known.pixels[~known.found] - (101.0, 409.0)) / 401).T
    share, least = march(xd, yd, camera.coefficients)
    assert (share == 1).all()
    assert (least > LEAST_DETERMINANT).all()
    u, v = known.pixels[~known.found].T
    with pytest.warns(Folds):
        lost = without_ray(camera)
    inside = (np.abs(u - 320) < 319) & (np.abs(v - 240) < 239)
    assert lost[v[inside].round().astype(int), u[inside].round().astype(int)].mean() > 0.9


@settings(max_examples=12, deadline=None)
@given(cameras())
def test_what_is_undone_comes_back_and_grows_all_along_the_line_to_it(camera):
    known, dist = undone(camera.K, camera.dist, SIZE), camera.coefficients
    xd, yd = ((known.pixels[known.found] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
    x, y = known.ideal[known.found].T
    np.testing.assert_allclose(
        distort(x, y, dist), (xd, yd), rtol=0, atol=1e-11 * (1 + np.hypot(xd, yd).max(initial=0))
    )
    for part in np.linspace(0, 1, 500):
        assert (determinant(part * x, part * y, dist) >= 0.99 * LEAST_DETERMINANT).all()
    # One to one: nothing else on the line is taken for the inverse there.
    for part in (0.25, 0.5, 0.999):
        hx, hy, found = inverse(*distort(part * x, part * y, dist), dist)
        np.testing.assert_allclose((hx[found], hy[found]), (part * x[found], part * y[found]), rtol=1e-6, atol=1e-6)


def march(xd, yd, dist, h=4e-3, most=3000):
    """(share, least determinant) of each way, by another route: by arc length in the ideal plane, Runge and Kutta.

    With A = adj J the curve dx/dτ = A q / |A q|, ds/dτ = det J / |A q| has distort(x) = s q; it walks through a fold
    instead of stopping at it, so that s turns back there.
    """

    def slope(x, y):
        k1, k2, p1, p2, k3 = dist
        rr = x * x + y * y
        g, dg = 1 + k1 * rr + k2 * rr**2 + k3 * rr**3, 2 * k1 + 4 * k2 * rr + 6 * k3 * rr**2
        a = g + x * x * dg + 2 * p1 * y + 6 * p2 * x
        b = x * y * dg + 2 * p1 * x + 2 * p2 * y
        c = g + y * y * dg + 6 * p1 * y + 2 * p2 * x
        wx, wy = c * xd - b * yd, a * yd - b * xd
        n = np.hypot(wx, wy)
        return wx / n, wy / n, (a * c - b * b) / n, a * c - b * b

    x, y, s = np.zeros((3, len(xd)))
    best, least, open_ = np.zeros(len(xd)), np.ones(len(xd)), np.ones(len(xd), bool)
    for _ in range(most):
        one = slope(x, y)
        two = slope(x + h / 2 * one[0], y + h / 2 * one[1])
        three = slope(x + h / 2 * two[0], y + h / 2 * two[1])
        four = slope(x + h * three[0], y + h * three[1])
        dx, dy, ds, _ = ((a + 2 * b + 2 * c + d) * h / 6 for a, b, c, d in zip(one, two, three, four, strict=True))
        least = np.where(open_, np.minimum(least, one[3]), least)
        open_ &= one[3] > 0
        best = np.where(open_, s, best)
        open_ &= s < 1
        if not open_.any():
            return np.minimum(best, 1), least
        x, y, s = x + dx, y + dy, s + ds
    return np.minimum(best, 1), least


@pytest.mark.parametrize("seed", range(8))
def test_a_march_by_another_route_ends_at_the_same_places(seed):
    """Lenses from mild to absurd, in which alone Newton's method misses what the march reaches."""
    rng = np.random.default_rng(seed)
    for size in (0.05, 0.3, 1.0, 3.0):
        dist = rng.uniform(-size, size, 5) * (1, 1, 0.1, 0.1, 1)
        camera = camera_of(rng.uniform(200, 1500), (640 * rng.random(), 480 * rng.random()), dist.tolist())
        known = undone(camera.K, camera.dist, SIZE)
        some = np.linspace(0, len(known.found) - 1, 60).astype(int)
        xd, yd = ((known.pixels[some] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
        away = np.hypot(xd, yd) > 1e-3
        with np.errstate(all="ignore"):
            share, least = march(xd[away], yd[away], camera.coefficients)
        found = known.found[some][away]
        # Between 0 and LEAST_DETERMINANT, and within a step of either, both answers are correct.
        assert (share[found] == 1).all()
        assert not found[least < 0].any()
        missed = ~found & (least > 3 * LEAST_DETERMINANT) & (share == 1)
        assert size >= 1 or not missed.any()


@pytest.mark.filterwarnings("ignore::raytwin.scene.lens.Folds")
@settings(max_examples=12, deadline=None)
@given(cameras())
def test_tracer_and_twin_take_the_same_lenses_and_end_in_the_same_place(camera):
    from raytwin.fast.boxes import field_of_view
    from raytwin.fast.frame import newton_steps
    from raytwin.tracer.pixel_to_ray import undistort
    from raytwin.twin import activate
    from raytwin.twin.opencv_sensor import lens_at

    activate()
    import mitsuba as mi
    from drjit.llvm.ad import Float64

    known = undone(camera.K, camera.dist, SIZE)
    lost = without_ray(camera)
    assert (field_of_view(camera) is None) >= bool(fault_of(camera))
    if lost is not None and lost.mean() > MAX_SHARE_WITHOUT_RAYS:
        for ask in (check_lens, newton_steps, lambda lens: lens_at(lens, np.zeros(3))):
            with pytest.raises(InputError, match="undone over most"):
                ask(camera)
        return
    u, v = known.pixels[known.found].T.round().astype(int).clip(0, [[639], [479]])
    here = np.full(len(u), True) if lost is None else ~lost[v, u]
    xd, yd = ((known.pixels[known.found][here] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
    dist, ideal = camera.coefficients, known.ideal[known.found][here]
    allowed = 1e-9 * (1 + np.abs(ideal).max()) / determinant(*ideal.T, dist).clip(LEAST_DETERMINANT, 1).min()
    lens = mi.load_dict(lens_at(camera, np.zeros(3)))
    of_twin = (part.numpy() for part in lens.undistort(Float64(xd), Float64(yd)))
    for x, y in (undistort(xd, yd, dist, newton_steps(camera)), undistort(xd, yd, dist), of_twin):
        np.testing.assert_allclose(np.stack([x, y], axis=1), ideal, rtol=0, atol=allowed)
