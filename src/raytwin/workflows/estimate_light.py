"""Photos of a board with a ball or an upright beside it -> the light that they were taken in."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import files
from raytwin.calib import boards, photos
from raytwin.calib.augment import augment
from raytwin.calib.lighting import light_models as models
from raytwin.calib.lighting.ball_outline import Ball, find_balls, fit_edges, outline
from raytwin.calib.lighting.board_plane import Sheet, SheetLight
from raytwin.calib.lighting.linear_photo import LinearPhoto, read_linear, value_of_one
from raytwin.calib.lighting.matt_ball import MATT, NO_MIRROR, fit_shading, matt_pixels
from raytwin.calib.lighting.mirror_ball import find_ball, mirrored, reflectance_of, register, seen_in
from raytwin.calib.lighting.stand_shadow import LOWEST, THIN, find_shadow
from raytwin.errors import InputError
from raytwin.progress import Progress, silent
from raytwin.scene import Camera, Lambert, Rectangle, Scene, Sky, Sphere, Sun
from raytwin.scene.scene import NO_SUN

POSE_PX = 3.0
"""A pose that leaves its tags this far off, as a root mean square, is that of another camera."""

REFLECTANCE = 0.9
"""Reflectance assumed for a mirror ball that does not reflect the white paper by which to measure it."""

DOUBTFUL, UNEXPLAINED = 0.2, 0.5
"""Share of the light by which even the best model is off held-out pixels: a warning says so; it is no light at all."""

APART = 4.0
"""Directions to the sun that differ by so many of their joint standard deviations contradict each other."""


@dataclass(frozen=True, eq=False)
class LightEstimate:
    """All that `raytwin light` found; its page and its text are views of it."""

    light: models.Light
    paper: np.ndarray
    photos: list[LinearPhoto]
    evidence: models.Evidence
    trials: list[models.Trial]
    taken: int
    suns: list[tuple[str, np.ndarray, float]]
    warnings: list[str] = field(default_factory=list)
    drawn: np.ndarray | None = None

    def lines(self, photo: int) -> list[tuple[np.ndarray, str, bool]]:
        """What a page draws over a photo: pixels of a line (n, 2), its colour, and whether it is closed."""
        p = self.photos[photo]
        found = [(outline(p, m.ball.center, m.ball.radius), "#f22", True) for m in self.evidence.matt]
        for mirror in self.evidence.mirrors:
            found.append((outline(p, mirror.ball.center, mirror.ball.radius), "#fd0", True))
            spot = mirror.pixels.sun & (mirror.pixels.photo == photo)
            if spot.any():
                u, v = mirror.pixels.uv[spot].mean(axis=0)
                d = p.camera.width / 100
                found += [
                    (np.array([(u - d, v), (u + d, v)]), "#fd0", False),
                    (np.array([(u, v - d), (u, v + d)]), "#fd0", False),
                ]
        if self.evidence.shadow:
            s = self.evidence.shadow
            found.append((p.project(np.array([(*s.foot, s.height), (*s.foot, 0), (*s.tip, 0)])), "#28f", False))
        return found

    def numbers(self) -> dict[str, Any]:
        """What the JSON holds."""
        s = self.light
        balls: list[tuple[str, Ball, Any]] = [("matt", m.ball, None) for m in self.evidence.matt]
        balls += [("mirror", m.ball, m.reflectance) for m in self.evidence.mirrors]
        return {
            "sun": None if s.to_light is None else {"to_light": s.to_light, "sigma_degrees": np.degrees(s.sigma)},
            "irradiance": s.E, "irradiance_sigma": s.E_sd, "radiance": s.Ls, "radiance_sigma": s.Ls_sd,
            "map_rows": 0 if s.around is None else len(s.around), "paper": self.paper,
            "models": [msgspec.to_builtins(t) for t in self.trials], "taken": self.trials[self.taken].name,
            "suns": [{"from": n, "to_light": d, "sigma_degrees": np.degrees(sd)} for n, d, sd in self.suns],
            "balls": [
                {"kind": kind, "center": b.center, "radius": b.radius, "sigma": b.sigma, "reflectance": r}
                for kind, b, r in balls
            ],
            "warnings": self.warnings,
        }  # fmt: skip


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

    `balls`: center and radius of each, metres, roughly; whether one is a mirror or matt is seen. Without any, and
    without a `stand` (x, y of its foot, height), balls that rest beside the board are looked for. Raises InputError
    where there is nothing that shows the light.
    """
    definition = photos.with_shape(boards.read_board(board), photos.read_board_shapes(camera))
    lens = files.read_camera(camera)
    cameras = []
    for done, path in enumerate(taken):
        progress("poses", done, len(taken))
        cameras.append(_stand_of(path, lens, definition))
    progress("poses", len(taken), len(taken))
    linear, paper, said = read_linear(list(taken), cameras, definition)
    sheet = Sheet(definition)
    evidence = models.Evidence(paper)
    if stand is not None:
        shadow = find_shadow(linear, sheet, stand)
        if shadow is None:
            said.append(f"--stand: no shadow of it on the sheet: no sun, or one below {LOWEST:g} degrees")
        elif shadow.width > THIN * shadow.height:
            said.append(f"--stand: not used: wider than {THIN:g} of its height, as no pin or pen is")
            shadow = None
        evidence = replace(evidence, shadow=shadow)
    if balls or stand is not None:
        there = [find_ball(linear, sheet, np.array(b[:3]), float(b[3]))[0] for b in balls]
    else:
        there = _found(linear, sheet)
    _add_balls(evidence, linear, sheet, there, bool(balls), said, progress)
    if not (evidence.shadow or evidence.matt or evidence.mirrors):
        raise InputError(
            "photos", "a mirror ball, a matt ball or a pin beside the board (--ball x,y,z,r, --stand x,y,h in metres)",
            said[-1] if stand else "the board alone",
        )  # fmt: skip
    light, trials, number, suns = models.choose(evidence, len(linear))
    said += _contradictions(suns)
    if trials[number].error > UNEXPLAINED:
        raise InputError(
            "photos", "balls and uprights that sun and sky explain",
            f"held-out pixels {100 * trials[number].error:.0f} % off under the best light: a ball is neither matt nor a"
            " mirror, or not there",
        )  # fmt: skip
    if trials[number].error > DOUBTFUL:
        said.append(
            f"the best light is {100 * trials[number].error:.0f} % off held-out pixels ("
            + ", ".join(f"{kind} {100 * off:.0f} %" for kind, off in trials[number].by_kind.items())
            + "): what is drawn under it may not look real"
        )
    if any(m.pixels.clipped[m.pixels.to_light[:, 2] > 0].mean() > 0.02 for m in evidence.mirrors):
        said.append("more than 2 % of what the mirror ball shows from above is clipped: the map is a lower bound there")
    drawn = _drawn(linear[0], light, paper, evidence, definition)
    return LightEstimate(light, paper, linear, evidence, trials, number, suns, said, drawn)


