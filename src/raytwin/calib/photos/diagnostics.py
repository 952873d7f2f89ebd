"""Whether a calibration deserves trust: never by its rms alone, which is lowest where the views say least.

Six photos from one side fit anything. The evidence is how well the views determine the camera: standard deviations,
square pixels, a principal point near the middle, board normals that spread, and a covered frame; and whether one photo,
or the board, is at odds with all the rest.

Every warning's code is stable: tools may test for it. docs/photos.md lists what each says.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from raytwin.calib.boards import Board
from raytwin.calib.photos import pose
from raytwin.calib.photos.calibration_result import Calibration
from raytwin.calib.photos.fit import Fit, Sighting, fit, matched
from raytwin.calib.photos.uncertainty import FitUncertainty, fit_uncertainty
from raytwin.errors import InputError
from raytwin.scene.lens import SIDE, undone

FEW_VIEWS = 8
"""Photos: with fewer a warning says how far the focal length may be off."""
FOCAL_SD, CENTER_SD = 0.02, 0.03
ASPECT, CENTER_OFFSET = 0.02, 0.12
NORMAL_SPREAD, COVERAGE = 15.0, 0.25
"""Beyond these the views are degenerate: sd of a focal length as a share of it, sd of the centre as a share of the
image's side, |fx / fy - 1|, the centre's distance from the middle as a share of the side, the largest angle between two
of the board's normals in degrees, and the share of the frame's 10 x 10 cells that hold a tag's centre."""

ODD_RMS = 2.5
"""A photo is odd if its rms in the camera of the others is this many times the median. (Sound sets: at most 2.4.)"""

ODD_PX = 0.2
"""Pixels: a photo of a smaller rms is not odd for it; small tags and slanting ones are read no better."""

LEAST_FOR_ODD = 5
"""Photos: with fewer, none can be odd."""

PREDICTED, FAR, SIGMA_WITHOUT = 0.97, 4.0, 2.0
"""A photo that looks odd is named only if K without it predicts the others with less than this fraction of their error
(1 for a photo FAR times beyond the limit), and if leaving it out multiplies no standard deviation of K by this factor:
the only near or slanted view disagrees with the rest because it carries the information."""


@dataclass(frozen=True, eq=False)
class Case:
    """Inputs of the checks: the `calibration`, its fit, how uncertain that is (`known`), and the views it was made
    from. `wrong`: photos left out, and why. `outliers`: ids rejected, by photo."""

    calibration: Calibration
    found: Fit
    known: FitUncertainty
    views: Sequence[Sighting]
    board: Board
    wrong: Mapping[str, str]
    outliers: Mapping[str, Sequence[int]]

    @property
    def image_size(self) -> tuple[int, int]:
        return self.found.observations.image_size

    @property
    def photos(self) -> list[str]:
        return [v.photo for v in self.views]

    def without(self, photo: str) -> "Case":
        """The same without one photo."""
        kept = [i for i, v in enumerate(self.views) if v.photo != photo]
        views = [self.views[i] for i in kept]
        start = replace(self.found, R=self.found.R[kept], t=self.found.t[kept])
        found = fit(views, self.image_size, self.board, start.form, start)
        return replace(self, views=views, found=found, known=fit_uncertainty(found))


Warnings = Iterator[tuple[str, str]]
"""(code, text)"""


def coverage(pixels: np.ndarray, image_size: tuple[int, int]) -> float:
    """The share of the frame's 10 x 10 cells that hold one of the points (n, 2)."""
    width, height = image_size
    cells, _, _ = np.histogram2d(pixels[:, 0] + 0.5, pixels[:, 1] + 0.5, bins=10, range=[[0, width], [0, height]])
    return float((cells > 0).mean())


def normal_spread(rotations: Sequence[np.ndarray]) -> float:
    """The largest angle between two of the board's normals in the camera frame, degrees."""
    normals = np.array([np.asarray(R)[:, 2] for R in rotations])
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))


