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
from raytwin.photos.lighting import light_models as models
from raytwin.photos.lighting.linear_photo import LinearPhoto, read_linear
from raytwin.photos.lighting.mirror_ball import find_ball, sun_spot
from raytwin.photos.lighting.mirror_map import mirrored_maps
from raytwin.photos.lighting.stand_shadow import LOWEST_SUN_DEGREES, WIDEST_UPRIGHT, find_shadow
from raytwin.photos.synthetic_photos import sheet_of
from raytwin.scene import Camera, Scene, Sphere, Sun
from raytwin.scene.scene import NO_SUN
from raytwin.scene.scene_files import read_camera

POSE_PX = 3.0
"""A pose that leaves its tags this far off, as a root mean square, is that of another camera."""

CONTRADICTING_SIGMAS = 4.0
"""Directions to the sun that differ by so many of their joint standard deviations contradict each other."""

BallNumbers = tuple[float, float, float, float]
StandNumbers = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class LightEstimate:
    """All that `photo light` found; its page and its text are views of it. `ball` and `stand` as the user gave them.

    `light` is None where the photo was refused; `refusal` says why.
    """

    photo: LinearPhoto
    board: boards.Board
    evidence: models.Evidence
    ball: BallNumbers | None = None
    stand: StandNumbers | None = None
    light: models.Light | None = None
    trials: list[models.Trial] = field(default_factory=list)
    taken: int = 0
    warnings: list[str] = field(default_factory=list)
    drawn: np.ndarray | None = None
    refusal: str = ""

    def numbers(self) -> dict[str, Any]:
        """What the JSON holds."""
        light, mirror = self.light, self.evidence.mirror
        assert light is not None
        sun = {"to_light": light.to_light, "sigma_degrees": np.degrees(light.sigma)}
        return {
            "sun": None if light.to_light is None else sun,
            "irradiance": light.E, "irradiance_sigma": light.E_sd, "radiance": light.Ls, "radiance_sigma": light.Ls_sd,
            "map_rows": 0 if light.around is None else len(light.around), "paper": self.evidence.paper,
            "models": [msgspec.to_builtins(t) for t in self.trials], "taken": self.trials[self.taken].name,
            "suns": [{"from": n, "to_light": d, "sigma_degrees": np.degrees(sd)} for n, d, sd in self.evidence.suns],
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
    """Sun and sky in which the photo was taken, relative to the board's white paper.

    `ball`: center and radius of a mirror ball, metres, roughly; `stand`: x, y of an upright's foot, and its height.
    Raises InputError where this is no photo of the board by the camera, LightRefused where it does not show its light.
    """
    definition = with_shape(boards.read_board(board), camera)
    linear, said = read_linear(photo, _placed(photo, read_camera(camera), definition), definition)
    start = LightEstimate(linear, definition, models.Evidence(linear.paper_colour), ball, stand, warnings=said)
    try:
        return _estimated(start)
    except InputError as error:
        refused = LightRefused(*error.fields)
        refused.found = replace(start, refusal=str(error))
        raise refused from None


def _estimated(start: LightEstimate) -> LightEstimate:
    photo, said, shadow, mirror = start.photo, list(start.warnings), None, None
    if start.stand is not None:
        shadow = find_shadow(photo, start.board, start.stand)
        if shadow is None:
            said.append(f"--stand: no shadow of it on the sheet: no sun, or one below {LOWEST_SUN_DEGREES:g} degrees")
        elif shadow.width > WIDEST_UPRIGHT * start.stand[2]:
            said.append(f"--stand: not used: wider than {WIDEST_UPRIGHT:g} of its height, as no pin or pen is")
            shadow = None
    if start.ball is not None:
        ball, reflectance = find_ball(photo, start.board, np.array(start.ball[:3]), start.ball[3])
        spot = sun_spot(photo, ball)
        mirror = models.MirrorBall(ball, reflectance, spot, *mirrored_maps(photo, ball, reflectance, spot))
    if not (shadow or mirror):
        wanted = "--ball x,y,z,r (a mirror ball) or --stand x,y,h (an upright), in metres or as 60mm"
        raise InputError("light", wanted, said[-1] if start.stand else "neither")
    evidence = replace(start.evidence, shadow=shadow, mirror=mirror)
    if shadow and mirror and mirror.spot:
        apart = float(np.arccos(np.clip(shadow.to_light @ mirror.spot.to_light, -1, 1)))
        if apart > CONTRADICTING_SIGMAS * np.hypot(shadow.sigma, mirror.spot.sigma):
            where = f"stand and mirror ball put the sun {np.degrees(apart):.1f} degrees apart"
            said.append(f"{where}: one of them is not as told")
    light, trials, number = models.simplest_light(evidence)
    found = replace(start, evidence=evidence, light=light, trials=trials, taken=number, warnings=said)
    return replace(found, drawn=_drawn(found, light))


def middle_of(board: boards.Board) -> tuple[float, float]:
    """The middle of the board's tags."""
    xy = np.array(list(board.centers().values()))
    x, y = (xy.min(axis=0) + xy.max(axis=0)) / 2
    return float(x), float(y)


def _drawn(found: LightEstimate, light: models.Light) -> np.ndarray:
    """The photo with a matt grey ball on the middle of the board, as wide as the mirror ball, or three tags."""
    photo, (x, y), mirror = found.photo, middle_of(found.board), found.evidence.mirror
    radius = mirror.ball.radius if mirror else 1.5 * found.board.tag_edge
    ball, sheet = Sphere((x, y, radius), radius, (0.5, 0.5, 0.5)), sheet_of(draw_board(found.board, 100.0)[1])
    sun = Sun(tuple(light.to_light.tolist()), tuple(light.E.tolist())) if light.to_light is not None else NO_SUN
    scene = printed(Scene("light", photo.camera, (ball,), (sheet,), sun, light.sky), found.board)
    return augment(photo.pixels, scene, exposure=photo.value_of_one(found.evidence.paper)).pixels


def _placed(path: Path, lens: Camera, definition: boards.Board) -> Camera:
    """The camera where it took the photo."""
    size = photo_size(path)
    if size != lens.image_size:
        raise InputError(path, f"{lens.width} x {lens.height} pixels, as the camera's", f"{size[0]} x {size[1]}")
    tags = detect_photo(path, definition.family)
    pose = pose_of_tags(lens.K, lens.dist, tags, definition, path.name)
    if pose.rms_px > POSE_PX * max(1.0, lens.width / 2000):
        raise InputError(path, "a photo by the camera of --camera", f"tags {pose.rms_px:.1f} px off where it sees them")
    return msgspec.structs.replace(lens, R_cam_board=pose.R_cam_board, t_cam_board=pose.t_cam_board)
