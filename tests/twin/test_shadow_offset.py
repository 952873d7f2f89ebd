"""Shadow rays start off the surface: far enough that nothing shades itself, wherever the camera stands."""

import numpy as np
from scene_of import scene_of

from raytwin import twin
from raytwin.scene import Camera, Lambert, Rectangle, Sky, Sun
from raytwin.tracer import trace


def test_a_large_table_does_not_shade_itself():
    """Thirty random cameras near a table of 3 m: with and without shadows the images are the same to the last bit."""
    twin.activate()
    rng = np.random.default_rng(5)
    table = Rectangle((0.076, 0.114, -0.002), (1.5, 0.0, 0.0), (0.0, 1.5, 0.0), Lambert((0.36, 0.25, 0.17)))
    K = ((150.0, 0.0, 100.0), (0.0, 150.0, 75.0), (0.0, 0.0, 1.0))
    for _ in range(30):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        R = q * np.sign(np.diag(r))
        R = R if np.linalg.det(R) > 0 else -R
        if R[2, 2] > 0:  # look down
            R = np.diag([1.0, -1.0, -1.0]) @ R
        eye = np.array([*rng.uniform(-0.3, 0.5, 2), rng.uniform(0.05, 0.6)])
        camera = Camera((200, 150), K, tuple(map(tuple, R.tolist())), tuple((-R @ eye).tolist()))
        sun = Sun((*rng.normal(0, 0.5, 2), 1.0))
        scene = scene_of("table", camera, (table,), (sun, Sky((0.1, 0.1, 0.1))))
        plain = twin.render(scene, "lambert", cache=False)
        assert np.array_equal(twin.render(scene, "shadow", cache=False).mean, plain.mean)


def test_no_sun_comes_through_a_gap_of_a_hundredth_of_a_millimetre_between_a_floor_and_a_sheet():
    """Seen from within. Mitsuba's own rays start 9e-5 m off, beyond the sheet, so that all of the gap is lit."""
    gap, side = 1e-5, 48
    grey, looking = Lambert((0.5, 0.5, 0.5)), ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    floor, sheet = (Rectangle((0.0, 0.0, z), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), grey) for z in (0.0, gap))
    f, c = side / 0.6, (side - 1) / 2
    eye = (0.0, 0.0, gap / 2)
    camera = Camera((side, side), ((f, 0.0, c), (0.0, f, c), (0.0, 0.0, 1.0)), looking, (0.0, eye[2], 0.0))
    scene = scene_of("gap", camera, (floor, sheet), (Sun((0.3, 0.4, 0.8)),))
    twin.activate()
    for image in (twin.render(scene, "shadow", cache=False), trace(scene, "shadow")):
        on_floor = image.surface.ids == 0
        assert on_floor.sum() > 0.3 * side * side
        assert (image.mean[on_floor] == 0).all()
