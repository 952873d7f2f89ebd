"""Makes sky.exr: L(d) = a + b z + c z² + Σ e exp(κ (d·m - 1)), a soft sky and three lamps, without a sun.

`python scenes/studio/sky.py` writes it anew. The map's middle looks along +y; see scenes/README.md.
"""

from pathlib import Path

import numpy as np

from raytwin.images.image import Image
from raytwin.images.image_formats import write_image

GRADIENT = np.array(((0.26, 0.27, 0.30), (0.10, 0.14, 0.24), (0.04, 0.05, 0.08)))
"""a, b, c of each channel."""
LAMPS = (
    ((-0.45, 0.85, 0.27), 25.0, (3.6, 2.6, 1.4)),  # warm and large, behind the balls on the left
    ((0.35, 0.9, 0.26), 60.0, (1.2, 2.6, 4.8)),  # cool and smaller, behind them on the right
    ((0.4, -0.7, 0.6), 20.0, (3.0, 3.0, 3.0)),  # white, behind the camera
)
"""Direction (made unit), κ and e of each."""


def radiance(d: np.ndarray) -> np.ndarray:
    """(..., 3) along the unit directions d (..., 3)."""
    z = d[..., 2:]
    a, b, c = GRADIENT
    found = a + b * z + c * z * z
    for m, kappa, e in LAMPS:
        found = found + np.exp(kappa * (d @ (np.array(m) / np.linalg.norm(m)) - 1))[..., None] * e
    return np.asarray(found)


def make(rows: int = 32) -> np.ndarray:
    """The map (rows, 2 rows, 3): the radiance along each pixel's centre, as half floats hold it."""
    v, u = np.mgrid[:rows, : 2 * rows] + 0.5
    theta, turn = v * np.pi / rows, (u / rows - 1) * np.pi
    d = np.stack([np.sin(theta) * np.sin(turn), np.sin(theta) * np.cos(turn), np.cos(theta)], axis=-1)
    return radiance(d).astype(np.float16).astype(np.float32)


if __name__ == "__main__":
    write_image(Path(__file__).with_name("sky.exr"), Image(make(), samples=0))
