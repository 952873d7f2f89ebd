"""What the lessons stand on: the desk's photos and its scene, in plain NumPy."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from raytwin import twin
from raytwin.explain.textbook import tracer_with
from raytwin.images.image import Image
from raytwin.images.photo_files import list_photos, read_photo
from raytwin.renderers.scene_exchange import as_arrays
from raytwin.scene.scene_files import scene_and_photos
from raytwin.scene_folders import find_scene

PHOTOS = 8
"""Photos of the desk: enough for a camera, and quickly searched."""


class Hits(NamedTuple):
    """What each of N rays meets first: `t` (N,), inf for nothing; `points`, `normals` to the eye, `albedo`: (N, 3)."""

    t: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        return np.isfinite(self.t)


class Desk:
    """A board of tags on a table, photographed, and two spheres that are not there.

    After `calibrated`: `K`, `dist`, `width`, `height`, `R`, `t` of the camera. The rest is in the board's frame, m:
    `centers` (M, 3) and `radii` (M,) of the spheres; `to_light` (3,) unit, `irradiance` and `sky` (3,).
    """

    def __init__(self, width: int = 160, scene: str = "desk") -> None:
        from raytwin.photos import boards  # with OpenCV, which writing the walk needs not
        from raytwin.photos.camera import detect_photos

        self.scene, asked = scene_and_photos(scene)
        assert asked is not None  # the desk's camera is to be found
        folder = find_scene(scene).parent
        self.board = boards.read_board(folder / asked.board)
        taken = list_photos(folder / asked.photos)[:PHOTOS]
        self.photo_name = asked.photo if asked.photo in [p.name for p in taken] else taken[0].name
        self.photo = read_photo(folder / asked.photos / self.photo_name)
        self._found, _ = detect_photos(taken, self.board.family)
        self._name = str(folder / asked.photos / self.photo_name)
        self._width = width

    @property
    def corners(self) -> np.ndarray:
        """(N, 4, 2): the tags' corners in the photo, as the AprilTag library counts pixels."""
        return np.array([tag.corners for tag in self._found[self._name]]) + 0.5

    def homographies(self, tag_centers: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """(views, 3, 3): board to pixels, from the centres that the function finds."""
        import cv2

        known, made = self.board.centers(), []
        for tags in self._found.values():
            used = [tag for tag in tags if tag.id in known]
            centers = tag_centers(np.array([tag.corners for tag in used]) + 0.5)
            H, _ = cv2.findHomography(np.array([known[tag.id] for tag in used]), np.asarray(centers, float))
            made.append(H)
        return np.array(made)

    def calibrated(self) -> "Desk":
        """Itself, with the camera that raytwin finds: K and the distortion by least squares, and the photo's pose."""
        from raytwin.photos.camera import calibrate_detections, camera_at, pose_of_tags

        sizes = self.photo.shape[1], self.photo.shape[0]
        found = calibrate_detections(self._found, sizes, self.board)
        pose = pose_of_tags(found.K, found.dist, self._found[self._name], found.shaped(self.board))
        camera = camera_at(found, pose)
        self.full_K = np.array(found.K)
        camera = camera.resized(self._width, round(self._width * sizes[1] / sizes[0]))
        self.scene = self.scene.with_camera(camera)
        self.width, self.height = camera.image_size
        given = as_arrays(self.scene)
        self.K, self.dist, self.R, self.t = (given[key] for key in ("K", "dist", "R_cam_board", "t_cam_board"))
        self.eye = -self.R.T @ self.t
        self.to_light, self.irradiance = given["sun"]["to_light"], given["sun"]["irradiance"]
        self.sky = given["sky"]["radiance"]
        spheres, self.things = given["spheres"], [*given["spheres"], *given["planes"]]
        self.centers, self.radii = (np.array([sphere[key] for sphere in spheres]) for key in ("center", "radius"))
        return self

    def first_hits(self, origins: np.ndarray, directions: np.ndarray, intersect_sphere: Callable[..., Any]) -> Hits:
        """What the rays (N, 3) meet first: the spheres by the given function, the sheet and the table by raytwin's."""
        o = np.broadcast_to(origins, directions.shape)
        tracer = tracer_with({"intersect_sphere": intersect_sphere})
        with np.errstate(all="ignore"):
            every_t = tracer.intersect_all(o, directions, self.things)
        which, t = every_t.argmin(axis=0), every_t.min(axis=0)
        points = o + np.where(np.isfinite(t), t, 0)[:, None] * directions
        albedo = np.array([thing["albedo"] for thing in self.things])
        return Hits(t, points, tracer.normals_at(points, which, o, self.things), albedo[which])

    def picture(self, values: np.ndarray, hits: Hits | None = None) -> np.ndarray:
        """(N, 3) as an image (H, W, 3); the sky where the rays met nothing."""
        if hits is not None:
            values = np.where(hits.seen[:, None], values, self.sky)
        return np.asarray(values, np.float32).reshape(self.height, self.width, 3)

    def twin(self, rung: str, samples: int = 64, depth: int | None = None) -> Image:
        """The same by Mitsuba."""
        return twin.render(
            self.scene, rung, sampling="center", samples=samples, max_depth=depth if rung == "path" else None
        )


def around(normals: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Directions (N, 3) about (0, 0, 1), turned to be about the unit normals (N, 3)."""
    side = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    u = np.cross(side, normals)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    return np.asarray(local[:, :1] * u + local[:, 1:2] * v + local[:, 2:] * normals)
