"""The boxes that trim the work, drawn into a photo as in the paper's figure 6."""

import numpy as np

from raytwin.array_types import UInt8
from raytwin.fast import trim_boxes
from raytwin.scene import Scene

COLOUR = (255, 64, 64)
"""sRGB."""


def draw_boxes(photo: UInt8[np.ndarray, "h w 3"], scene: Scene) -> UInt8[np.ndarray, "h w 3"]:
    """Return the photo with the outline of each sphere's trim box, a 400th of its width thick."""
    import cv2

    out = np.ascontiguousarray(photo).copy()
    for x0, y0, x1, y1 in trim_boxes(scene.spheres, scene.camera).tolist():
        if x0 < x1:
            cv2.rectangle(out, (x0, y0), (x1 - 1, y1 - 1), COLOUR, max(1, round(out.shape[1] / 400)))
    return out
