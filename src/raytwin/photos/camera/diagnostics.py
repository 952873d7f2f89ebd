"""Whether a calibration deserves trust: never by its rms alone, which is lowest where the views say least.

Every warning's code is stable: tools may test for it. docs/photos.md lists what each says.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.distance import pdist

from raytwin.photos.boards import Board
from raytwin.photos.camera import pose
from raytwin.photos.camera.calibration_result import Calibration, CalibrationWarning
from raytwin.photos.camera.fit import Fit, Views
from raytwin.scene.lens import undone

FEW_VIEWS = 8
"""Photos: with fewer a warning says how far the focal length may be off."""

FOCAL_SD, CENTER_SD, ASPECT, CENTER_OFFSET = 0.02, 0.03, 0.02, 0.12
"""Above these the views are degenerate: sd of a focal length as a share of it, sd of the centre as a share of the
image's side, |fx / fy - 1|, the centre's distance from the middle as a share of the side."""

NORMAL_SPREAD, COVERAGE = 15.0, 0.25
"""Below these the views are degenerate: the largest angle between two of the board's normals in degrees, the share of
the frame's 10 x 10 cells that hold a tag's centre."""

MISFIT = 0.01
"""Largest rms as a share of the distance between neighbouring tags. (Sound sets have at most 0.005, a fisheye of 150
degrees 0.04, a pitch that is 3 % wrong in one direction 0.022.)"""

ODD_RMS, ODD_PX, LEAST_FOR_ODD = 2.5, 0.2, 5
"""A photo is odd if its rms in the camera of the others is this many times the median, and this many pixels; of fewer
photos, none is. (Sound sets: at most 2.4 times.)"""


def coverage(made: Calibration) -> float:
    """The share of the frame's 10 x 10 cells that hold a tag's centre."""
    width, height = made.image_size
    u, v = np.array(made.evidence.seen).T + 0.5
    return float((np.histogram2d(u, v, bins=10, range=[[0, width], [0, height]])[0] > 0).mean())


def normal_spread(rotations: Sequence[np.ndarray]) -> float:
    """The largest angle between two of the board's normals in the camera frame, degrees."""
    normals = np.array([np.asarray(R)[:, 2] for R in rotations])
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))


def warnings_for(
    made: Calibration,
    found: Fit,
    views: Views,
    board: Board,
    wrong: Mapping[str, str],
    rejected: Mapping[str, set[int]],
) -> tuple[CalibrationWarning, ...]:
    """What speaks against a calibration `made` of the fit `found` of `views`. `wrong`: photos left out, and why.
    `rejected`: ids of outliers, by photo."""
    said = []
    for why in dict.fromkeys(wrong.values()):
        of = [photo for photo, reason in wrong.items() if reason == why]
        names = ", ".join(of[:3]) + f" and {len(of) - 3} more" * (len(of) > 3)
        said.append(("no-tags", f"{names} {'was' if len(of) == 1 else 'were'} left out: {why}"))
    if len(views) < FEW_VIEWS:
        text = f"{len(views)} photos: with fewer than {FEW_VIEWS} the focal length moves by a per cent"
        said.append(("few-views", text))
    if doubts := degenerate(made, found):
        said.append(("degenerate-views", "; ".join(doubts)))
    # A mirrored description fits as well, seen from behind; but no detector reads a tag from there.
    sights = found.R @ np.append(np.mean([*board.centers().values()], axis=0), 0.0) + found.t
    if behind := int(((found.R[:, :, 2] * sights).sum(axis=1) > 0).sum()):
        order = "down" if board.grid is not None and board.grid.order == "up" else "up"
        advice = "swap the sign of x" if board.grid is None else f'write order = "{order}" into its [grid]'
        text = (
            f"the board is seen from behind in {behind} of {len(views)} views: its description is mirrored ({advice})"
        )
        said.append(("mirrored-board", text))
    if odd := odd_photo(found, [*views]):
        said.append(("odd-photo", odd))
    inverse = undone(made.K, made.dist, made.image_size)
    if inverse.fault:
        lost = 100 * float((~inverse.found).mean())
        text = f"no ray belongs to {lost:.2g} % of the frame, left black: the lens cannot be undone at {inverse.fault}"
        said.append(("unconverged-distortion", f"{text}; photograph the board there"))
    for photo, ids in rejected.items():
        if ids:
            said.append(("outlier-tags", f"{photo}: rejected tags {', '.join(map(str, sorted(ids)))}"))
    for photo, tags in views.items() if not behind else ():
        _, ratio = pose.refined_pose(made.K, made.dist, tags, found.shaped(board))
        if ratio is not None and pose.ambiguous(ratio, len(tags)):
            said.append(("ambiguous-pose", f"{photo}: a second pose fits with only {ratio:.2f} times the error"))
    return tuple(CalibrationWarning(*warning) for warning in said)


def degenerate(made: Calibration, found: Fit) -> list[str]:
    """In which way the views do not determine the camera; none of sound ones."""
    ((fx, _, cx), (_, fy, cy), _), sd, (width, height) = made.K, made.sigma, made.image_size
    aspect, off_x, off_y = fx / fy, abs(cx - (width - 1) / 2), abs(cy - (height - 1) / 2)
    spread, covered, board = normal_spread([*found.R]), coverage(made), found.observations.points
    off = found.rms_px / (fx * pdist(board).min() / np.median(found.t[:, 2]))
    doubts = {
        f"fx = {fx:.0f} ± {sd['fx']:.0f} px": sd["fx"] > FOCAL_SD * fx,
        f"fy = {fy:.0f} ± {sd['fy']:.0f} px": sd["fy"] > FOCAL_SD * fy,
        f"fx / fy = {aspect:.3f}, not 1: is the board's pitch alike both ways?": abs(aspect - 1) > ASPECT,
        f"cx is known to ± {sd['cx']:.0f} px only": sd["cx"] > CENTER_SD * width,
        f"cy is known to ± {sd['cy']:.0f} px only": sd["cy"] > CENTER_SD * height,
        f"cx = {cx:.0f} lies {off_x:.0f} px from the image's middle": off_x > CENTER_OFFSET * width,
        f"cy = {cy:.0f} lies {off_y:.0f} px from the image's middle": off_y > CENTER_OFFSET * height,
        f"the board's tilt differs by {spread:.0f} degrees at most: tilt it more ways": spread < NORMAL_SPREAD,
        f"tags cover {100 * covered:.0f} % of the frame: fill its corners too": covered < COVERAGE,
        f"tags lie {100 * off:.1f} % of their pitch off: is the board's file correct both ways?": off > MISFIT,
    }
    return [text for text, doubtful in doubts.items() if doubtful]


def odd_photo(found: Fit, names: Sequence[str]) -> str:
    """What is said of the photo most at odds with the rest, if any is; others show once it is left out."""
    _, errors = found.leave_one_out()
    odd, usual = int(errors.argmax()), float(np.median(errors))
    if len(names) < LEAST_FOR_ODD or errors[odd] <= max(ODD_PX, ODD_RMS * usual):
        return ""
    times = f"{errors[odd]:.3f} px is {errors[odd] / usual:.1f} times the median photo's"
    blame = "(another camera, zoom or orientation, or blur)"
    advice = "leave it out, or take more like it if none is so near or so steep"
    return f"{names[odd]}: its rms in the camera of the others of {times} {blame}: {advice}"
