"""A photo of a board with a mirror ball or an upright beside it -> the light that it was taken in."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.images.photo_files import photo_size
from raytwin.photos import boards
from raytwin.photos.augment import augment, printed
from raytwin.photos.boards.board import draw_board
from raytwin.photos.camera import detect_photo, pose_of_tags, with_shape
from raytwin.photos.lighting.light_models import Light, light_of, simplest
from raytwin.photos.lighting.linear_photo import LinearPhoto, read_linear
from raytwin.photos.lighting.mirror_map import MirrorBall, find_mirror
from raytwin.photos.lighting.stand_shadow import Shadow, find_shadow
from raytwin.photos.synthetic_photos import sheet_of
from raytwin.scene import Camera, Scene, Sphere, Sun
from raytwin.scene.scene import NO_SUN
from raytwin.scene.scene_files import read_camera

MAX_POSE_PX = 3.0
"""Largest root mean square distance, in pixels of a photo 2000 wide, between tags and where the camera sees them."""

BallNumbers = tuple[float, float, float, float]
StandNumbers = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class LightEstimate:
    """All that `photo light` found; its page and its text are views of it. `ball` and `stand` as the user gave them.

    `off_by_constant`: how far a matt sphere's shading under a constant sky is off that under the map. `light` is None
    where the photo was refused; `refusal` says why.
    """

    photo: LinearPhoto
    board: boards.Board
    ball: BallNumbers | None = None
    stand: StandNumbers | None = None
    by: Shadow | MirrorBall | None = None
    light: Light | None = None
    off_by_constant: float = 0.0
    warnings: list[str] = field(default_factory=list)
    drawn: np.ndarray | None = None
    refusal: str = ""

    @property
    def mirror(self) -> MirrorBall | None:
        return self.by if isinstance(self.by, MirrorBall) else None

    def numbers(self) -> dict[str, Any]:
        """Return what the JSON holds."""
        light, mirror = self.light, self.mirror
        assert light is not None
        sun = {"to_light": light.to_light, "sigma_degrees": np.degrees(light.sigma)}
        return {
            "sun": None if light.to_light is None else sun,
            "irradiance": light.E, "irradiance_sigma": light.E_sd, "radiance": light.Ls, "radiance_sigma": light.Ls_sd,
            "map_rows": 0 if light.around is None else len(light.around), "paper": self.photo.paper_colour,
            "taken": light.name, "constant_sky_off": self.off_by_constant if mirror else None,
            "balls": [{"kind": "mirror", **vars(mirror.ball), "reflectance": mirror.reflectance}] if mirror else [],
            "warnings": self.warnings,
        }  # fmt: skip


class LightRefused(InputError):
    """The photo does not show its light; `found` has what a page shows of it."""

    found: LightEstimate


def estimate_light(
    photo: Path, board: str | Path, camera: str | Path, *, ball: BallNumbers | None = None,
    stand: StandNumbers | None = None,
) -> LightEstimate:  # fmt: skip
    """Return the sun and the sky in which the photo was taken, relative to the board's white paper.

    `ball`: center and radius of a mirror ball, metres, roughly; `stand`: x, y of an upright's foot, and its height.
    Raises InputError where this is no photo of the board by the camera, LightRefused where it does not show its light.
    """
    definition = with_shape(boards.read_board(board), camera)
    linear = read_linear(photo, _placed(photo, read_camera(camera), definition), definition)
    start = LightEstimate(linear, definition, ball, stand, warnings=[*linear.warnings])
    try:
        return _estimated(start)
    except InputError as error:
        refused = LightRefused(*error.fields)
        refused.found = replace(start, refusal=str(error))
        raise refused from None


def _estimated(start: LightEstimate) -> LightEstimate:
    photo, board, said = start.photo, start.board, list(start.warnings)
    by: Shadow | MirrorBall
    if start.ball is not None:
        by = find_mirror(photo, board, np.array(start.ball[:3]), start.ball[3])
        if start.stand is not None:
            said.append("--stand was not used, because a mirror ball shows more of the light")
    elif start.stand is not None:
        by = find_shadow(photo, board, start.stand)
    else:
        wanted = "--ball x,y,z,r (a mirror ball) or --stand x,y,h (an upright), in metres or as 60mm"
        raise InputError("light", wanted, "neither")
    light, off = simplest(light_of(photo.paper_colour, by))
    found = replace(start, by=by, light=light, off_by_constant=off, warnings=said)
    return replace(found, drawn=_drawn(found, light))


def _drawn(found: LightEstimate, light: Light) -> np.ndarray:
    """Draw a matt grey ball into the photo, on the middle of the board, as wide as the mirror ball, or three tags."""
    photo, mirror, centers = found.photo, found.mirror, np.array(list(found.board.centers().values()))
    x, y = ((centers.min(axis=0) + centers.max(axis=0)) / 2).tolist()
    radius = mirror.ball.radius if mirror else 1.5 * found.board.tag_edge
    ball, sheet = Sphere((x, y, radius), radius, (0.5, 0.5, 0.5)), sheet_of(draw_board(found.board, 100.0)[1])
    sun = Sun(tuple(light.to_light.tolist()), tuple(light.E.tolist())) if light.to_light is not None else NO_SUN
    scene = printed(Scene("light", photo.camera, (ball,), (sheet,), sun, light.sky), found.board)
    return augment(photo.pixels, scene, exposure=photo.value_of_one(found.photo.paper_colour)).pixels


def _placed(path: Path, lens: Camera, definition: boards.Board) -> Camera:
    """Return the camera at the pose from which it took the photo."""
    size = photo_size(path)
    if size != lens.image_size:
        raise InputError(path, f"{lens.width} x {lens.height} pixels, as the camera's", f"{size[0]} x {size[1]}")
    tags = detect_photo(path, definition.family)
    pose = pose_of_tags(lens.K, lens.dist, tags, definition, path.name)
    if pose.rms_px > MAX_POSE_PX * max(1.0, lens.width / 2000):
        raise InputError(path, "a photo by the camera of --camera", f"tags {pose.rms_px:.1f} px off where it sees them")
    return msgspec.structs.replace(lens, R_cam_board=pose.R_cam_board, t_cam_board=pose.t_cam_board)
