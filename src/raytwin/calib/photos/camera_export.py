"""The calibrated camera in other programs' files: OpenCV's, Kalibr's, ROS's, mrcal's.

All four count pixels as OpenCV does, (0, 0) being the centre of the top-left one, and all have its k1, k2, p1, p2, k3;
Kalibr's radtan stops at p2. To add a format: a function here and a row of EXPORTS.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from raytwin import files
from raytwin.calib.photos.lens_model import five
from raytwin.errors import InputError, check_one_of


def opencv_yaml(camera, where: str) -> str:
    """What cv::FileStorage reads, with the keys of OpenCV's own calibration sample."""
    width, height = camera.image_size
    flat = [v for row in camera.K for v in row]
    return (
        f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n"
        f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {_numbers(flat)}\n"
        f"distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
        f"   data: {_numbers(five(camera.dist).tolist())}\n"
    )


def ros_camera_info(camera, where: str) -> str:
    """ROS's camera_info YAML (camera_calibration_parsers), distortion_model plumb_bob, not rectified."""
    width, height = camera.image_size
    (fx, _, cx), (_, fy, cy), _ = camera.K
    matrices = (
        ("camera_matrix", 3, 3, [v for row in camera.K for v in row]),
        ("distortion_coefficients", 1, 5, five(camera.dist).tolist()),
        ("rectification_matrix", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        ("projection_matrix", 3, 4, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]),
    )
    text = [f"image_width: {width}", f"image_height: {height}", "camera_name: camera", "distortion_model: plumb_bob"]
    for name, rows, columns, values in matrices:
        text += [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {_numbers(values)}"]
    return "\n".join(text) + "\n"


def kalibr_camchain(camera, where: str) -> str:
    """Kalibr's camchain of one pinhole camera with radtan distortion: k1, k2, p1, p2. InputError for a k3."""
    k1, k2, p1, p2, k3 = five(camera.dist)
    if k3:
        expected = "a lens without k3, which Kalibr's radtan does not have (--model k1k2p1p2)"
        raise InputError(where, expected, f"k3 = {k3:.4g}")
    (fx, _, cx), (_, fy, cy), _ = camera.K
    return (
        f"cam0:\n  camera_model: pinhole\n  intrinsics: {_numbers((fx, fy, cx, cy))}\n  distortion_model: radtan\n"
        f"  distortion_coeffs: {_numbers((k1, k2, p1, p2))}\n  resolution: {list(camera.image_size)}\n"
        f"  rostopic: /cam0/image_raw\n"
    )


def mrcal_cameramodel(camera, where: str) -> str:
    """mrcal's .cameramodel, LENSMODEL_OPENCV5, the camera at the reference's origin."""
    (fx, _, cx), (_, fy, cy), _ = camera.K
    return (
        "{\n    'lensmodel':  'LENSMODEL_OPENCV5',\n"
        f"    'intrinsics': {_numbers((fx, fy, cx, cy, *five(camera.dist)))},\n"
        f"    'extrinsics': {_numbers([0] * 6)},\n    'imagersize': {list(camera.image_size)},\n}}\n"
    )


EXPORTS: dict[str, Callable[..., str]] = {
    "opencv": opencv_yaml,
    "ros": ros_camera_info,
    "kalibr": kalibr_camchain,
    "mrcal": mrcal_cameramodel,
}

ENDINGS = {".cameramodel": "mrcal", ".yaml": "opencv", ".yml": "opencv"}
"""What a file's ending says, where no format is named."""


def export_format(path: str | os.PathLike, kind: str | None = None) -> str:
    """Return the row of EXPORTS to write: `kind`, or what the file's ending says."""
    if kind is not None:
        check_one_of("--format", kind, EXPORTS)
        return kind
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise InputError(path, f"a name that ends in {', '.join(ENDINGS)}, or --format", ending or "no ending")
    return ENDINGS[ending]


def export_camera(path: str | os.PathLike, camera, kind: str | None = None) -> None:
    """Write anything with image_size, K and dist as another program's file; see EXPORTS."""
    files.write_text(path, EXPORTS[export_format(path, kind)](camera, str(path)))


def _numbers(values: Sequence[float]) -> str:
    """A list whose numbers read back exactly, each with a point: to YAML 1.1 `1e-05` is text."""
    shown = (repr(float(v)) for v in values)
    return f"[{', '.join(v if '.' in v else v.replace('e', '.0e') for v in shown)}]"
