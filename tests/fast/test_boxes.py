"""Trim boxes: never a visible pixel outside, and not much else inside."""

import math

import msgspec
import numpy as np
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scene_of import cameras, reals, vectors

from raytwin.fast import trim_boxes
from raytwin.fast.boxes import EMPTY, _tangents, corner_box, field_of_view
from raytwin.fast.frame import touching
from raytwin.scene import Camera, Rectangle, Shape, Sphere
from raytwin.tracer import back_project, intersect_rectangle, intersect_sphere
from raytwin.tracer.pixel_to_ray import to_board


def trim_box(thing: Shape, camera: Camera) -> tuple[int, ...]:
    return tuple(trim_boxes([thing], camera)[0].tolist())


def hits(thing: Shape, camera: Camera) -> np.ndarray:
    """(H, W) bool: every pixel's ray is tried."""
    u, v = np.arange(camera.width)[None, :], np.arange(camera.height)[:, None]
    with np.errstate(all="ignore"):
        d = to_board(back_project(u, v, camera), camera)
        meet = intersect_sphere if isinstance(thing, Sphere) else intersect_rectangle
        return np.broadcast_to(meet(camera.eye, d, thing) < np.inf, (camera.height, camera.width))


def assert_nothing_is_cut(thing: Shape, camera: Camera) -> None:
    x0, y0, x1, y1 = trim_box(thing, camera)
    assert (0 <= x0 < x1 <= camera.width and 0 <= y0 < y1 <= camera.height) or (x0, y0, x1, y1) == EMPTY
    outside = hits(thing, camera).copy()
    outside[y0:y1, x0:x1] = False
    assert not outside.any(), f"cut: {np.argwhere(outside)[:5].tolist()} beyond {(x0, y0, x1, y1)}"


@settings(max_examples=120, deadline=None)
@given(cameras(distorted=False) | cameras(distorted=True), vectors(-1.5, 1.5), reals(0.01, 1), st.booleans())
def test_a_spheres_box_holds_every_hit(camera, place, radius, ahead):
    """About the eye: before it, across the camera's plane, behind it, round it; or before the lens."""
    if ahead:
        x, y, z = place
        place = np.asarray(camera.R_cam_board).T @ np.array([0.4 * x, 0.4 * y, 1]) * (abs(z) + 0.02)
    assert_nothing_is_cut(Sphere(tuple((np.asarray(camera.eye) + place).tolist()), radius), camera)


@settings(max_examples=100, deadline=None)
@given(
    cameras(distorted=False) | cameras(distorted=True),
    vectors(-1.5, 1.5),
    vectors(-1, 1),
    vectors(-1, 1),
    reals(0.05, 2),
)
def test_a_rectangles_box_holds_every_hit(camera, place, u, v, length):
    u, v = np.asarray(u), np.asarray(v)
    v = v - u * (u @ v) / max(u @ u, 1e-300)
    assume(np.linalg.norm(u) > 1e-3 and np.linalg.norm(v) > 1e-3)
    # An eye in the rectangle's own plane, to rounding: what it sees of it is a matter of the last digit.
    assume(abs(np.cross(u, v) @ place) > 1e-12)
    center = tuple((np.asarray(camera.eye) + place).tolist())
    assert_nothing_is_cut(Rectangle(center, tuple(u.tolist()), tuple((v * length).tolist())), camera)


@settings(max_examples=50, deadline=None)
@given(cameras(distorted=False), reals(0.3, 0.7), reals(0.3, 0.7), reals(0.1, 0.8))
def test_a_pinholes_box_is_tight(camera, right, down, share):
    # The sphere stands in the frame, reaching a share of the way to its sides: its outline is an ellipse, here found on
    # a grid twice as fine.
    K, (w, h) = np.asarray(camera.K), camera.image_size
    x, y = (right * w - K[0, 2]) / K[0, 0], (down * h - K[1, 2]) / K[1, 1]
    aside = 0.3 * min(w / K[0, 0], h / K[1, 1])
    ahead = np.asarray(camera.R_cam_board).T @ np.array([x, y, 1.0])
    sphere = Sphere(tuple((np.asarray(camera.eye) + ahead).tolist()), share * aside / math.hypot(1, aside))
    seen = hits(sphere, camera.resized(2 * camera.width, 2 * camera.height))
    assume(seen.any() and not (seen[0].any() or seen[-1].any() or seen[:, 0].any() or seen[:, -1].any()))
    rows, columns = ((np.flatnonzero(seen.any(axis=i)) + 0.5) / 2 - 0.5 for i in (1, 0))
    x0, y0, x1, y1 = trim_box(sphere, camera)
    assert columns[0] - x0 < 2
    assert (x1 - 1) - columns[-1] < 2
    assert rows[0] - y0 < 2
    assert (y1 - 1) - rows[-1] < 2


