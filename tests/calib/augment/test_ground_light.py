"""The ground's light on drawn spheres: against closed forms, and against rays that are followed to the ground."""

from functools import partial

import numpy as np
import pytest
from scene_of import scene_of

from raytwin import files
from raytwin.calib.augment import augment
from raytwin.lights import sphere_share
from raytwin.scene import Camera, Environment, Lambert, Sky, Sphere, Sun

SIZE, FOCAL, HEIGHT = (161, 121), 120.0, 0.5
CAMERA = Camera(
    SIZE,
    ((FOCAL, 0.0, 80.0), (0.0, FOCAL, 60.0), (0.0, 0.0, 1.0)),
    ((1.0, 0.0, 0.0), (0.0, -0.6, -0.8), (0.0, 0.8, -0.6)),
    (0.0, 0.0, HEIGHT),
)
"""Looks down by 37 degrees: the lower half of a ball is seen."""
BALL = Sphere((0.0, 0.0, 0.05), 0.05, Lambert((0.5, 0.5, 0.5)))
SKY, DARK = (0.3, 0.35, 0.4), Sun((0.0, 0.6, 0.8), (0.0, 0.0, 0.0))
GROUND = 180
"""The floor's code in all of the photo."""

as_photo = partial(np.full, (SIZE[1], SIZE[0], 3), dtype=np.uint8)


def drawn(sky, *, sun=DARK, ball=BALL, shadows=False) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) linear values and (m, 3) normals of the pixels that the ball covers."""
    scene = scene_of("ball", CAMERA, (ball,), (sun, sky))
    result = augment(as_photo(GROUND), scene, shadows=shadows, subsamples=1, ground=True)
    v, u = np.nonzero(result.coverage)
    R, eye = np.array(CAMERA.R_cam_board), np.array(CAMERA.eye)
    d = np.stack([(u - 80) / FOCAL, (v - 60) / FOCAL, np.ones(len(u))], axis=1) @ R
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    f = eye - ball.center
    b = d @ f
    t = -b - np.sqrt(b * b - f @ f + ball.radius**2)
    return files.from_bytes(result.pixels[v, u]), (f + t[:, None] * d) / ball.radius


def steps(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """How far apart, in steps of 8 bits."""
    return np.abs(files.to_bytes(found).astype(int) - files.to_bytes(wanted.astype(np.float32)))


@pytest.mark.parametrize("kind", ["constant", "map", "turned map"])
def test_over_an_even_floor_each_side_gets_its_share_of_sky_and_ground(kind):
    """ρ (Ls (1 + n.z)/2 + Lg (1 - n.z)/2): closed form. A map's lower half counts for nothing."""
    sky = Sky(SKY)
    if kind != "constant":
        texels = np.full((8, 16, 3), SKY, "<f4")
        turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        below = slice(4, None)
        if kind == "turned map":  # its y axis points up: what is below lies behind the map's edges
            turn, below = (
                ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
                (slice(None), [*range(4), *range(12, 16)]),
            )
        texels[below] *= 1.5
        sky = Environment((16, 8), texels.tobytes(), turn)
    found, n = drawn(sky)
    floor = files.from_bytes(as_photo(GROUND))[0, 0]
    up = (1 + n[:, 2:]) / 2
    assert np.ptp(n[:, 2]) > 1.2
    assert steps(found, 0.5 * (np.array(SKY) * up + floor * (1 - up))).max() <= (1 if kind == "constant" else 3)


def test_a_ball_on_the_floor_sees_its_own_shadow_there():
    """Rays from the ball to a floor in a constant sky and a sun: both are taken from it as the ball hides them."""
    sun = Sun((0.6, 0.0, 0.8), (2.0, 2.0, 2.0))
    found, n = drawn(Sky(SKY), sun=sun, shadows=True)
    rng = np.random.default_rng(1)
    own = np.arange(0, len(n), 12)
    floor, to_sun, c = files.from_bytes(as_photo(GROUND))[0, 0], np.array(sun.to_light), np.array(BALL.center)
    of_sun = 2.0 * to_sun[2] / (2.0 * to_sun[2] + np.pi * np.array(SKY))
    wanted = []
    for normal in n[own]:
        d = rng.normal(size=(20000, 3))
        d = normal + d / np.linalg.norm(d, axis=1, keepdims=True)  # cosine-weighted about the normal
        d = d[d[:, 2] < 0] / np.linalg.norm(d[d[:, 2] < 0], axis=1, keepdims=True)
        start = c + BALL.radius * normal
        at = start - d * (start[2] / d[:, 2:])
        to = c - at
        far = np.linalg.norm(to, axis=1)
        left = 1 - sphere_share(far / BALL.radius, to[:, 2] / far)
        lit = np.linalg.norm(np.cross(to, to_sun), axis=1) > BALL.radius
        seen = floor * (of_sun * lit[:, None] + (1 - of_sun) * left[:, None])
        up = (1 + normal[2]) / 2
        wanted.append(0.5 * (np.array(SKY) * up + seen.sum(axis=0) / 20000 + 2 / np.pi * max(normal @ to_sun, 0)))
    away = steps(found[own], np.array(wanted))
    assert len(own) > 30
    assert away.max() <= 4
    assert np.sqrt((away**2).mean()) < 1.5


def test_without_any_ground_in_the_photo_the_sky_stays_all_around():
    """A small ball high up, seen along a level axis: the ground about it lies below the frame."""
    level = Camera(SIZE, CAMERA.K, ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)), (0.0, HEIGHT, 0.2))
    scene = scene_of("level", level, (Sphere((0.0, 0.1, HEIGHT), 0.005),), (DARK, Sky(SKY)))
    plain, asked = (augment(as_photo(GROUND), scene, ground=g).pixels for g in (False, True))
    assert (plain != GROUND).any()
    assert np.array_equal(plain, asked)
