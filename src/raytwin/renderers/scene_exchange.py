"""A scene as other people's code takes it: one dict of plain values and float64 arrays, everything resolved."""

from typing import Any

import numpy as np

from raytwin.scene import Camera, MitsubaScene, Record, Rectangle, Scene, Sky, Sphere, Sun


def as_arrays(scene: Scene, rung: str = "shadow") -> dict[str, Any]:
    """What a `render(scene)` of one's own is called with; vectors (3,), matrices (3, 3), `dist` (5,) are float64.

    Keys: name, width, height, K, dist (k1, k2, p1, p2, k3), R_cam_board, t_cam_board, spheres [{center, radius,
    albedo}], planes [{center, half_u, half_v, albedo}], sun {to_light (unit), irradiance}, sky {radiance}, rung.
    Raises InputError where the scene has more than that.
    """
    scene.check_lambertian("a renderer of one's own")
    camera = scene.camera
    return {
        "name": scene.name,
        "width": camera.width,
        "height": camera.height,
        "dist": np.array(camera.coefficients, float),
        **_arrays(camera, "K", "R_cam_board", "t_cam_board"),
        "spheres": [_arrays(s, "center") | {"radius": float(s.radius)} | _arrays(s, "albedo") for s in scene.spheres],
        "planes": [_arrays(r, "center", "half_u", "half_v", "albedo") for r in scene.planes],
        "sun": _arrays(scene.sun, "to_light", "irradiance"),
        "sky": {"radiance": np.array(scene.sky_radiance, float)},
        "rung": rung,
    }


def as_file(scene: MitsubaScene) -> dict[str, Any]:
    """What a renderer is called with for a Mitsuba file: name, width, height, and the file to read (`mitsuba`)."""
    width, height = scene.image_size
    return {"name": scene.name, "width": width, "height": height, "mitsuba": scene.file}


def _arrays(record: Record, *names: str) -> dict[str, Any]:
    return {name: np.array(getattr(record, name), float) for name in names}


def as_scene(record: dict[str, Any]) -> Scene:
    """Return the scene that `as_arrays` describes."""

    def plain(value: np.ndarray) -> Any:
        return tuple(plain(row) if row.ndim else float(row) for row in value)

    camera = Camera(
        (record["width"], record["height"]), *(plain(record[k]) for k in ("K", "R_cam_board", "t_cam_board", "dist"))
    )
    spheres = (Sphere(plain(s["center"]), s["radius"], plain(s["albedo"])) for s in record["spheres"])
    planes = (Rectangle(*(plain(p[k]) for k in ("center", "half_u", "half_v", "albedo"))) for p in record["planes"])
    sun = Sun(plain(record["sun"]["to_light"]), plain(record["sun"]["irradiance"]))
    return Scene(record["name"], camera, (*spheres,), (*planes,), sun, Sky(plain(record["sky"]["radiance"])))


def as_json(scene: dict[str, Any]) -> dict[str, Any]:
    """`as_arrays` for programs of other languages: lists, matrices by rows, and what a look-at camera asks for.

    `camera`: `eye` -Rᵀ t; `forward`, `right`, `up`: unit, the camera's z, x, -y in the board's frame; `look_at`: the
    point 1 m ahead; `fov_x`, `fov_y`: degrees, of the whole frame, correct where the principal point is in its middle.
    """
    K, R, t = scene["K"], scene["R_cam_board"], scene["t_cam_board"]
    eye = -R.T @ t
    fov_x, fov_y = (
        float(np.degrees(2 * np.arctan(side / (2 * f))))
        for side, f in ((scene["width"], K[0, 0]), (scene["height"], K[1, 1]))
    )
    axes = {"eye": eye, "forward": R[2], "right": R[0], "up": -R[1], "look_at": eye + R[2]}
    return scene | {"camera": axes | {"fov_x": fov_x, "fov_y": fov_y}}
