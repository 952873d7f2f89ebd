"""Rounding as the cause: the tracer in single precision, or with a solver that cancels, shows the same errors."""

import numpy as np

from raytwin.compare.finding import Finding
from raytwin.errors import MachineError
from raytwin.explain.pixel_sample import MAX_PIXELS_UNTHINNED
from raytwin.fast import trace
from raytwin.images.image import Image
from raytwin.rungs import RUNGS
from raytwin.scene import Scene
from raytwin.tracer import RADIANCE

SHARE_BY_ROUNDING = 0.9
"""Share of the squared error that the same rounding has to explain."""
HOW = {
    ("numpy32", "robust"): "single precision (float32)",
    ("numpy64", "textbook"): "the textbook quadratic, whose b² - 4ac cancels",
    ("numpy32", "textbook"): "the textbook quadratic in single precision (float32), whose b² - 4ac cancels",
    ("numpy32", "paper"): "the paper's quadratic in single precision (float32)",
    ("numpy32", "stable"): "the stable quadratic in single precision (float32)",
}
"""Engine and solver, in the order of trial."""


def rounding_cause(test: Image, reference: Image, scene: Scene, rung: str) -> tuple[Finding, ...]:
    """Which rounding has made the errors of the test; nothing where none explains them."""
    if rung not in RADIANCE or not RUNGS[rung].lit or reference.variance is not None or not scene.objects:
        return ()
    if test.mean.shape != reference.mean.shape or not np.isfinite(test.mean).all():
        return ()
    step = int(np.ceil(np.sqrt(scene.camera.width * scene.camera.height / MAX_PIXELS_UNTHINNED)))
    thin = scene.with_camera(scene.camera.every(step))
    off = (test.mean[::step, ::step] - reference.mean[::step, ::step]).astype(float)
    before = float(np.square(off).sum())
    if not before:
        return ()
    exact = trace(thin, rung).mean
    for (engine, solver), how in HOW.items():
        try:
            rounded = trace(thin, rung, engine, solver).mean
        except MachineError:
            continue
        if np.square(off - (rounded.astype(float) - exact)).sum() < (1 - SHARE_BY_ROUNDING) * before:
            return (Finding("rounding", f"rounding: {how}; float64 and the robust solver keep the digits"),)
    return ()
