"""Spheres drawn into photos: coverage against areas, shadow ratios against closed forms, and nothing else touched."""

import msgspec
import numpy as np
import pytest
from photo_helpers import BOARD
from scene_of import changed, scene_of

from raytwin.images.photo_files import from_bytes
from raytwin.photos.augment import augment, objects, printed
from raytwin.photos.boards.board import draw_board, tag_cells
from raytwin.photos.synthetic_photos import sheet_of
from raytwin.scene import Camera, Rectangle, Scene, Sky, Sphere, Sun

CAMERA = Camera(
    (320, 240),
    ((400.0, 0.0, 159.5), (0.0, 400.0, 119.5), (0.0, 0.0, 1.0)),
    ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    (0.0, 0.0, 0.5),
)
FLOOR = Rectangle((0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0), in_photo=True)


def stage(to_light=(1.0, 0.0, 1.0), sun=2.0, sky=0.2, center=(-0.03, 0.0, 0.05), radius=0.02) -> Scene:
    return scene_of("stage", CAMERA, (Sphere(center, radius), FLOOR), (Sun(to_light, (sun,) * 3), Sky((sky,) * 3)))


def grey(value: int = 180) -> np.ndarray:
    return np.full((240, 320, 3), value, np.uint8)


def test_coverage_adds_up_to_the_silhouettes_area():
    """A sphere head on: a disc of radius f r / √(d² - r²), whose area the partly covered pixels complete."""
    d, r = 0.45, 0.05
    result = augment(grey(), stage(center=(0.0, 0.0, 0.05), radius=r), subsamples=9, shadows=False)
    area = np.pi * (400 * r) ** 2 / (d * d - r * r)
    assert result.coverage.sum() == pytest.approx(area, rel=3e-4)
    assert ((result.coverage > 0) & (result.coverage < 1)).sum() > 100


def test_the_shadows_core_gets_the_skys_share_of_the_light():
    """In the sun's shadow the ratio is π Ls (1 - F) over all the light, with F the closed form of a black sphere's."""
    scene = stage()
    black = msgspec.structs.replace(scene.spheres[0], albedo=(0.0, 0.0, 0.0))
    result = augment(grey(), scene.with_(objects=(black, FLOOR)))
    # Along the sun's direction (1, 0, 1) from the centre (-0.03, 0, 0.05) the floor is met at x = -0.08.
    point = np.array([-0.08, 0.0, 0.0])
    u, v = round(400 * point[0] / 0.5 + 159.5), round(119.5)
    to = np.array(scene.spheres[0].center) - point
    hidden = (0.02 / np.linalg.norm(to)) ** 2 * to[2] / np.linalg.norm(to)
    sun, sky = 2.0 / np.sqrt(2), np.pi * 0.2
    found = result.ratio[v - 3 : v + 4, u - 3 : u + 4].mean()  # over seven pixels, in which the paths' noise drops out
    assert found == pytest.approx(sky * (1 - hidden) / (sun + sky), rel=8e-3)


def test_a_matt_ball_on_a_matt_floor_gets_the_floors_light_from_below():
    """ρ (Ls (1 + n.z)/2 + Lf (1 - n.z)/2) where the floor, far below, sends Lf = ρf Ls: closed form of one bounce."""
    ball, floor = (
        Sphere((0.0, 0.0, 0.0), 0.02, (0.5,) * 3),
        Rectangle((0.0, 0.0, -2.0), (400.0, 0.0, 0.0), (0.0, 400.0, 0.0), (0.6, 0.3, 0.1), in_photo=True),
    )
    level = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))  # seen from the side
    camera = msgspec.structs.replace(CAMERA, R_cam_board=level, t_cam_board=(0.0, 0.0, 0.1))
    result = augment(grey(), scene_of("ball", camera, (ball, floor), (Sky((0.5,) * 3),)), shadows=False)
    for dv in (-60, 0, 60):  # pixels up and down from the ball's middle
        v, u = 119 + dv, 159
        x, y = np.array([u - 159.5, v - 119.5]) / 400
        d = np.array([x, 1.0, -y]) / np.linalg.norm([x, 1.0, -y])
        eye = np.array([0.0, -0.1, 0.0])
        t = -d @ eye - np.sqrt((d @ eye) ** 2 - eye @ eye + 0.02**2)
        up = (1 + (eye + t * d)[2] / 0.02) / 2
        expected = 0.5 * (0.5 * up + 0.5 * np.array([0.6, 0.3, 0.1]) * (1 - up))
        near = from_bytes(result.pixels[v - 3 : v + 4, u - 3 : u + 4]).mean(axis=(0, 1))
        assert near == pytest.approx(expected, abs=0.02)  # four standard deviations of some 500 paths: 6e-5 a number


