"""Photos of an AprilTag board in, a calibrated camera out.

detection -> calibration (fit, model, bias, diagnostics) -> pose. Importing this loads OpenCV, so commands import it
only when they run.
"""

from raytwin.photos.camera.calibration import calibrate, calibrate_detections
from raytwin.photos.camera.calibration_result import (
    Calibration,
    CalibrationWarning,
    FoundBoard,
    View,
    with_shape,
    write_camera_file,
)
from raytwin.photos.camera.detection import Tag, detect, detect_photo, detect_photos
from raytwin.photos.camera.lens_model import project
from raytwin.photos.camera.pose import Pose, camera_at, place_camera, pose_of_tags, refined_pose, rotation_degrees
