"""Whether a calibration deserves trust: never by its rms alone, which is lowest where the views say least.

Six photos from one side fit anything. What tells is how well the views pin the camera down: standard deviations,
square pixels, a principal point near the middle, board normals that spread, and a covered frame.
"""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from raytwin.boards.board import Board
from raytwin.photos import pose
from raytwin.photos.detection import Tag
from raytwin.scene.lens import undone

CODES = {
    "swapped-orientation": "photos whose width and height are those of the others, swapped: left out",
    "mixed-orientation": "EXIF orientations differ: some photos' pixels may have been turned",
    "no-tags": "photos that were left out, and why",
    "few-views": "fewer views than a calibration should rest on",
    "degenerate-views": "views too alike to tell focal length, centre and distortion apart",
    "mirrored-board": "the board's description is a mirror image of the board",
    "unconverged-distortion": "the distortion has no inverse somewhere in the image",
    "outlier-tags": "tags that were rejected because they disagree with all others",
    "ambiguous-pose": "views whose pose could be either of two",
}
"""Every code, and what it means. Codes are stable: tools may test for them."""

FEW_VIEWS = 8
FOCAL_SD, CENTER_SD = 0.01, 0.015
ASPECT, CENTER_OFFSET = 0.02, 0.12
NORMAL_SPREAD, COVERAGE = 15.0, 0.25
"""Beyond these the views are degenerate: sd of a focal length as a share of it, sd of the centre as a share of the
image's side, |fx / fy - 1|, the centre's distance from the middle as a share of the side, the largest angle between two
of the board's normals in degrees, and the share of the frame's 10 x 10 cells that hold a tag's centre."""


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


def doubts_about(
    calibration,
    tags: Mapping[str, Sequence[Tag]],
    board: Board,
    wrong: Mapping[str, str],
    outliers: Mapping[str, Sequence[int]],
) -> list[tuple[str, str]]:
    """(code, text) of every doubt about a Calibration made from `tags`, by photo.

    `wrong`: photos left out, and why. `outliers`: ids rejected, by photo.
    """
    found = [("no-tags", f"{photo} was left out: {why}") for photo, why in wrong.items()]
    views = calibration.views
    if len(views) < FEW_VIEWS:
        found.append(
            ("few-views", f"{len(views)} views: with fewer than {FEW_VIEWS} the focal length moves by a per cent")
        )
    if reasons := _degenerate(calibration, tags):
        found.append(("degenerate-views", "; ".join(reasons)))
    mirrored = [v.photo for v in views if is_mirrored(*pose.matched(tags[v.photo], board))]
    if mirrored:
        which = f"{len(mirrored)} of {len(views)} views"
        text = f"the board is seen from behind in {which}: its description is mirrored (swap the sign of x)"
        found.append(("mirrored-board", text))
    if fault := undone(calibration.K, calibration.dist, calibration.image_size).fault:
        found.append(("unconverged-distortion", f"the distortion cannot be undone at {fault}"))
    for photo, ids in outliers.items():
        if ids:
            found.append(("outlier-tags", f"{photo}: rejected tags {', '.join(map(str, sorted(ids)))}"))
    if not mirrored:
        for view in views:
            start = pose.Pose(view.R_cam_board, view.t_cam_board, view.rms_px)
            _, ratio = pose.refined_pose(calibration.K, calibration.dist, tags[view.photo], board, start)
            if ratio is not None and ratio < pose.AMBIGUOUS:
                found.append(
                    ("ambiguous-pose", f"{view.photo}: a second pose fits with only {ratio:.2f} times the error")
                )
    return found


def _degenerate(calibration, tags: Mapping[str, Sequence[Tag]]) -> list[str]:
    """What says that the views are too alike; empty where nothing does."""
    (fx, _, cx), (_, fy, cy), _ = calibration.K
    width, height = calibration.image_size
    sd = calibration.sigma
    found = []
    for name, value in (("fx", fx), ("fy", fy)):
        if sd[name] > FOCAL_SD * value:
            found.append(f"{name} = {value:.0f} ± {sd[name]:.0f} px")
    for name, side in (("cx", width), ("cy", height)):
        if sd[name] > CENTER_SD * side:
            found.append(f"{name} is known to ± {sd[name]:.0f} px only")
    if abs(fx / fy - 1) > ASPECT:
        found.append(f"fx / fy = {fx / fy:.3f}, where cameras have 1")
    for name, value, side in (("cx", cx, width), ("cy", cy, height)):
        if abs(value - (side - 1) / 2) > CENTER_OFFSET * side:
            found.append(f"{name} = {value:.0f} lies {abs(value - (side - 1) / 2):.0f} px from the image's middle")
    spread = normal_spread([v.R_cam_board for v in calibration.views])
    if spread < NORMAL_SPREAD:
        found.append(f"the board's tilt differs by {spread:.0f} degrees at most: tilt it more ways")
    share = coverage(np.array([t.center for v in calibration.views for t in tags[v.photo]]), calibration.image_size)
    if share < COVERAGE:
        found.append(f"tags cover {100 * share:.0f} % of the frame: fill its corners too")
    return found
