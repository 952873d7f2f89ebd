"""Light from a mirror ball and a pin: each on pictures that closed forms made, no renderer.

Mitsuba's mirror (test_light_photos.py) and the shipped photos (test_estimate_light.py) are the independent check of
left and right, up and down.
"""

import numpy as np
import pytest
from photo_helpers import BOARD, PlainRenderer, a_camera

from raytwin.errors import InputError
from raytwin.images.photo_files import list_photos, to_bytes, write_picture
from raytwin.photos.boards.board import PAPER, draw_board
from raytwin.photos.lighting import board_plane, light_models, mirror_ball, mirror_map, stand_shadow
from raytwin.photos.lighting.linear_photo import LinearPhoto, read_linear
from raytwin.photos.synthetic_photos import expose, photograph, read_truth, sheet_of
from raytwin.scene import Camera, Environment
from raytwin.tracer.lights.environment_map import environment_map

SUN = np.array([0.5, -0.3, 0.8]) / np.linalg.norm([0.5, -0.3, 0.8])
CENTER, RADIUS = np.array([0.02, -0.01, 0.03]), 0.03
CAMERA = Camera(
    (400, 300),
    ((500.0, 0.0, 200.0), (0.0, 505.0, 148.0), (0.0, 0.0, 1.0)),
    ((0.96, 0.28, 0.0), (0.224, -0.768, -0.6), (-0.168, 0.576, -0.8)),
    (-0.02, 0.03, 0.35),
    (0.05, -0.1),
)


def ball_of() -> mirror_ball.Ball:
    return mirror_ball.Ball(CENTER, RADIUS, 1e-8 * np.eye(4))


def picture(light: np.ndarray, camera: Camera = CAMERA) -> LinearPhoto:
    pixels = to_bytes(np.clip(light, 0, 1).astype(np.float32))
    clipped, flat = (light >= 1).any(axis=-1), np.ones(light.shape[:2], np.float32)
    return LinearPhoto("p", camera, light.astype(np.float32), clipped, pixels, np.ones(3), flat)


def of_ball(shade) -> LinearPhoto:
    """A photo of the ball on grey: `shade(points, normals, reflected)` is what its pixels show."""
    photo = picture(np.full((300, 400, 3), 0.25))
    u, v = np.meshgrid(np.arange(400), np.arange(300))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    p, out, cosine = mirror_ball.reflect(photo, ball_of(), uv)
    hit = np.isfinite(cosine)
    light = photo.light.copy()
    light[uv[hit, 1], uv[hit, 0]] = shade((p[hit] - CENTER) / RADIUS, out[hit])
    return picture(light)


def a_map(rows: int = 8) -> Environment:
    """Smooth, and different in every direction."""
    v, u = np.mgrid[:rows, : 2 * rows] + 0.5
    theta, turn = v * np.pi / rows, (u / rows - 1) * np.pi
    x, y, z = np.sin(theta) * np.sin(turn), np.sin(theta) * np.cos(turn), np.cos(theta)
    texels = np.stack([0.4 + 0.3 * x, 0.4 + 0.3 * y, 0.4 + 0.2 * z + 0.1 * x * y], axis=-1)
    return Environment((2 * rows, rows), texels.astype("<f4").tobytes())


def test_the_outline_is_where_the_rays_begin_to_miss():
    photo = picture(np.zeros((300, 400, 3)))
    rim = mirror_ball.outline(photo, ball_of())
    middle = rim.mean(axis=0)
    for scale, hit in ((0.995, True), (1.005, False)):
        *_, cosine = mirror_ball.reflect(photo, ball_of(), middle + scale * (rim - middle))
        assert (np.isfinite(cosine) == hit).all()


@pytest.mark.parametrize(
    ("center", "radius", "expected"),
    [
        ((0.02, -0.01, -0.05), 0.03, "printed side of the board"),
        ((0.17, -0.01, 0.03), 0.03, "one that the frame cuts"),
        ((0.02, -0.01, 0.004), 0.004, "at least 24 pixels wide, got 1[0-9] pixels"),
        ((0.12, -0.35, 0.54), 0.03, "in front of the camera"),
    ],
)
def test_a_ball_that_cannot_be_measured_is_refused_with_the_reason(center, radius, expected):
    views = mirror_ball.views_of([picture(np.zeros((300, 400, 3)))], BOARD)
    with pytest.raises(InputError, match=expected):
        mirror_ball.find_ball(views, mirror_ball.given_ball(np.array(center), radius))