def _drawn(
    photo: LinearPhoto, light: models.Light, paper: np.ndarray, evidence: models.Evidence, definition: boards.Board
) -> np.ndarray:
    """The first photo with a matt grey ball on the middle of the board, as wide as the first ball, or three tags."""
    balls = [m.ball.radius for m in evidence.matt] + [m.ball.radius for m in evidence.mirrors]
    xy = np.array(list(definition.centers().values()))
    x, y = (xy.min(axis=0) + xy.max(axis=0)) / 2
    radius = balls[0] if balls else 1.5 * definition.tag_edge
    ball = Sphere((float(x), float(y), radius), radius, Lambert((0.5, 0.5, 0.5)))
    reach = 20 * radius + float(np.ptp(xy, axis=0).max())
    ground = Rectangle((float(x), float(y), 0.0), (reach, 0.0, 0.0), (0.0, reach, 0.0), in_photo=True)
    sun = Sun(tuple(light.to_light.tolist()), tuple(light.E.tolist())) if light.to_light is not None else NO_SUN
    sky = light.environment or Sky(tuple(light.Ls.tolist()))
    scene = Scene("light", photo.camera, (ball, ground), (sun, sky))
    return augment(photo.pixels, scene, exposure=value_of_one(photo, paper), ground=True).pixels


