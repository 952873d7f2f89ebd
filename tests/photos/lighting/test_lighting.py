"""Light from a mirror ball and a pin: each on pictures that closed forms made, no renderer.

The shipped photos (test_estimate_light.py), which Mitsuba rendered, are the independent check of left and right, up and
down, and of a shadow's length and darkness.
"""

import numpy as np
import pytest
from photo_helpers import BOARD, PlainRenderer, a_camera

from raytwin.errors import InputError
from raytwin.images.photo_files import list_photos, to_bytes
from raytwin.photos.boards.board import PAPER
from raytwin.photos.lighting import light_models, mirror_ball, mirror_map, stand_shadow
from raytwin.photos.lighting.light_models import light_of
from raytwin.photos.lighting.linear_photo import LinearPhoto, read_linear
from raytwin.photos.synthetic_photos import photograph
from raytwin.scene import Camera, Environment
from raytwin.tracer.lights.environment_map import environment_map
from raytwin.tracer.lights.envmap_tables import texel_directions

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
    return mirror_ball.Ball(CENTER, RADIUS, np.full(4, 1e-4))


def picture(light: np.ndarray, camera: Camera = CAMERA) -> LinearPhoto:
    pixels = to_bytes(np.clip(light, 0, 1).astype(np.float32))
    clipped, flat = (light >= 1).any(axis=-1), np.ones(light.shape[:2], np.float32)
    return LinearPhoto("p", camera, light.astype(np.float32), clipped, pixels, np.ones(3), flat)


def of_ball(shade) -> LinearPhoto:
    """A photo of the ball on grey: `shade(points, normals, reflected)` is what its pixels show."""
    photo = picture(np.full((300, 400, 3), 0.25))
    uv = np.stack(np.meshgrid(np.arange(400), np.arange(300)), axis=-1).reshape(-1, 2)
    p, out, cosine = mirror_ball.reflect(photo, ball_of(), photo.rays(uv))
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
        *_, cosine = mirror_ball.reflect(photo, ball_of(), photo.rays(middle + scale * (rim - middle)))
        assert (np.isfinite(cosine) == hit).all()


def test_a_ball_that_cannot_be_seen_is_refused_with_the_reason(subtests):
    photo = picture(np.zeros((300, 400, 3)))
    for (*center, radius), expected in (
        ((0.02, -0.01, -0.05, 0.03), "printed side of the board"),
        ((0.17, -0.01, 0.03, 0.03), "one that the frame cuts"),
        ((0.02, -0.01, 0.004, 0.004), "at least 24 pixels wide, got 1[0-9] pixels"),
        ((0.12, -0.35, 0.54, 0.03), "in front of the camera"),
    ):
        with subtests.test(expected), pytest.raises(InputError, match=expected):
            mirror_ball.find_ball(photo, BOARD, np.array(center), radius)


@pytest.mark.nightly
def test_no_ball_a_matt_one_and_one_that_touches_the_frame_are_refused_in_words(subtests):
    """Edges are looked for beside the outline, and beyond the frame there are no pixels."""
    black = picture(np.zeros((300, 400, 3)))
    rim = mirror_ball.outline(black, ball_of())
    x, y = np.floor(rim.min(axis=0)).astype(int)
    w, h = (np.ceil(rim.max(axis=0)).astype(int) + 2 - (x, y)).tolist()
    noise = np.random.default_rng(0).uniform(0.2, 0.6, (h, w, 3))
    for name, photo, expected in (
        ("nothing", black, "a ball whose outline is seen there, got edges along 0 % of it"),
        (
            "orange",
            of_ball(lambda n, _: 0.2 + 0.3 * np.maximum(n @ SUN, 0)[:, None] * [1, 0.5, 0.1]),
            "shows the board",
        ),
        ("cut", picture(noise, CAMERA.grid(x, y, 1, (w, h))), "shows the board|a grey mirror ball"),
    ):
        with subtests.test(name), pytest.raises(InputError, match=expected):
            mirror_ball.find_ball(photo, BOARD, CENTER, RADIUS)


def test_a_mirrored_map_is_found_the_right_way_round_and_weighs_by_solid_angle():
    around, reflectance = a_map(), np.array([0.9, 0.8, 0.7])
    light = environment_map(around)
    photo = of_ball(lambda _, out: np.stack(light.radiance(tuple(out.T)), axis=1) * reflectance)
    found, lamps = mirror_map.mirrored_maps(photo, ball_of(), reflectance, None)
    assert not lamps.any()
    d = texel_directions(16, 32).reshape(-1, 3)
    shown = d @ (CENTER - CAMERA.eye) / np.linalg.norm(CENTER - CAMERA.eye) < 0.8  # the ball hides what is behind it
    off = found.reshape(-1, 3) - np.stack(light.radiance(tuple(d.T)), axis=1)
    assert np.abs(off[shown]).max() < 0.03
    assert light_models.upward(found) == pytest.approx(light.diffuse_irradiance((0.0, 0.0, 1.0)), rel=0.02)


