"""Images as pictures for the page: exposed, coloured, compressed into data URLs."""

import math

import numpy as np

from raytwin.compare import error_map, error_scale
from raytwin.images.image import Image, Surface
from raytwin.images.packing import MOST_PIXELS, binned
from raytwin.images.photo_files import data_url, to_bytes

MARKS = 300
"""Most pixels that get a ring drawn around them."""
TILE = 32
"""Side in pixels of the squares of which each gives at most one worst pixel."""


def exposure(image: Image) -> float:
    """The gain that maps the 99.5 % quantile of the brightest channel to white; 1 for a black image."""
    # 250 000 pixels are enough for this quantile, however many there are.
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
        return to_bytes(image.mean * np.float32(gain))


FAINT = 10.0
"""Multiple of the tolerance that gets the full colour at the least, so that allowed errors stay pale."""


def small_pictures(
    test: Image, reference: Image, tolerance: float, widest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sRGB uint8 of the test, of its reference, exposed alike, and of their difference.

    At most about `widest` pixels across. The difference is averaged over blocks, which reduces noise.
    """
    step = max(1, -(-test.shape[1] // widest))
    gain = exposure(reference if reference.mean.any() else test)
    shown = [exposed(image, gain)[::step, ::step] for image in (test, reference)]
    test, reference = (binned(Image(image.mean), step) for image in (test, reference))
    scale = max(FAINT * tolerance, error_scale(test, reference))
    return shown[0], shown[1], to_bytes(error_map(test, reference, scale=scale))


# ------------------------------------------------------------------------------------------ pixels worth a look


def worst_pixels(error: np.ndarray, count: int) -> list[tuple[int, int]]:
    """(x, y) of the largest |error| of `count` tiles, worst first, so that one bad edge does not fill the list.

    A missing error (NaN) is worse than any other; exact agreement is not listed.
    """
    size = np.where(np.isfinite(error), np.abs(error), np.float32(np.inf))
    rows, columns = range(0, error.shape[0], TILE), range(0, error.shape[1], TILE)
    by_row = np.maximum.reduceat(size, rows, axis=0)
    tiles = np.maximum.reduceat(by_row, columns, axis=1)
    found = []
    for i in np.argsort(-tiles, axis=None, kind="stable")[:count]:
        r, c = (int(k) * TILE for k in np.unravel_index(i, tiles.shape))
        part = size[r : r + TILE, c : c + TILE]
        y, x = np.unravel_index(int(part.argmax()), part.shape)
        if part[y, x] > 0:
            found.append((c + int(x), r + int(y)))
    return found


def mismatches(test: Surface, reference: Surface) -> list[tuple[int, int]]:
    """(x, y) of the first MARKS pixels whose centre sees another object, top to bottom."""
    flat = np.flatnonzero(test.ids != reference.ids)[:MARKS]
    return [(int(i) % test.ids.shape[1], int(i) // test.ids.shape[1]) for i in flat]


# ------------------------------------------------------------------------------------------ compressed


def png_url(pixels: np.ndarray) -> str:
    """Return sRGB uint8 (H, W, 3) as a PNG in a data URL."""
    return data_url(np.ascontiguousarray(pixels), "png", compress_level=1)


def small_jpeg(pixels: np.ndarray, most_pixels: int = MOST_PIXELS) -> tuple[str, str]:
    """Return (data URL, a note) of sRGB uint8 (h, w, 3), made smaller if it has more than `most_pixels`.

    As a JPEG: sensor noise would make a PNG of several megabytes.
    """
    n, note = math.ceil(math.sqrt(pixels.shape[0] * pixels.shape[1] / most_pixels)), "JPEG"
    if n > 1:
        from PIL import Image as Pillow

        pixels, note = np.asarray(Pillow.fromarray(pixels).reduce(n)), f"JPEG, 1/{n} of its width and height"
    return data_url(pixels, "jpeg", quality=87), note
