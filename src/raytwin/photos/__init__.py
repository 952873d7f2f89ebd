"""Photos of an AprilTag board in, a calibrated camera out; and the photographer who makes such photos, with the truth.

board -> detect -> calibrate -> pose; `lens` holds the distortion, `judge` the doubts about a calibration. Importing
this loads OpenCV: commands do so only when they run.
"""

from raytwin.photos.board import FAMILIES, Board, BoardTag, Grid, check_board, draw_board, read_board, write_board
from raytwin.photos.calibrate import LEAST_VIEWS, Calibration, View, Warning_, calibrate, calibrate_detections
from raytwin.photos.detect import NoTags, Tag, detect, detect_photo, detect_photos
from raytwin.photos.fit import MODELS
from raytwin.photos.judge import CODES
from raytwin.photos.lens import project
from raytwin.photos.photographer import Truth, expose, photograph, poses, read_truth, sheet_of, write_truth
from raytwin.photos.pose import (
    Pose,
    PoseReport,
    camera_at,
    camera_of_photo,
    homography_pose,
    pose_of_photo,
    pose_of_tags,
    refined_pose,
)
from raytwin.photos.pyramid import draw_pyramid
from raytwin.photos.selection import ModelTrial, Told, explained
from raytwin.photos.uncertainty import Evidence, deviations, uncertainty_map

__all__ = [
    "CODES",
    "FAMILIES",
    "LEAST_VIEWS",
    "MODELS",
    "Board",
    "BoardTag",
    "Calibration",
    "Evidence",
    "Grid",
    "ModelTrial",
    "NoTags",
    "Pose",
    "PoseReport",
    "Tag",
    "Told",
    "Truth",
    "View",
    "Warning_",
    "calibrate",
    "calibrate_detections",
    "camera_at",
    "camera_of_photo",
    "check_board",
    "detect",
    "detect_photo",
    "detect_photos",
    "deviations",
    "draw_board",
    "draw_pyramid",
    "explained",
    "expose",
    "homography_pose",
    "photograph",
    "pose_of_photo",
    "pose_of_tags",
    "poses",
    "project",
    "read_board",
    "read_truth",
    "refined_pose",
    "sheet_of",
    "uncertainty_map",
    "write_board",
    "write_truth",
]
