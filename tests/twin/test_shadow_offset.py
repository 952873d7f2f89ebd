"""Shadow rays start off the surface: far enough that nothing shades itself, wherever the camera stands."""

import numpy as np

from raytwin import twin
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sun


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
        scene = Scene("table", camera, (table,), (sun, Sky((0.1, 0.1, 0.1))))
        plain = twin.render(scene, "lambert", cache=False)
        assert np.array_equal(twin.render(scene, "shadow", cache=False).mean, plain.mean)