def test_a_print_darkens_the_board_that_it_lies_on_and_no_table():
    """Paper and ink, weighed by their areas, which the tags' cells give."""
    sheet = sheet_of(draw_board(BOARD, 500.0)[1])
    table = Rectangle((0.0, 0.0, -0.002), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), in_photo=True)
    ball = Sphere((0.0, 0.0, 0.1), 0.05)
    made = printed(scene_of("board", CAMERA, (ball, sheet, table)), BOARD)
    cells = np.concatenate([tag_cells(BOARD.family, tag).ravel() for tag in BOARD.centers()])
    black = (1 - cells.mean()) * BOARD.tag_edge**2 * len(BOARD.centers())
    share = black / (4 * np.linalg.norm(sheet.half_u) * np.linalg.norm(sheet.half_v))
    expected = sheet.albedo[0] * (1 - share * (1 - 0.04 / 0.85))
    assert made.objects[1].albedo == pytest.approx((expected,) * 3, rel=0.01)
    assert made.objects[::2] == (ball, table)


@pytest.mark.nightly
@pytest.mark.parametrize("to_light", [(1.0, 0.0, 1.0), (-0.4, -1.0, 0.15), (1.0, 0.0, 0.0005)])
def test_what_is_left_out_of_the_work_would_not_have_changed(to_light, monkeypatch):
    """Within noise with every pixel worked on: the squares hold the shadow wherever the sun stands."""
    scene = stage(to_light, center=(0.1, 0.02, 0.03))
    trimmed = augment(grey(), scene)
    same = (trimmed.coverage == 0) & (trimmed.ratio == 1).all(axis=-1)
    assert same.any()
    assert (trimmed.pixels[same] == 180).all()
    monkeypatch.setattr(objects, "_touched", lambda scene, shadows: (0, 0, 320, 240))
    whole = augment(grey(), scene)
    assert (np.abs(trimmed.pixels.astype(int) - whole.pixels)[same] > 2).mean() < 1e-3
    assert (whole.ratio[..., 0] < 0.9).sum() > 50


@pytest.mark.parametrize(("slope", "squares"), [(-0.5, 1), (0.0, 1), (0.0009, 2), (0.5, 2)])
def test_a_sun_above_the_plane_adds_the_square_about_its_shadow(slope, squares):
    scene = stage((float(np.sqrt(1 - slope**2)), 0.0, slope))
    made = objects._reach(Sphere((0.1, 0.02, 0.03), 0.02), FLOOR, scene)
    assert len(made) == squares
    assert made[0].center == pytest.approx((0.1, 0.02, 0.0))
    if slope == 0.5:
        assert made[1].center == pytest.approx((0.1 - 0.03 * 3**0.5, 0.02, 0.0))
        assert made[1].half_u == pytest.approx((0.04, 0.0, 0.0), rel=2e-3)


def test_far_from_all_objects_nothing_is_noisy():
    """Both renders follow the same rays: where none meets an object, the ratio is 1."""
    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    result = augment(noise, stage(center=(0.1, 0.05, 0.02), radius=0.01))
    changed = (result.pixels != noise).any(axis=-1)
    assert 300 < changed.sum() < 0.1 * changed.size


@pytest.mark.nightly
def test_a_sphere_in_a_photographed_walls_shade_takes_no_sun_a_second_time():
    """Where the wall shades the floor in the photo already, the sphere hides some of the sky and nothing else."""
    wall = Rectangle((0.1, 0.0, 0.1), (0.0, 0.5, 0.0), (0.0, 0.0, 0.1), in_photo=True)
    scene = stage(center=(0.03, 0.0, 0.03), radius=0.02)
    shaded = augment(grey(), changed(scene, objects=(*scene.objects, wall)))
    alone = augment(grey(), scene)
    core = (alone.ratio[..., 0] < 0.4) & (alone.coverage == 0)
    assert core.sum() > 100
    in_shade = shaded.ratio[..., 0][core & (shaded.coverage == 0)]
    assert np.median(in_shade) > 0.5
    assert in_shade.max() <= 1
