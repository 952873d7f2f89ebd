"""Whether a calibration deserves trust: never by its rms alone, which is lowest where the views say least.

Six photos from one side fit anything. The evidence is how well the views determine the camera: standard deviations,
square pixels, a principal point near the middle, board normals that spread, and a covered frame; and whether one photo,
or the board, is at odds with all the rest.

Every warning's code is stable: tools may test for it. docs/photos.md lists what each says.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from raytwin.errors import InputError
from raytwin.photos.boards import Board
from raytwin.photos.camera import pose
from raytwin.photos.camera.calibration_result import Calibration
from raytwin.photos.camera.fit import Fit, Sighting, fit
from raytwin.photos.camera.uncertainty import FitUncertainty, fit_uncertainty
from raytwin.scene.lens import SIDE, undone

FEW_VIEWS = 8
"""Photos: with fewer a warning says how far the focal length may be off."""
FOCAL_SD, CENTER_SD = 0.02, 0.03
ASPECT, CENTER_OFFSET = 0.02, 0.12
NORMAL_SPREAD, COVERAGE = 15.0, 0.25
"""Beyond these the views are degenerate: sd of a focal length as a share of it, sd of the centre as a share of the
image's side, |fx / fy - 1|, the centre's distance from the middle as a share of the side, the largest angle between two
of the board's normals in degrees, and the share of the frame's 10 x 10 cells that hold a tag's centre."""

MISFIT = 0.01
"""Share of the distance between neighbouring tags: a larger rms says that the board's file is wrong. (Sound sets have
at most 0.005, a fisheye of 150 degrees 0.04, a pitch that is 3 % wrong in one direction 0.022.)"""

ODD_RMS = 2.5
"""A photo is odd if its rms in the camera of the others is this many times the median. (Sound sets: at most 2.4.)"""

ODD_PX = 0.2
"""Pixels: a photo of a smaller rms is not odd for it; small tags and slanting ones are read no better."""

LEAST_FOR_ODD = 5
"""Photos: with fewer, none can be odd."""

BETTER_WITHOUT, FAR_SIGMAS, SIGMA_WITHOUT = 0.97, 4.0, 2.0
"""A photo that looks odd is named only if K without it predicts the others with less than this fraction of their error
(1 for a photo FAR_SIGMAS times beyond the limit), and if leaving it out multiplies no standard deviation of K by
SIGMA_WITHOUT: the only near or slanted view disagrees with the rest because it carries the information."""


@dataclass(frozen=True, eq=False)
class CheckInputs:
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
    def errors(self) -> dict[str, float]:
        """By photo, the rms distance of its tags in the camera of the others, pixels."""
        return dict(zip((v.photo for v in self.views), np.maximum(self.known.errors, 1e-9).tolist(), strict=True))

    def without(self, photo: str) -> "CheckInputs":
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


def line_of_sight(found: Fit, board: Board) -> np.ndarray:
    """By view, the cosine of the angle between the line to the board's middle and the normal, below 0 from behind."""
    sights = found.R @ np.append(np.mean(list(board.centers().values()), axis=0), 0.0) + found.t
    return np.asarray(-(found.R[:, :, 2] * sights).sum(axis=1) / np.linalg.norm(sights, axis=1))


def misfit(found: Fit) -> float:
    """The rms as a share of the median distance from a tag to the nearest."""
    of = found.observations
    views = (pixels[seen] for pixels, seen in zip(of.pixels, of.seen, strict=True))
    return found.rms_px / float(np.median(np.concatenate([KDTree(at).query(at, 2)[0][:, 1] for at in views])))


def warnings_for(case: CheckInputs) -> list[tuple[str, str]]:
    """(code, text) of every warning about a calibration."""
    return [warning for check in CHECKS for warning in check(case)]


def _left_out(case: CheckInputs) -> Warnings:
    by_reason: dict[str, list[str]] = {}
    for photo, why in case.wrong.items():
        by_reason.setdefault(why, []).append(photo)
    for why, of in by_reason.items():
        names = ", ".join(of[:3]) + f" and {len(of) - 3} more" * (len(of) > 3)
        yield "no-tags", f"{names} {'was' if len(of) == 1 else 'were'} left out: {why}"


def _few(case: CheckInputs) -> Warnings:
    if len(case.views) < FEW_VIEWS:
        yield "few-views", f"{len(case.views)} photos: with fewer than {FEW_VIEWS} the focal length moves by a per cent"


