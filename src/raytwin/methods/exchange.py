"""A scene as other people's code takes it: one dict of plain values and float64 arrays, everything resolved."""

from typing import Any

import numpy as np

from raytwin.scene import Record, Scene


def as_arrays(scene: Scene, rung: str = "shadow") -> dict[str, Any]:
    """What a `render(scene)` of one's own is called with; vectors (3,), matrices (3, 3), `dist` (5,) are float64.

    Keys: name, width, height, K, dist (k1, k2, p1, p2, k3), R_cam_board, t_cam_board, spheres [{center, radius,
    albedo}], planes [{center, half_u, half_v, albedo}], sun {to_light (unit), irradiance}, sky {radiance}, rung.
    """
    camera = scene.camera
    return {
        "name": scene.name,
        "width": camera.width,
        "height": camera.height,
        "dist": np.array(camera.coefficients, float),
        **_arrays(camera, "K", "R_cam_board", "t_cam_board"),
        "spheres": [
            _arrays(s, "center") | {"radius": float(s.radius)} | _arrays(s.material, "albedo") for s in scene.spheres
        ],
        "planes": [_arrays(r, "center", "half_u", "half_v") | _arrays(r.material, "albedo") for r in scene.rectangles],
        "sun": _arrays(scene.sun, "to_light", "irradiance"),
        "sky": _arrays(scene.sky, "radiance"),
        "rung": rung,
    }


def _arrays(record: Record, *names: str) -> dict[str, Any]:
    return {name: np.array(getattr(record, name), float) for name in names}
