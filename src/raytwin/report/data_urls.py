"""Images as pictures for the page: exposed, coloured, compressed into data URLs."""

import math
from dataclasses import dataclass

import numpy as np

from raytwin import files
from raytwin.compare import error_map, error_scale
from raytwin.image import Image, Surface

MARKS = 300
"""Most pixels that get a ring drawn around them."""


def exposure(image: Image) -> float:
    """The gain that maps the 99.5 % quantile of the brightest channel to white; 1 for a black image."""
    # A quarter of a million pixels tell the quantile of any number.
    every = max(1, math.isqrt(image.shape[0] * image.shape[1] // 250_000))
    r, g, b = np.moveaxis(image.mean[::every, ::every], -1, 0)
    brightest = np.maximum(np.maximum(r, g), b)
    brightest = brightest[np.isfinite(brightest)]
    white = float(np.quantile(brightest, 0.995)) if brightest.size else 0.0
    return 1 / white if white > 0 else 1.0


def stops(image: Image) -> float:
    """The same in stops, to two digits: what the viewer opens with."""
    return round(math.log2(exposure(image)), 2)


def exposed(image: Image, gain: float) -> np.ndarray:
    """sRGB uint8 of gain * radiance."""
    with np.errstate(invalid="ignore", over="ignore"):
        return files.to_bytes(image.mean * np.float32(gain))


# ------------------------------------------------------------------------------------------ signed error


@dataclass(frozen=True)
class Scale:
    """Which error gets which colour: 0 to `low` white, `high` and more the full colour; equal ratios or equal steps."""

    low: float
    high: float
    logarithmic: bool

    def position(self, error: np.ndarray) -> np.ndarray:
        """-1 to 1, where 1 is the full colour; NaN stays NaN."""
        size = np.abs(error)
        if self.logarithmic:
            decades = math.log10(self.high / self.low)
            share = np.log10(np.maximum(size, np.float32(self.low)) / np.float32(self.low)) / np.float32(decades)
        else:
            share = size / np.float32(self.high)
        return np.asarray(np.copysign(np.minimum(share, np.float32(1)), error))


def noisy(test: Image, reference: Image) -> bool:
    """One of the two has noise, so that a single error means little."""
    return test.variance is not None or reference.variance is not None


def choose_scale(test: Image, reference: Image, error: np.ndarray, tolerance: float) -> Scale:
    """Noise: equal steps up to its 99.9 % quantile; else decades, a hundredth of the tolerance to the worst."""
    if noisy(test, reference):
        return Scale(0.0, error_scale(test, reference), False)
    worst = float(np.max(np.abs(error), where=np.isfinite(error), initial=tolerance))
    low = 10.0 ** (math.floor(math.log10(tolerance)) - 2)
    return Scale(low, max(10.0 ** math.ceil(math.log10(worst) - 1e-9), 1e3 * low), True)


def palette() -> np.ndarray:
    """(256, 3) uint8: the colours of `compare.error_map` from -1 to 1 in 255 steps, and that of a missing error."""
    ramp = np.repeat(np.append(np.linspace(-1, 1, 255), np.nan).astype(np.float32)[None, :, None], 3, axis=-1)
    return np.asarray(files.to_bytes(error_map(Image(ramp), Image(np.zeros_like(ramp)), scale=1.0))[0])


def error_indices(error: np.ndarray, scale: Scale) -> np.ndarray:
    """(H, W) uint8 into `palette`."""
    position = scale.position(error)
    missing = np.isnan(position)
    indices: np.ndarray = np.rint(np.where(missing, np.float32(0), position) * 127 + 127).astype(np.uint8)
    indices[missing] = 255
    return indices


# ------------------------------------------------------------------------------------------ pixels worth a look


def worst_pixels(error: np.ndarray, count: int, tile: int = 32) -> list[tuple[int, int]]:
    """(x, y) of the largest |error| of as many tiles, worst first, so that one bad edge does not fill the list.

    A missing error (NaN) is worse than any other; exact agreement is not listed.
    """
    size = np.where(np.isfinite(error), np.abs(error), np.float32(np.inf))
    rows, columns = range(0, error.shape[0], tile), range(0, error.shape[1], tile)
    by_row = np.maximum.reduceat(size, rows, axis=0)
    tiles = np.maximum.reduceat(by_row, columns, axis=1)
    found = []
    for i in np.argsort(-tiles, axis=None, kind="stable")[:count]:
        r, c = (int(k) * tile for k in np.unravel_index(i, tiles.shape))
        part = size[r : r + tile, c : c + tile]
        y, x = np.unravel_index(int(part.argmax()), part.shape)
        if part[y, x] > 0:
            found.append((c + int(x), r + int(y)))
    return found


def worst_of_blocks(error: np.ndarray, side: int) -> np.ndarray:
    """Return the error farthest from 0 of each block of side x side, so that no wrong pixel is lost.

    What does not fill a block at the right and at the bottom is left out.
    """
    height, width = (n - n % side for n in error.shape)
    blocks = error[:height, :width].reshape(height // side, side, width // side, side)
    highest, lowest = blocks.max(axis=(1, 3)), blocks.min(axis=(1, 3))
    return np.where(highest >= -lowest, highest, lowest)


def mismatches(test: Surface, reference: Surface) -> list[tuple[int, int]]:
    """(x, y) of the first MARKS pixels whose centre sees another object, top to bottom."""
    flat = np.flatnonzero(test.ids != reference.ids)[:MARKS]
    return [(int(i) % test.ids.shape[1], int(i) // test.ids.shape[1]) for i in flat]


# ------------------------------------------------------------------------------------------ compressed


def png_url(pixels: np.ndarray, colours: np.ndarray | None = None) -> str:
    """sRGB uint8 (H, W, 3), or indices (H, W) into `colours` (256, 3), as a PNG in a data URL."""
    from PIL import Image as Pillow

    picture = Pillow.fromarray(np.ascontiguousarray(pixels))
    if colours is not None:
        picture.putpalette(colours.tobytes())
    return files.data_url(picture, "png", compress_level=1)


def jpeg_url(pixels: np.ndarray) -> str:
    """sRGB uint8 (H, W, 3) as a JPEG in a data URL: sensor noise would make a PNG of several megabytes."""
    return files.data_url(pixels, "jpeg", quality=87)


def changed(before: np.ndarray, after: np.ndarray) -> tuple[int, int, int, int]:
    """(x, y, width, height) of what differs between two pictures (H, W, 3), on JPEG's grid of 16; one cell if none."""
    differs = (before != after).any(axis=-1)
    rows, columns = (np.flatnonzero(differs.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return 0, 0, min(16, before.shape[1]), min(16, before.shape[0])
    (x, width), (y, height) = (
        (start := int(n[0]) // 16 * 16, min(-(-(int(n[-1]) + 1) // 16) * 16, side) - start)
        for n, side in ((columns, before.shape[1]), (rows, before.shape[0]))
    )
    return x, y, width, height


def picture_url(pixels: np.ndarray) -> tuple[str, bool]:
    """(data URL, whether it is lossless): PNG, or JPEG where noise makes a PNG of more than a byte a pixel."""
    url = png_url(pixels)
    if len(url) <= pixels.shape[0] * pixels.shape[1] + 200_000:
        return url, True
    return jpeg_url(pixels), False