def tilts(views, board: Board) -> list[float]:
    """The angle between the board's normal and the line of sight to its middle, degrees, by view."""
    middle = np.append(np.mean(list(board.centers().values()), axis=0), 0.0)
    sights = [np.array(v.R_cam_board) @ middle + v.t_cam_board for v in views]
    cosines = [abs(np.array(v.R_cam_board)[:, 2] @ s) / np.linalg.norm(s) for v, s in zip(views, sights, strict=True)]
    return np.degrees(np.arccos(np.clip(cosines, 0, 1))).tolist()


def is_mirrored(points: np.ndarray, pixels: np.ndarray) -> bool:
    """det H > 0 for H from the board to pixels, scaled so that the board is in front: its back would face the camera.

    det [r1 r2 t] = r3 . t: the board's normal points away from the camera. (The pixels' y points down as the camera's
    does, so K does not change the sign.) A detector reads no tag from behind: the description is at fault.
    """
    H, _ = cv2.findHomography(points[:, :2], pixels)
    if H is None:
        return False
    return bool(np.linalg.det(H) * np.sign(H[2] @ [*points[:, :2].mean(axis=0), 1.0]) > 0)


def warnings_for(case: Case) -> list[tuple[str, str]]:
    """(code, text) of every warning about a calibration."""
    return [warning for check in CHECKS for warning in check(case)]


def _left_out(case: Case) -> Warnings:
    by_reason: dict[str, list[str]] = {}
    for photo, why in case.wrong.items():
        by_reason.setdefault(why, []).append(photo)
    for why, of in by_reason.items():
        names = ", ".join(of[:3]) + f" and {len(of) - 3} more" * (len(of) > 3)
        yield "no-tags", f"{names} {'was' if len(of) == 1 else 'were'} left out: {why}"


def _few(case: Case) -> Warnings:
    if len(case.photos) < FEW_VIEWS:
        text = f"{len(case.photos)} photos: with fewer than {FEW_VIEWS} the focal length moves by a per cent"
        yield "few-views", text


def _degenerate(case: Case) -> Warnings:
    (fx, _, cx), (_, fy, cy), _ = case.calibration.K
    width, height = case.image_size
    sd = case.calibration.sigma
    found = []
    for name, value in (("fx", fx), ("fy", fy)):
        if sd[name] > FOCAL_SD * value:
            found.append(f"{name} = {value:.0f} ± {sd[name]:.0f} px")
    for name, side in (("cx", width), ("cy", height)):
        if sd[name] > CENTER_SD * side:
            found.append(f"{name} is known to ± {sd[name]:.0f} px only")
    if abs(fx / fy - 1) > ASPECT:
        found.append(f"fx / fy = {fx / fy:.3f}, where cameras have 1: is the board's pitch alike both ways?")
    for name, value, side in (("cx", cx, width), ("cy", cy, height)):
        if abs(off := value - (side - 1) / 2) > CENTER_OFFSET * side:
            found.append(f"{name} = {value:.0f} lies {abs(off):.0f} px from the image's middle")
    spread = normal_spread(list(case.found.R))
    if spread < NORMAL_SPREAD:
        found.append(f"the board's tilt differs by {spread:.0f} degrees at most: tilt it more ways")
    share = coverage(np.array([t.center for v in case.views for t in v.tags]), case.image_size)
    if share < COVERAGE:
        found.append(f"tags cover {100 * share:.0f} % of the frame: fill its corners too")
    if found:
        yield "degenerate-views", "; ".join(found)


def _mirrored(case: Case) -> Warnings:
    board, views = case.board, case.views
    behind = [v for v in views if is_mirrored(*matched(v.tags, board.flat()))]
    if behind:
        advice = "swap the sign of x"
        if board.grid is not None:
            advice = f'write order = "{"up" if board.grid.order == "down" else "down"}" into its [grid]'
        text = f"the board is seen from behind in {len(behind)} of {len(views)} views: its description is mirrored"
        yield "mirrored-board", f"{text} ({advice})"