def test_what_a_map_gives_a_surface_is_the_closed_form_of_a_gradient():
    """Radiance a + b z gives level paper a + 2 b / 3 over π, and a wall half of a plus 2 b / (3 π)."""
    z = texel_directions(64, 128)[..., 2:]
    found = light_models.received(0.5 + 0.3 * z + np.zeros(3), np.array([(0.0, 0.0, 1.0), (0.6, 0.8, 0.0)]))
    assert found[:, 0] == pytest.approx([0.5 + 0.2, 0.25 + 0.2 / np.pi], rel=2e-3)


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
        assert mirror_map.mirrored_maps(photo, ball_of(), np.ones(3), spot)[1].any() != is_sun
        assert not spot or np.degrees(np.arccos(spot.to_light @ SUN)) < 0.35


def test_a_bright_patch_in_the_box_about_a_ball_but_beside_it_is_no_sun():
    photo = of_ball(lambda n, out: np.full((len(n), 3), 0.1))
    box = mirror_ball.pixels_about(photo, ball_of())
    for (u, v), is_sun in (
        (box[0, 0], False), (box[0, -3], False), (box[-3, 0], False), (box[-3, -3], False),
        (box[len(box) // 3, len(box[0]) // 2], True),
    ):  # fmt: skip
        light = photo.light.copy()
        light[v : v + 3, u : u + 3] = 5
        assert (mirror_ball.sun_spot(picture(light), ball_of()) is not None) == is_sun, (u, v)


def test_a_long_clipped_patch_is_a_lamp_that_makes_up_the_papers_light():
    """A strip of 50 degrees, of which the photo tells the shape alone: paper asks for twelve times what is clipped."""
    strip = np.array([0.5, 0.6, 0.6]) / np.linalg.norm([0.5, 0.6, 0.6])
    along = np.cross(strip, (0, 0, 1.0))
    along /= np.linalg.norm(along)

    def shade(_, out):
        near = (np.abs(out @ np.cross(strip, along)) < 0.12) & (np.abs(out @ along) < 0.42) & (out @ strip > 0)
        return np.where(near, 1.5, 0.1)[:, None] + np.zeros(3)

    photo, paper = of_ball(shade), np.full(3, 0.9)
    spot = mirror_ball.sun_spot(photo, ball_of())
    assert spot is None
    maps = mirror_map.mirrored_maps(photo, ball_of(), np.ones(3), None)
    light = light_of(paper, mirror_map.MirrorBall(ball_of(), np.ones(3), spot, *maps))
    assert light.to_light is None
    assert light_models.simplest(light)[0] is light
    assert light_models.upward(light.around) == pytest.approx(paper / PAPER, rel=1e-3)
    bright = light.around[..., 0] * (light.around[..., 0] > 0.3 * light.around.max())
    lamp = np.einsum(
        "ij,ijk->k", bright * np.sin((np.arange(16)[:, None] + 0.5) * np.pi / 16), texel_directions(16, 32)
    )
    assert np.degrees(np.arccos(lamp @ strip / np.linalg.norm(lamp))) < 6


def test_a_sun_that_is_no_stronger_than_its_uncertainty_is_not_taken():
    for share, taken in ((0.95, "constant sky"), (0.4, "sun + constant sky")):
        light = light_of(np.ones(3), stand_shadow.Shadow(np.full(3, share), SUN, 0.01))
        assert light.name == taken
        assert light.Ls == pytest.approx(np.full(3, 1 if light.to_light is None else share) / PAPER)
        assert light.E * SUN[2] / np.pi + light.Ls == pytest.approx(np.ones(3) / PAPER)


def test_no_shadow_is_found_on_a_bare_sheet(shoot):
    folder, truth = shoot()
    name, (R, t) = next(iter(truth.photos.items()))
    photo = read_linear(folder / name, Camera(truth.image_size, truth.K, R, t, truth.dist), BOARD)
    for foot, expected in ((0.095, "no shadow of it on the sheet"), (0.9, "white paper around it")):
        with pytest.raises(InputError, match=expected):
            stand_shadow.find_shadow(photo, BOARD, (foot, foot, 0.03))


def test_clipped_paper_is_a_warning_in_words(tmp_path):
    for light, clipped in ((0.8, False), (1.6, True)):
        truth = photograph(BOARD, a_camera(), 1, tmp_path, PlainRenderer(light=light), seed=3)
        R, t = truth.photos["photo_00.jpg"]
        photo = read_linear(list_photos(tmp_path)[0], Camera(truth.image_size, truth.K, R, t, truth.dist), BOARD)
        assert ["clipped" in said for said in photo.warnings] == [True] * clipped