def test_a_ball_whose_outline_touches_the_frame_is_fitted_or_refused_and_breaks_nothing():
    """Edges are looked for two pixels to either side of the outline, and beyond the frame there are no pixels."""
    whole = picture(np.random.default_rng(0).uniform(0.2, 0.6, (300, 400, 3)))
    rim = mirror_ball.outline(whole, ball_of())
    x, y = np.floor(rim.min(axis=0)).astype(int)
    size = tuple((np.ceil(rim.max(axis=0)).astype(int) + 2 - (x, y)).tolist())
    cut = picture(np.ones((size[1], size[0], 3)) * 0.4, CAMERA.grid(x, y, 1, size))
    mirror_ball.check_seen(cut, ball_of())
    given = mirror_ball.given_ball(CENTER, RADIUS)
    found = mirror_ball._refined(mirror_ball.views_of([cut], BOARD), given, given)
    assert np.isfinite(found.numbers).all()
    assert np.isfinite(found.sigma).all()


def test_a_mirrored_map_is_found_the_right_way_round_and_weighs_by_solid_angle():
    around, reflectance = a_map(), np.array([0.9, 0.8, 0.7])
    light = environment_map(around)
    photo = of_ball(lambda _, out: np.stack(light.radiance(tuple(out.T)), axis=1) * reflectance)
    seen = mirror_map.mirrored([photo], ball_of(), reflectance, [None])
    found = mirror_map.fit_map([seen], 8)[0]
    d = seen.to_light[::7]
    shown = mirror_map.bilinear(d, 8) @ found.reshape(-1, 3)
    assert np.abs(shown - np.stack(light.radiance(tuple(d.T)), axis=1)).max() < 0.01
    assert light_models.upward(found) == pytest.approx(light.diffuse_irradiance((0.0, 0.0, 1.0)), rel=0.02)
    # All that a ball shows within grazing angles: a little less than the whole sphere.
    assert 0.75 * 4 * np.pi < seen.steradians.sum() < 4 * np.pi


def test_a_small_clipped_light_is_the_sun_a_large_one_is_not_and_a_lamp_beside_it_draws_it_nowhere():
    lamp = SUN + np.array((0.12, 0.05, -0.05))
    lamp /= np.linalg.norm(lamp)
    for degrees, brightest, is_sun in ((4, 0.3, True), (4, 0.6, True), (25, 0.3, False), (0, 1.5, False)):

        def shade(_, out, a=degrees, top=brightest):
            glow = 0.2 + top * np.exp(20 * (out @ lamp - 1))
            return np.where(out @ SUN > np.cos(np.radians(a)), 1.5, glow)[:, None] + np.zeros(3)

        photo = of_ball(shade)
        spot = mirror_ball.sun_spot(photo, ball_of())
        assert (spot is not None) == is_sun
        assert mirror_map.mirrored([photo], ball_of(), np.ones(3), [spot]).sun.any() == is_sun
        if spot:
            found = mirror_ball.reflect(photo, ball_of(), spot[0][None])[1][0]
            assert np.degrees(np.arccos(found @ SUN)) < 0.35


def test_a_sun_that_is_no_stronger_than_its_uncertainty_is_not_taken():
    """A streak on the sheet, 5 % darker than noisy paper, is no evidence of one; a dark one is."""
    cover, here = np.tile(np.linspace(0, 1, 100), 2), np.zeros(2)
    noise = np.random.default_rng(1).normal(0, 0.1, (200, 1))
    for strength, taken in ((0.05, "constant sky"), (0.6, "sun + constant sky")):
        value = (1 - strength * cover)[:, None] * np.ones(3) + noise
        shadow = stand_shadow.Shadow(value, cover, SUN, 0.01, 1.0, here, here, 0.03, 0.001)
        light, trials, number = light_models.simplest_light(light_models.Evidence(np.ones(3), shadow))
        assert trials[number].name == taken
        assert light.E.any() == (strength > 0.1)
        if light.E.any():
            assert light.Ls == pytest.approx(np.full(3, 0.4 / PAPER), rel=0.1)