def _odd(case: Case) -> Warnings:
    """Photos at odds with the rest, the worst first; each next one by the fit without those: an odd one makes others
    look so."""
    left_out: list[str] = []
    while len(case.photos) >= LEAST_FOR_ODD:
        odd = sorted(_oddities(case), reverse=True)
        named = next(((name, why, rest) for t, name, why in odd if (rest := _better_without(case, name, t))), None)
        if named is None:
            return
        name, why, rest = named
        after = f"with {', '.join(left_out)} left out, " if left_out else ""
        error, without = _others_error(case, name), _others_error(rest, name)
        text = f"without it the others are predicted to {without:.3f} px, with it to {error:.3f} px"
        blame = "(another camera, zoom or orientation, or blur): leave it out"
        if name == _steepest(case):
            blame = "(blur, another camera, or the only view so steep): take more as steep before you leave it out"
        yield "odd-photo", f"{name}: {after}{why}; {text} {blame}"
        left_out.append(name)
        case = rest


def _steepest(case: Case) -> str:
    """The photo of the largest tilt: alone of its kind, it may disagree because it carries the information."""
    tilt = dict(zip((v.photo for v in case.calibration.views), case.calibration.basis.tilts, strict=True))
    return max(case.photos, key=tilt.__getitem__)


def _oddities(case: Case) -> Iterator[tuple[float, str, str]]:
    """Yield (how odd, photo, why), by its rms in the camera of the others."""
    usual = max(float(np.median(case.known.errors)), 1e-9)
    for name, error in zip(case.photos, case.known.errors.tolist(), strict=True):
        if error > max(ODD_PX, ODD_RMS * usual):
            text = f"its rms in the camera of the others of {error:.3f} px is {error / usual:.1f} times the median"
            yield error / usual, name, f"{text} photo's {usual:.3f} px"


def _better_without(case: Case, name: str, times: float) -> Case | None:
    """Return the case without a photo if it predicts the others to less of their error and still determines K."""
    try:
        rest = case.without(name)
    except InputError:
        return None
    share = 1.0 if times > FAR * ODD_RMS else PREDICTED
    if _others_error(rest, name) > share * _others_error(case, name):
        return None
    sigma, before = (np.sqrt(np.diag(c.known.covariance)[:4]) for c in (rest, case))
    return rest if (sigma <= SIGMA_WITHOUT * before).all() else None


def _others_error(case: Case, name: str) -> float:
    """Pixels: the geometric mean, over the photos but `name`, of the rms of each in the fit without it. Another odd
    photo counts no more than a sound one."""
    errors = [e for photo, e in zip(case.photos, case.known.errors, strict=True) if photo != name]
    return math.exp(float(np.mean(np.log(np.maximum(errors, 1e-9)))))


def _unsupported(case: Case) -> Warnings:
    known = undone(case.calibration.K, case.calibration.dist, case.image_size)
    if known.fault:
        lost = 100 * float((~known.found[4 * SIDE :]).mean())
        text = f"no ray belongs to {lost:.2g} % of the frame, left black: the lens cannot be undone at {known.fault}"
        yield "unconverged-distortion", f"{text}; photograph the board there"


def _outliers(case: Case) -> Warnings:
    for photo, ids in case.outliers.items():
        if ids:
            yield "outlier-tags", f"{photo}: rejected tags {', '.join(map(str, sorted(ids)))}"


def _ambiguous(case: Case) -> Warnings:
    if any(_mirrored(case)):
        return
    c = case.calibration
    for view, shown in zip(case.views, c.views, strict=True):
        start = pose.Pose(shown.R_cam_board, shown.t_cam_board, shown.rms_px)
        _, ratio = pose.refined_pose(c.K, c.dist, view.tags, c.basis.board, start)
        if ratio is not None and pose.ambiguous(ratio, len(view.tags)):
            yield "ambiguous-pose", f"{view.photo}: a second pose fits with only {ratio:.2f} times the error"


CHECKS: tuple[Callable[[Case], Warnings], ...] = (
    _left_out, _few, _degenerate, _mirrored, _odd, _unsupported, _outliers, _ambiguous,
)  # fmt: skip
