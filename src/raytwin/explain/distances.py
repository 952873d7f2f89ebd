"""Depths that are off by one formula: the points of unit rays' t on rays that are not unit, and what is like it."""

import numpy as np

from raytwin.explain.catalogue import FAULTS
from raytwin.explain.predict import NO_MISTAKE, written
from raytwin.images.image import BACKGROUND, Surface
from raytwin.scene import Scene

FEWEST_PIXELS_TO_AGREE = 10
"""Pixels that have to show the ratio."""
RATIO_WITHIN = 1e-4
"""Relative: how far the ratio may be from the formula, at 99.9 % of the pixels."""
VARIES_BY = 1e-3
"""Relative: how much the formula has to differ from 1."""
ALONG_AXIS = "depths are measured along the camera's axis, z: t along the unit ray is z · √(x² + y² + 1)"


def depth_cause(test: Surface | None, reference: Surface | None, scene: Scene) -> str:
    """What makes all depths wrong by one formula of the pixel's place (x, y, 1); empty where nothing does."""
    if test is None or reference is None or test.ids.shape != reference.ids.shape:
        return ""
    v, u = np.nonzero((test.ids == reference.ids) & (test.ids != BACKGROUND) & (reference.depth > 0))
    if len(u) < FEWEST_PIXELS_TO_AGREE:
        return ""
    K, dist = np.array(scene.camera.K), np.array(scene.camera.coefficients, float)
    stretch = 1 / written(NO_MISTAKE)["through"](K, dist, u.astype(float), v.astype(float))[:, 2]
    ratio = test.depth[v, u].astype(float) / reference.depth[v, u]
    other = next(fault.sentence for fault in FAULTS if fault.name == "t-of-other-rays")
    unit = float(np.median(ratio))
    whole = f"all depths are {unit:.4g} times what they should be: t is in metres, along the unit ray"
    for formula, words in (
        (stretch, f"depth / reference = √(x² + y² + 1): {other}"),
        (1 / stretch, ALONG_AXIS),
        (np.full_like(ratio, unit), whole),
    ):
        off = np.abs(ratio / formula - 1)
        if np.abs(formula - 1).max() > VARIES_BY and np.quantile(off, 0.999) < RATIO_WITHIN:
            return words
    return ""
