"""Photos of an AprilTag board in, a calibrated camera out.

detection -> calibration (fit, model, bias, uncertainty) -> pose. `calibration_result` has the records that result,
`lens_model` the distortion, `diagnostics` the warnings. Importing this loads OpenCV, so commands import it only when
they run.
"""

from raytwin.calib.photos.calibration import calibrate, calibrate_detections
from raytwin.calib.photos.calibration_result import (
    Calibration,
    CalibrationWarning,
    FoundBoard,
    View,
    model_table,
)
from raytwin.calib.photos.camera_file import read_board_shapes, with_shape, write_camera_file
from raytwin.calib.photos.detection import NoTags, Tag, detect, detect_photo, detect_photos
from raytwin.calib.photos.lens_model import project
from raytwin.calib.photos.pose import (
    Pose,
    PoseReport,
    camera_at,
    camera_of_photo,
    homography_pose,
    pose_of_photo,
    pose_of_tags,
    refined_pose,
    rotation_degrees,
)
from raytwin.calib.photos.uncertainty import deviations, pose_deviation, uncertainty_map
