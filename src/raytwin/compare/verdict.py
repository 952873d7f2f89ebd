"""compare(test, reference): hard failures, then geometry, then radiance; one verdict and its reasons in words."""

import time

import msgspec
import numpy as np

from raytwin.compare.comparison import Comparison, Geometry, Radiance, Statistics
from raytwin.compare.metrics import METRICS
from raytwin.image import Image
from raytwin.scene import Tolerance


def compare(
    test: Image,
    reference: Image,
    *,
    tolerance: Tolerance = Tolerance(),  # noqa: B008 (frozen)
    scene: str = "",
    rung: str = "",
    false_alarm_rate: float = 1e-3,
    flip: bool = False,
) -> Comparison:
    """The verdict on `test` against `reference`, and every number behind it."""
    start = time.perf_counter()
    reasons = []
    if test.mean.shape != reference.mean.shape:
        return Comparison(scene, rung, "fail", (f"the shape is {test.mean.shape}, not {reference.mean.shape}",))
    if bad := int(np.count_nonzero(~np.isfinite(test.mean))):
        reasons.append(f"{bad} values are not finite")
    numbers = {n: METRICS[n].function(test.mean, reference.mean) for n in Radiance.__struct_fields__}
    radiance = Radiance(**{n: x if np.isfinite(x) else None for n, x in numbers.items()})
    mismatch = None
    if test.surface is not None and reference.surface is not None:
        mismatch = int(np.count_nonzero(test.surface.ids != reference.surface.ids))
        if mismatch > tolerance.mask_pixels:
            reasons.append(f"{mismatch} silhouette pixels differ")
    if radiance.p999_abs is None or radiance.p999_abs > tolerance.p999_abs:
        reasons.append(f"the 99.9 % quantile of the absolute error is {radiance.p999_abs}")
    made = Comparison(
        scene, rung, "fail" if reasons else "pass", tuple(reasons), Geometry(mismatch), radiance, Statistics()
    )
    return msgspec.structs.replace(made, seconds={**made.seconds, "compare": time.perf_counter() - start})