@settings(max_examples=300, deadline=None)
@given(reals(-3, 3), reals(-3, 3), reals(0.01, 2))
@example(0.0, -1.0, 0.999)
@example(0.0, -1.0, 1.001)
@example(-1.0, -0.1, 0.5)
def test_the_tangents_bound_the_slopes_of_all_rays_that_meet_the_circle(a, z, r):
    assume(abs(math.hypot(a, z) - r) > 1e-3)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 20_001)[1:-1]
    off = np.abs(np.sin(angle) * z - np.cos(angle) * a)
    met = (off < r) & ((np.sin(angle) * a + np.cos(angle) * z > 0) | (math.hypot(a, z) < r))
    low, high = (math.atan(float(s)) for s in _tangents(*(np.array(c) for c in (a, z, r))))
    step = np.pi / 20_000 * 1.01
    if not met.any():
        assert high - low < step
        return
    assert low <= angle[met][0] <= low + step
    assert high - step <= angle[met][-1] <= high


def test_what_lies_behind_has_no_box_and_what_is_round_the_eye_or_past_a_fold_the_whole_frame(single):
    camera, (x, y, z) = single.camera, single.camera.eye
    whole, behind = (0, 0, *camera.image_size), (x, y, z + 1)
    folding = msgspec.structs.replace(camera, dist=(-2.5,))
    assert field_of_view(folding) is None
    for thing, seen_by, box in (
        (Sphere(behind, 0.5), camera, EMPTY),
        (Rectangle(behind, (9.0, 0.0, 0.0), (0.0, 9.0, 0.0)), camera, EMPTY),
        (Sphere(camera.eye, 0.1), camera, whole),
        (single.spheres[0], folding, whole),
    ):
        assert trim_box(thing, seen_by) == box, thing


def test_the_papers_box_is_that_of_the_projected_corners_and_the_frame_where_one_has_no_pixel(single):
    """Of a sheet its own four; of a sphere its cube's eight."""
    camera = single.camera
    sheet = Rectangle((0.02, -0.01, 0.03), (0.03, 0.01, 0.02), (-0.01, 0.03, 0.0))
    for thing in (sheet, single.spheres[0]):
        half = (sheet.half_u, sheet.half_v) if thing is sheet else thing.radius * np.eye(3)
        turns = np.array(np.meshgrid(*[(-1, 1)] * len(half))).reshape(len(half), -1).T
        at = (np.array(thing.center) + turns @ np.array(half)) @ np.array(camera.R_cam_board).T + camera.t_cam_board
        u, v = (at[:, :2] / at[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)).T
        x0, y0, x1, y1 = corner_box(thing, camera)
        assert (x0, y0) == (max(np.floor(u.min()), 0), max(np.floor(v.min()), 0))
        assert (x1, y1) == (min(np.ceil(u.max()) + 1, 640), min(np.ceil(v.max()) + 1, 480))
    through = msgspec.structs.replace(sheet, center=camera.eye, half_u=(0.0, 0.0, 1.0))
    at_eye = msgspec.structs.replace(through, half_u=(1e-3, 0.0, 0.0), half_v=(0.0, 1e-3, 0.0))
    assert corner_box(at_eye, camera) == (0, 0, 640, 480)


def test_a_tile_lists_the_objects_whose_boxes_share_a_pixel_with_it_in_their_order(rng):
    boxes = np.sort(rng.integers(0, 60, (300, 2, 2)), axis=1).reshape(300, 4)
    boxes[(boxes[:, :2] >= boxes[:, 2:]).any(axis=1)] = EMPTY
    for box in (np.array(b) for b in ((10, 20, 30, 40), (0, 0, 1, 1), (59, 0, 60, 60))):
        inside = np.zeros((60, 60), bool)
        inside[box[1] : box[3], box[0] : box[2]] = True
        shared = [i for i, (x0, y0, x1, y1) in enumerate(boxes) if inside[y0:y1, x0:x1].any()]
        assert touching(boxes, box).tolist() == shared
