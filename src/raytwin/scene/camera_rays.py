"""The ray of every pixel, for renderers of one's own and for NumPy."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from raytwin.array_types import Float
from raytwin.errors import InputError, check_one_of
from raytwin.scene.camera import Camera
from raytwin.scene.lens import check_lens, has_no_ray, newton


class CameraRays(NamedTuple):
    """`origin` (3,): the eye, metres. `directions` (..., 3): unit, away from the eye. Both float64."""

    origin: Float[np.ndarray, "3"]
    directions: Float[np.ndarray, "... 3"]


def camera_rays(
    camera: Camera, pixels: ArrayLike | None = None, *, frame: Literal["board", "camera"] = "board"
) -> CameraRays:
    """Return the camera's eye and the direction through each pixel's centre, (H, W, 3), lens distortion undone.

    `pixels` (..., 2) asks for other places (u, v): (0, 0) is the centre of the top-left pixel, as in OpenCV. `frame`:
    the "board" frame of scenes, or the "camera" frame (x right, y down, z forward), whose origin is the eye.
    d = R_cam_boardᵀ (x, y, 1) / |(x, y, 1)|, where (x, y) is what k1, k2, p1, p2, k3 distort to ((u - cx) / fx,
    (v - cy) / fy). A place where the lens folds back has no ray: NaN. Raises InputError for a lens that cannot be
    undone over most of the frame.

    >>> camera = Camera((640, 480), ((800, 0, 319.5), (0, 800, 239.5), (0, 0, 1)), ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    ...                 (0, 0, 0.45))
    >>> rays = camera_rays(camera)
    >>> rays.directions.shape, rays.origin.tolist()
    ((480, 640, 3), [0.0, 0.0, 0.45])
    >>> camera_rays(camera, (319.5, 239.5)).directions.tolist()
    [0.0, 0.0, -1.0]
    """
    check_one_of("frame", frame, ("board", "camera"))
    if pixels is None:
        u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    else:
        at = np.asarray(pixels, float)
        if not at.ndim or at.shape[-1] != 2:
            raise InputError("pixels", "places (u, v): an array (..., 2)", at.shape)
        u, v = at[..., 0], at[..., 1]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    if any(camera.coefficients):
        check_lens(camera)
        x, y = newton(x, y, camera.coefficients)
    d = np.stack([x, y, np.ones_like(x)], axis=-1)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    d[has_no_ray(camera, u, v)] = np.nan
    if frame == "camera":
        return CameraRays(np.zeros(3), d)
    R, t = np.asarray(camera.R_cam_board, float), np.asarray(camera.t_cam_board, float)
    return CameraRays(-R.T @ t + 0.0, d @ R + 0.0)  # + 0.0: no -0