@pytest.mark.nightly
@pytest.mark.parametrize("width", [0.0015, 0.012])
def test_a_pins_shadow_tells_the_sun_and_its_share_of_the_light_and_a_blocks_is_known_by_its_width(tmp_path, width):
    """The shadow is painted on the sheet: a strip from the foot to where the sun's ray through the top meets it."""
    foot, height, dark = np.array([0.095, 0.095]), 0.03, 0.35
    camera = a_camera()
    sheet, (x0, x1, y0, y1) = draw_board(BOARD, 4000.0)
    h, w = sheet.shape
    x, y = np.meshgrid(x0 + (np.arange(w) + 0.5) * (x1 - x0) / w, y1 - (np.arange(h) + 0.5) * (y1 - y0) / h)
    tip = -SUN[:2] / SUN[2] * height
    t = np.clip(((x - foot[0]) * tip[0] + (y - foot[1]) * tip[1]) / (tip @ tip), 0, 1)
    near = np.hypot(x - foot[0] - t * tip[0], y - foot[1] - t * tip[1]) < width / 2
    plain = PlainRenderer()
    folder = tmp_path / "photos"

    def render(c, texture, s):
        """The sheet, its shadow, and what the upright hides: the strip from the foot to where the eye sees its top."""
        eye = np.array(c.eye)
        to = (foot - eye[:2]) * height / (eye[2] - height)
        t = np.clip(((x - foot[0]) * to[0] + (y - foot[1]) * to[1]) / (to @ to), 0, 1)
        body = np.hypot(x - foot[0] - t * to[0], y - foot[1] - t * to[1]) < width / 2
        return plain(c, np.where(body, 0.3, np.where(near, dark, 1) * sheet), s)

    photograph(BOARD, camera, 1, folder, render, seed=3)
    truth = read_truth(folder / "truth.toml")
    views = [Camera(truth.image_size, truth.K, R, t, truth.dist) for R, t in truth.photos.values()]
    photos, paper, warnings = read_linear(list_photos(folder), views, BOARD)
    assert warnings == []
    assert paper == pytest.approx(np.ones(3), abs=0.01)
    found = stand_shadow.find_shadow(photos, board_plane.Sheet(BOARD), (*(foot + 5e-4), 1.01 * height))
    assert found is not None
    assert (found.width < stand_shadow.WIDEST_UPRIGHT * found.height) == (width < 0.002)
    if width > 0.002:
        return
    # A streak that ink cuts short: the shadow goes on beyond the pixels that are looked at first.
    cut = stand_shadow.find_shadow(photos, board_plane.Sheet(BOARD), (*foot, height), tuple(0.4 * tip))
    for shadow in (found, cut):
        assert np.degrees(np.arccos(shadow.to_light @ SUN)) < 0.7
    assert found.levels[0] == pytest.approx(np.full(3, dark), abs=0.04)


def test_an_upright_that_is_not_there_is_said(shoot):
    folder, truth = shoot()
    name, (R, t) = next(iter(truth.photos.items()))
    view = Camera(truth.image_size, truth.K, R, t, truth.dist)
    photos, *_ = read_linear([folder / name], [view], BOARD)
    with pytest.raises(InputError, match="does not stand upright, or not there"):
        stand_shadow.find_shadow(photos, board_plane.Sheet(BOARD), (0.095, 0.095, 0.03))


def test_clipped_and_tone_mapped_paper_is_a_warning_in_words(tmp_path):
    camera = a_camera()
    plain = PlainRenderer(light=1.6)
    photograph(BOARD, camera, 1, tmp_path, plain, seed=3)
    truth = read_truth(tmp_path / "truth.toml")
    views = [Camera(truth.image_size, truth.K, R, t, truth.dist) for R, t in truth.photos.values()]
    path = list_photos(tmp_path)[0]
    assert any("clipped" in w for w in read_linear([path], views, BOARD)[2])
    plain = PlainRenderer(light=0.8)
    albedo, extent = draw_board(BOARD, 2000.0)
    image = expose(plain(views[0], albedo, sheet_of(extent)), np.random.default_rng(0), views[0])
    for gamma, told in ((1.0, False), (0.6, True)):
        write_picture(path, (255 * (image / 255.0) ** gamma).astype(np.uint8), quality=95)
        assert any("tone-mapped" in w for w in read_linear([path], views, BOARD)[2]) == told


@pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_bright_patch_in_the_box_about_a_ball_but_beside_it_is_no_sun(corner):
    """Its ray misses the ball, so that the sun had no direction; at the box's end its slices ran past the window."""
    photo = of_ball(lambda n, out: np.full((len(n), 3), 0.1))
    uv = mirror_ball.pixels_about(photo, ball_of())
    (u, v) = np.where(corner, uv.max(axis=0) - 2, uv.min(axis=0))
    light = photo.light.copy()
    light[v : v + 3, u : u + 3] = 5
    assert mirror_ball.sun_spot(picture(light), ball_of()) is None
    rim = mirror_ball.outline(photo, ball_of())
    u, v = (rim.mean(axis=0) + np.array([0, -0.2]) * np.ptp(rim, axis=0)).astype(int)
    light[v : v + 3, u : u + 3] = 5
    assert mirror_ball.sun_spot(picture(light), ball_of()) is not None


def test_a_long_clipped_patch_is_a_lamp_that_makes_up_the_papers_light():
    """A strip of 50 degrees, of which the photo tells the shape alone: paper asks for twelve times what is clipped."""
    strip = np.array([0.5, 0.6, 0.6]) / np.linalg.norm([0.5, 0.6, 0.6])
    along = np.cross(strip, (0, 0, 1.0))
    along /= np.linalg.norm(along)

    def shade(_, out):
        near = (np.abs(out @ np.cross(strip, along)) < 0.12) & (np.abs(out @ along) < 0.42) & (out @ strip > 0)
        return np.where(near, 1.5, 0.1)[:, None] + np.zeros(3)

    photo = of_ball(shade)
    assert mirror_ball.sun_spot(photo, ball_of()) is None
    seen, paper = mirror_map.mirrored([photo], ball_of(), np.ones(3), [None]), np.full(3, 0.9)
    mirror = light_models.MirrorBall(ball_of(), seen, np.ones(3), [None], None)
    light, trials, taken = light_models.simplest_light(light_models.Evidence(paper, None, [mirror]))
    assert light.to_light is None
    assert trials[taken].rows > 0
    assert light_models.upward(light.around) == pytest.approx(paper / PAPER, rel=1e-3)
    assert light.around.min() >= 0
    directions, power = light_models._upper(light.around)
    bright = np.where(
        light.around.max() * 0.3 < light_models._repeated(light.around, 16).reshape(-1, 3)[: len(power)], power, 0
    )
    lamp = bright[:, 0] @ directions
    assert np.degrees(np.arccos(lamp @ strip / np.linalg.norm(lamp))) < 6


@pytest.mark.parametrize(
    ("shade", "expected"),
    [
        (lambda n, out: 0.2 + 0.3 * np.maximum(n @ SUN, 0)[:, None] * np.array([1, 0.5, 0.1]), "shows the board"),
        (lambda n, out: np.full((len(n), 3), 0.4), "shows the board"),
    ],
)
def test_a_matt_ball_is_no_mirror(shade, expected):
    with pytest.raises(InputError, match=expected):
        mirror_ball.check_mirror(mirror_ball.views_of([of_ball(shade)], BOARD), np.ones(3), ball_of(), ball_of())


@pytest.mark.parametrize("turn", range(1, 9))
def test_the_page_turns_a_photo_as_exif_says(turn):
    """Against Pillow's own."""
    from PIL import Image, ImageOps

    from raytwin.show.light_page import _turned

    pixels = np.random.default_rng(turn).integers(0, 255, (3, 4, 3), np.uint8)
    picture = Image.fromarray(pixels)
    picture.getexif()[0x0112] = turn
    assert (np.asarray(ImageOps.exif_transpose(picture)) == _turned(pixels, turn)).all()