def _stand_of(path: Path, lens: Camera, definition: boards.Board) -> Camera:
    size = files.photo_size(path)
    if size != lens.image_size:
        raise InputError(path, f"{lens.width} x {lens.height} pixels, as the camera's", f"{size[0]} x {size[1]}")
    tags = photos.detect_photo(path, definition.kind)
    pose = photos.pose_of_tags(lens.K, lens.dist, tags, definition, path.name).refined
    if pose.rms_px > POSE_PX * max(1.0, lens.width / 2000):
        raise InputError(path, "a photo by the camera of --camera", f"tags {pose.rms_px:.1f} px off where it sees them")
    return msgspec.structs.replace(lens, R_cam_board=pose.R_cam_board, t_cam_board=pose.t_cam_board)


def _found(linear: list[LinearPhoto], sheet: Sheet) -> list[Ball]:
    """Balls that rest beside the board: circles of any photo that are a ball's outline in all of them.

    The sky's edge within a mirror ball is a circle, too, and often the stronger one: of two in one place the likelier
    is taken.
    """
    tried: list[tuple[np.ndarray, float]] = []
    found: list[tuple[float, Ball]] = []
    for center, radius in (circle for photo in linear for circle in find_balls(photo, sheet.extent)):
        if any(np.linalg.norm(center - c) < 0.25 * max(radius, r) for c, r in tried):
            continue
        tried.append((center, radius))
        with contextlib.suppress(InputError):
            ball, likelihood = find_ball(linear, sheet, center, radius, given=False)
            found.append((likelihood, ball))
    kept: list[Ball] = []
    for _, ball in sorted(found, key=lambda f: -f[0]):
        if all(np.linalg.norm(ball.center - b.center) > max(ball.radius, b.radius) for b in kept):
            kept.append(ball)
    return kept


def _add_balls(
    evidence: models.Evidence, linear: list[LinearPhoto], sheet: Sheet, there: list[Ball], given: bool, said: list[str],
    progress: Progress,
) -> None:  # fmt: skip
    for k, ball in enumerate(there):
        progress("balls", k, len(there))
        try:
            _add_ball(evidence, linear, sheet, ball, given, said)
        except np.linalg.LinAlgError:
            if given:
                raise InputError(ball.name, "a ball whose place the photos determine", "one they do not") from None
    progress("balls", len(there), len(there))


def _add_ball(
    evidence: models.Evidence, linear: list[LinearPhoto], sheet: Sheet, found: Ball, given: bool, said: list[str]
) -> None:
    matt = fit_edges(linear, found)
    pixels = matt_pixels(linear, matt)
    light = SheetLight(linear, sheet, found)
    mirrors_sheet, mirrors_sun = seen_in(linear, found, light)
    if len(pixels.photo) >= models.LEAST_PIXELS and not mirrors_sheet:
        rough = fit_shading(pixels, matt, evidence.paper)
        if rough.residual < (NO_MIRROR if given and not mirrors_sun else MATT):
            evidence.matt.append(models.MattBall(matt, pixels))
            return
    ball, sun = register(linear, found, light)
    reflectance = reflectance_of(linear, ball, sheet)
    known = reflectance is not None and bool(reflectance.min() > 0.2 and reflectance.max() < 1.1)
    if not (mirrors_sheet or mirrors_sun or given):
        return  # a round thing that is neither matt nor a mirror
    if not known:
        said.append(f"{ball.name}: the sheet is not seen in it, so that its reflectance is taken for {REFLECTANCE}")
    rho = reflectance if reflectance is not None and known else np.full(3, REFLECTANCE)
    evidence.mirrors.append(models.MirrorBall(ball, mirrored(linear, ball, rho), rho, known, sun))


def _contradictions(suns: list[tuple[str, np.ndarray, float]]) -> list[str]:
    said = []
    for i, (a, d, sd) in enumerate(suns):
        for b, e, other in suns[:i]:
            apart = float(np.arccos(np.clip(d @ e, -1, 1)))
            if apart > APART * np.hypot(sd, other):
                said.append(
                    f"{a} and {b} put the sun {np.degrees(apart):.1f} degrees apart: one of them is not as told"
                )
    return said
