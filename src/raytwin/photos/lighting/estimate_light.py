"""Photos of a board with a mirror ball or an upright beside it -> the light that they were taken in."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin.errors import InputError
from raytwin.images.photo_files import photo_size
from raytwin.photos import boards
from raytwin.photos.augment import augment, printed
from raytwin.photos.boards.board import PAPER, draw_board
from raytwin.photos.camera import detect_photo, pose_of_tags, read_board_shapes, with_shape
from raytwin.photos.lighting import light_models as models
from raytwin.photos.lighting.board_plane import Sheet
from raytwin.photos.lighting.linear_photo import LinearPhoto, read_linear, value_of_one
from raytwin.photos.lighting.mirror_ball import Ball, check_mirror, find_ball, given_ball, sun_of, sun_spot, views_of
from raytwin.photos.lighting.mirror_map import mirrored
from raytwin.photos.lighting.stand_shadow import LOWEST_SUN_DEGREES, WIDEST_UPRIGHT, find_shadow
from raytwin.progress import Progress, silent
from raytwin.scene import Camera, Rectangle, Scene, Sphere, Sun
from raytwin.scene.scene import NO_SUN
from raytwin.scene.scene_files import read_camera

POSE_PX = 3.0
"""A pose that leaves its tags this far off, as a root mean square, is that of another camera."""

CONTRADICTING_SIGMAS = 4.0
"""Directions to the sun that differ by so many of their joint standard deviations contradict each other."""


@dataclass(frozen=True, eq=False)
class LightEstimate:
    """All that `photo light` found; its page and its text are views of it. `given`: the balls as the user gave them.

    `light` is None where the photos were refused; `refusal` says why.
    """

    photos: list[LinearPhoto]
    board: boards.Board
    evidence: models.Evidence
    given: list[Ball] = field(default_factory=list)
    stand: tuple[float, float, float] | None = None
    light: models.Light | None = None
    trials: list[models.Trial] = field(default_factory=list)
    taken: int = 0
    warnings: list[str] = field(default_factory=list)
    drawn: np.ndarray | None = None
    refusal: str = ""

    @property
    def paper(self) -> np.ndarray:
        return self.evidence.paper

    def numbers(self) -> dict[str, Any]:
        """What the JSON holds."""
        s = self.light
        assert s is not None
        return {
            "sun": None if s.to_light is None else {"to_light": s.to_light, "sigma_degrees": np.degrees(s.sigma)},
            "irradiance": s.E, "irradiance_sigma": s.E_sd, "radiance": s.Ls, "radiance_sigma": s.Ls_sd,
            "map_rows": 0 if s.around is None else len(s.around), "paper": self.paper,
            "models": [msgspec.to_builtins(t) for t in self.trials], "taken": self.trials[self.taken].name,
            "suns": [{"from": n, "to_light": d, "sigma_degrees": np.degrees(sd)} for n, d, sd in self.evidence.suns],
            "balls": [
                {"kind": "mirror", "center": m.ball.center, "radius": m.ball.radius, "sigma": m.ball.sigma,
                 "reflectance": m.reflectance}
                for m in self.evidence.mirrors
            ],
            "warnings": self.warnings,
        }  # fmt: skip


class LightRefused(InputError):
    """The photos do not show their light; `found` has what a page shows of them."""

    found: LightEstimate


def estimate_light(
    taken: Sequence[Path],
    board: str | Path,
    camera: str | Path,
    *,
    balls: Sequence[tuple[float, float, float, float]] = (),
    stand: tuple[float, float, float] | None = None,
    progress: Progress = silent,
) -> LightEstimate:
    """Sun and sky in which the photos were taken, relative to the board's white paper.

    `balls`: center and radius of each mirror ball, metres, roughly; `stand`: x, y of an upright's foot, and its height.
    Raises InputError where the photos are no photos of the board by the camera, LightRefused where they do not show
    their light.
    """
    definition = with_shape(boards.read_board(board), read_board_shapes(camera))
    lens = read_camera(camera)
    cameras = []
    for done, path in enumerate(taken):
        progress("poses", done, len(taken))
        cameras.append(_stand_of(path, lens, definition))
    progress("poses", len(taken), len(taken))
    linear, paper, said = read_linear(list(taken), cameras, definition)
    given = [given_ball(np.array(b[:3]), float(b[3])) for b in balls]
    start = LightEstimate(linear, definition, models.Evidence(paper), given, stand, warnings=said)
    try:
        return _estimated(start, progress)
    except InputError as error:
        refused = LightRefused(*error.fields)
        refused.found = replace(start, refusal=str(error))
        raise refused from None


def _estimated(start: LightEstimate, progress: Progress) -> LightEstimate:
    linear, said, shadow, mirrors = start.photos, list(start.warnings), None, []
    if start.stand is not None:
        shadow = find_shadow(linear, Sheet(start.board), start.stand)
        if shadow is None:
            said.append(f"--stand: no shadow of it on the sheet: no sun, or one below {LOWEST_SUN_DEGREES:g} degrees")
        elif shadow.width > WIDEST_UPRIGHT * shadow.height:
            said.append(f"--stand: not used: wider than {WIDEST_UPRIGHT:g} of its height, as no pin or pen is")
            shadow = None
    views = views_of(linear, start.board) if start.given else []
    for k, given in enumerate(start.given):
        progress("balls", k, len(start.given))
        try:
            ball = find_ball(views, given)
        except np.linalg.LinAlgError:
            raise InputError(given.name, "a ball whose place the photos determine", "one they do not") from None
        reflectance, suns = check_mirror(views, start.paper, ball, given), [sun_spot(photo, ball) for photo in linear]
        pixels, sun = mirrored(linear, ball, reflectance, suns), sun_of(linear, ball, suns)
        mirrors.append(models.MirrorBall(ball, pixels, reflectance, suns, sun))
    progress("balls", len(start.given), len(start.given))
    if not (shadow or mirrors):
        wanted = "--ball x,y,z,r (a mirror ball) or --stand x,y,h (an upright), in metres or as 60mm"
        raise InputError("light", wanted, said[-1] if start.stand else "neither")
    evidence = models.Evidence(start.paper, shadow, mirrors)
    light, trials, number = models.simplest_light(evidence)
    said += _contradictions(evidence.suns)
    found = replace(start, evidence=evidence, light=light, trials=trials, taken=number, warnings=said)
    return replace(found, drawn=_drawn(found, light))


def middle_of(board: boards.Board) -> tuple[float, float]:
    """The middle of the board's tags."""
    xy = np.array(list(board.centers().values()))
    x, y = (xy.min(axis=0) + xy.max(axis=0)) / 2
    return float(x), float(y)