def _degenerate(case: CheckInputs) -> Warnings:
    (fx, _, cx), (_, fy, cy), _ = case.calibration.K
    width, height = case.image_size
    sd = case.calibration.sigma
    found = []
    for name, value in (("fx", fx), ("fy", fy)):
        if sd[name] > FOCAL_SD * value:
            found.append(f"{name} = {value:.0f} ± {sd[name]:.0f} px")
    if abs(fx / fy - 1) > ASPECT:
        found.append(f"fx / fy = {fx / fy:.3f}, where cameras have 1: is the board's pitch alike both ways?")
    for name, value, side in (("cx", cx, width), ("cy", cy, height)):
        if sd[name] > CENTER_SD * side:
            found.append(f"{name} is known to ± {sd[name]:.0f} px only")
        if abs(off := value - (side - 1) / 2) > CENTER_OFFSET * side:
            found.append(f"{name} = {value:.0f} lies {abs(off):.0f} px from the image's middle")
    spread = normal_spread(list(case.found.R))
    if spread < NORMAL_SPREAD:
        found.append(f"the board's tilt differs by {spread:.0f} degrees at most: tilt it more ways")
    share = coverage(np.array([t.center for v in case.views for t in v.tags]), case.image_size)
    if share < COVERAGE:
        found.append(f"tags cover {100 * share:.0f} % of the frame: fill its corners too")
    if (off := misfit(case.found)) > MISFIT:
        found.append(f"tags lie {100 * off:.1f} % of their pitch off: is it alike both ways, as the board's file says?")
    if found:
        yield "degenerate-views", "; ".join(found)


def _mirrored(case: CheckInputs) -> Warnings:
    """A mirrored description fits as well, seen from behind; but no detector reads a tag from there."""
    behind, grid = int((line_of_sight(case.found, case.board) < 0).sum()), case.board.grid
    if behind:
        advice = "swap the sign of x"
        if grid is not None:
            advice = f'write order = "{"up" if grid.order == "down" else "down"}" into its [grid]'
        text = f"the board is seen from behind in {behind} of {len(case.views)} views: its description is mirrored"
        yield "mirrored-board", f"{text} ({advice})"


def _odd(case: CheckInputs) -> Warnings:
    """Photos at odds with the rest, the worst first; each next one by the fit without those: an odd one makes others
    look so."""
    left_out: list[str] = []
    while (found := _oddest(case)) is not None:
        name, why, rest = found
        after = f"with {', '.join(left_out)} left out, " if left_out else ""
        blame = "(another camera, zoom or orientation, or blur): leave it out"
        if name == case.views[np.abs(line_of_sight(case.found, case.board)).argmin()].photo:
            blame = "(blur, another camera, or the only view so steep): take more as steep before you leave it out"
        yield "odd-photo", f"{name}: {after}{why} {blame}"
        left_out.append(name)
        case = rest


def _suspects(case: CheckInputs) -> list[str]:
    """The photos whose rms in the camera of the others is far beyond the median photo's, the worst first."""
    limit = max(ODD_PX, ODD_RMS * float(np.median([*case.errors.values()])))
    beyond = [name for name, error in case.errors.items() if error > limit and len(case.views) >= LEAST_FOR_ODD]
    return sorted(beyond, key=case.errors.__getitem__, reverse=True)


def _oddest(case: CheckInputs) -> tuple[str, str, CheckInputs] | None:
    """The worst suspect without which the others are predicted better, why it is odd, and the case without it."""
    usual = float(np.median([*case.errors.values()]))
    for name in _suspects(case):
        try:
            rest = case.without(name)
        except InputError:
            continue
        error, before, after = case.errors[name], _others_error(case, name), _others_error(rest, name)
        share = 1.0 if error > FAR_SIGMAS * ODD_RMS * usual else BETTER_WITHOUT
        variance, with_it = (np.diag(c.known.covariance)[:4] for c in (rest, case))
        if after <= share * before and (variance <= SIGMA_WITHOUT**2 * with_it).all():
            why = f"its rms in the camera of the others of {error:.3f} px is {error / usual:.1f} times the median"
            gain = f"without it the others are predicted to {after:.3f} px, with it to {before:.3f} px"
            return name, f"{why} photo's {usual:.3f} px; {gain}", rest
    return None


def _others_error(case: CheckInputs, name: str) -> float:
    """Pixels: the geometric mean, over the photos but `name`, of the rms of each in the fit without it. Another odd
    photo counts no more than a sound one."""
    return math.exp(float(np.mean([math.log(e) for photo, e in case.errors.items() if photo != name])))


def _unsupported(case: CheckInputs) -> Warnings:
    known = undone(case.calibration.K, case.calibration.dist, case.image_size)
    if known.fault:
        lost = 100 * float((~known.found[4 * SIDE :]).mean())
        text = f"no ray belongs to {lost:.2g} % of the frame, left black: the lens cannot be undone at {known.fault}"
        yield "unconverged-distortion", f"{text}; photograph the board there"


def _outliers(case: CheckInputs) -> Warnings:
    for photo, ids in case.outliers.items():
        if ids:
            yield "outlier-tags", f"{photo}: rejected tags {', '.join(map(str, sorted(ids)))}"


def _ambiguous(case: CheckInputs) -> Warnings:
    if any(_mirrored(case)):
        return
    c = case.calibration
    for view, shown in zip(case.views, c.views, strict=True):
        start = pose.Pose(shown.R_cam_board, shown.t_cam_board, shown.rms_px)
        _, ratio = pose.refined_pose(c.K, c.dist, view.tags, c.basis.board, start)
        if ratio is not None and pose.ambiguous(ratio, len(view.tags)):
            yield "ambiguous-pose", f"{view.photo}: a second pose fits with only {ratio:.2f} times the error"


CHECKS: tuple[Callable[[CheckInputs], Warnings], ...] = (
    _left_out, _few, _degenerate, _mirrored, _odd, _unsupported, _outliers, _ambiguous,
)  # fmt: skip
