"""Results to report on: the tracer in float64 beside itself in float32, and a made-up calibration."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from raytwin import files
from raytwin.compare import compare
from raytwin.image import Image, Surface
from raytwin.photos import Calibration, Pose, PoseReport
from raytwin.photos.calibrate import View, Warning_
from raytwin.pipeline import Result, Timing, TruthRow, augment
from raytwin.scene import Scene
from raytwin.tracer import trace


@pytest.fixture(scope="session")
def make_result(scenes) -> Callable[..., Result]:
    """`make_result(scene="overlap", size=None, photos=False, rung="shadow", spoil=None)`; `spoil(tracer's image)`."""

    def make(scene="overlap", size=(160, 120), photos=False, rung="shadow", spoil=None) -> Result:
        stage = files.read_scene(scenes / scene)
        stage = stage.with_camera(stage.camera.resized(*size))
        tracer, twin = trace(stage, rung, "numpy64"), trace(stage, rung, "numpy32")
        if spoil is not None:
            tracer = spoil(copied(tracer))
        comparison = compare(tracer, twin, tolerance=stage.tolerance, scene=stage.name, rung=rung)
        comparison = msgspec.structs.replace(
            comparison,
            seconds={"calibrate": 2.31 if photos else None, "tracer": 0.412, "twin": 0.24, "compare": 0.0031},
            backend={"twin_variant": "llvm_ad_rgb", "tracer_engine": "numpy64", "libllvm": None},
        )
        result = Result(
            scene=stage,
            comparison=comparison,
            subject=tracer,
            twin=twin,
            times=(Timing("tracer", 0.412, "p99.9 error 2e-7"), Timing("twin", 0.24, "the reference")),
            settings={"rung of the tracer": rung, "sphere solver": "robust", "trim boxes": "on"},
            versions={"python": "3.11.2", "raytwin": "0.1.0", "numpy": "2.4.6"},
        )
        return photographed(result) if photos else result

    return make


def copied(image: Image) -> Image:
    s = image.surface
    return Image(image.mean.copy(), None, 1, Surface(s.ids.copy(), s.depth.copy(), s.normal.copy()))


def photographed(result: Result) -> Result:
    """With a noisy photo of its planes, a calibration of twelve views and the truth."""
    scene: Scene = result.scene
    width, height = scene.camera.image_size
    rng = np.random.default_rng(7)
    empty = trace(msgspec.structs.replace(scene, spheres=()), "lambert", "numpy32")
    photo = files.to_bytes(np.clip(empty.mean + rng.normal(0, 0.01, empty.mean.shape), 0, 1).astype(np.float32))
    planes = tuple(msgspec.structs.replace(p, in_photo=True) for p in scene.planes)
    scene = msgspec.structs.replace(scene, planes=planes)
    camera = scene.camera
    R, t = camera.R_cam_board, camera.t_cam_board
    views = tuple(View(f"photo_{i:02d}.jpg", 35 - i % 3, 0.11 + 0.03 * rng.random(), R, t) for i in range(1, 13))
    sigma = {"fx": 0.42, "fy": 0.43, "cx": 0.31, "cy": 0.35, "k1": 0.0006, "k2": 0.0031}
    calibration = Calibration(
        (width, height), "k1k2", camera.K, (0.0803, -0.1624), sigma, 0.1274, views,
        (Warning_("few_views", "12 photos: 15 or more would halve the standard deviations."),),
    )  # fmt: skip
    far = tuple(x + 0.0011 for x in t)
    pose = PoseReport("photo_03.jpg", 35, Pose(R, far, 0.52), Pose(R, t, 0.118), 0.084, 0.0019, 7.3, (12,))
    truth = (
        TruthRow("fx", camera.fx - 0.31, camera.fx, 0.42, "px"),
        TruthRow("cx", camera.cx + 0.2, camera.cx, 0.31, "px"),
        TruthRow("rotation off by", 0.0, 0.0123, None, "degrees"),
    )
    times = (Timing("calibrate", 2.31, "rms 0.127 px"), *result.times)
    return Result(
        scene, result.comparison, result.subject, result.twin, photo, augment(photo, scene, result.subject),
        calibration, pose, truth, times, result.settings, result.versions,
    )  # fmt: skip