def _drawn(found: LightEstimate, light: models.Light) -> np.ndarray:
    """The first photo with a matt grey ball on the middle of the board, as wide as the first ball, or three tags."""
    photo, (x, y) = found.photos[0], middle_of(found.board)
    mirrors = found.evidence.mirrors
    radius = mirrors[0].ball.radius if mirrors else 1.5 * found.board.tag_edge
    ball = Sphere((x, y, radius), radius, (0.5, 0.5, 0.5))
    x0, x1, y0, y1 = draw_board(found.board, 100.0)[1]
    half_u, half_v = ((x1 - x0) / 2, 0.0, 0.0), (0.0, (y1 - y0) / 2, 0.0)
    sheet = Rectangle(((x0 + x1) / 2, (y0 + y1) / 2, 0.0), half_u, half_v, (PAPER, PAPER, PAPER), in_photo=True)
    sun = Sun(tuple(light.to_light.tolist()), tuple(light.E.tolist())) if light.to_light is not None else NO_SUN
    scene = printed(Scene("light", photo.camera, (ball,), (sheet,), sun, light.sky), found.board)
    return augment(photo.pixels, scene, exposure=value_of_one(photo, found.paper)).pixels


def _stand_of(path: Path, lens: Camera, definition: boards.Board) -> Camera:
    size = photo_size(path)
    if size != lens.image_size:
        raise InputError(path, f"{lens.width} x {lens.height} pixels, as the camera's", f"{size[0]} x {size[1]}")
    tags = detect_photo(path, definition.family)
    pose = pose_of_tags(lens.K, lens.dist, tags, definition, path.name).refined
    if pose.rms_px > POSE_PX * max(1.0, lens.width / 2000):
        raise InputError(path, "a photo by the camera of --camera", f"tags {pose.rms_px:.1f} px off where it sees them")
    return msgspec.structs.replace(lens, R_cam_board=pose.R_cam_board, t_cam_board=pose.t_cam_board)


def _contradictions(suns: list[tuple[str, np.ndarray, float]]) -> list[str]:
    said = []
    for i, (a, d, sd) in enumerate(suns):
        for b, e, other in suns[:i]:
            apart = float(np.arccos(np.clip(d @ e, -1, 1)))
            if apart > CONTRADICTING_SIGMAS * np.hypot(sd, other):
                said.append(
                    f"{a} and {b} put the sun {np.degrees(apart):.1f} degrees apart: one of them is not as told"
                )
    return said
