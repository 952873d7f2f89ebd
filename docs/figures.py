"""The figures of the explanations, made by raytwin itself when the site is built.

A page says `<!-- figure: NAME: caption -->`; `docs/hooks.py` puts the picture there once it is made. To add one, write
a function that writes its file into a folder, and its row in FIGURES.
"""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from gallery import MADE, run
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

import raytwin
from raytwin import twin
from raytwin.images.image import Image
from raytwin.images.photo_files import to_bytes
from raytwin.rungs import RUNGS
from raytwin.show.charts.chart import Point, family_chart, svg_text

FOLDER = MADE / "figures"
WIDTH, HEIGHT = 240, 180
"""Of one picture of a strip, pixels."""
TITLE = 22
"""Height of the line above each picture, pixels."""
INK, PAPER = (40, 44, 52), (255, 255, 255)
COLOURS = "#0f8b8d", "#e07b00", "#7a3e9d"
"""Of a chart's lines; told apart by the colour-blind, and readable on white."""


def scene_of(name: str, width: int = WIDTH) -> raytwin.Scene:
    """Return a built-in scene at the figures' width."""
    scene = raytwin.read_scene(f"scenes/{name}")
    return scene.with_camera(scene.camera.resized(width, width * HEIGHT // WIDTH))


def strip(panels: Sequence[tuple[str, np.ndarray]], path: Path) -> None:
    """Write pictures (bytes, (H, W, 3)) side by side, each below its title."""
    canvas = Picture.new("RGB", (len(panels) * (WIDTH + 8) - 8, HEIGHT + TITLE), PAPER)
    pen, font = ImageDraw.Draw(canvas), ImageFont.load_default(14)
    for column, (title, pixels) in enumerate(panels):
        canvas.paste(Picture.fromarray(pixels), (column * (WIDTH + 8), TITLE))
        pen.text((column * (WIDTH + 8), 2), title, fill=INK, font=font)
    canvas.save(path, quality=85)


def draw_lines(rows: Sequence[tuple[str, float, float]], x: str, y: str, title: str, path: Path) -> None:
    """Write a chart of rows (line, x, y) with logarithmic axes; each line is named at its end."""
    lines = list(dict.fromkeys(line for line, _, _ in rows))
    last = {line: (a, b) for line, a, b in rows}
    points = [
        Point(a, b, line, line, COLOURS[lines.index(line)], strong=True, label=line if last[line] == (a, b) else "")
        for line, a, b in rows
    ]
    path.write_text(svg_text(family_chart(path.stem, title, x, y, points, floor=None)))


def in_sigmas(test: Image, reference: Image, most: float = 4.0) -> np.ndarray:
    """Return (t - r) / sigma of the green channel: blue too dark, red too bright, white equal; bytes (H, W, 3)."""
    sigma = np.sqrt(sum(image.variance[..., 1] for image in (test, reference) if image.variance is not None))
    z = np.clip((test.mean - reference.mean)[..., 1] / np.where(sigma > 0, sigma, 1) / most, -1, 1)
    fade = 1 - np.abs(z)
    red, blue = np.where(z > 0, 1, fade), np.where(z < 0, 1, fade)
    return to_bytes(np.stack([red, fade, blue], axis=-1).astype(np.float32))


def levels(folder: Path) -> None:
    """Every light level of one scene, by the twin."""
    scene = scene_of("overlap")
    made = [(name, twin.render(scene, name, samples=256, sampling="area")) for name in RUNGS]
    strip([(name, to_bytes(image.mean)) for name, image in made], folder / "levels.webp")


def static_and_shape(folder: Path) -> None:
    """The difference of two renders in sigmas: a correct one, one 2 % too bright, one without the last bounce."""
    scene = scene_of("overlap")
    reference = twin.render(scene, "path", samples=256, seed=1, max_depth=4)
    right = twin.render(scene, "path", samples=64, seed=2, max_depth=4)
    bright = Image(right.mean * np.float32(1.02), right.variance, right.samples)
    shallow = twin.render(scene, "path", samples=64, seed=2, max_depth=3)
    panels = [("the render", to_bytes(right.mean)), ("nothing wrong", in_sigmas(right, reference))]
    panels += [("2 % too bright", in_sigmas(bright, reference)), ("a bounce missing", in_sigmas(shallow, reference))]
    strip(panels, folder / "static-and-shape.webp")


def solvers(folder: Path) -> None:
    """The atlas's chart of a far sphere: error over distance, by solver."""
    if run("stability sphere-far -o out", folder):
        raise SystemExit("figures: stability failed")
    (folder / "out" / "sphere-far.svg").rename(folder / "solvers.svg")
    shutil.rmtree(folder / "out")


def noise(folder: Path) -> None:
    """Error and stated sigma of one scene's renders over samples: both fall with their root."""
    scene = scene_of("overlap", 96)
    exact = twin.render(scene, "path", samples=4096, seed=1, max_depth=3).mean
    rows = []
    for samples in (4, 16, 64, 256):
        image = twin.render(scene, "path", samples=samples, seed=2, max_depth=3)
        assert image.variance is not None
        rmse, sigma = np.sqrt(np.mean((image.mean - exact) ** 2)), np.sqrt(image.variance.mean())
        rows.append(("error against 4096 samples", samples, float(rmse)))
        rows.append(("sigma, as the render states it", samples, float(sigma)))
    draw_lines(rows, "samples", "error", "overlap: error and stated noise", folder / "noise.svg")


def limits(folder: Path) -> None:
    """The largest |z| of a correct pair, and the limit at a false-alarm rate of 1e-3, over the number of pixels."""
    from scipy.stats import norm

    rng, rows = np.random.default_rng(0), []
    for pixels in (100, 1000, 10_000, 100_000, 1_000_000):
        largest = [float(np.abs(rng.standard_normal(pixels)).max()) for _ in range(20)]
        limit = float(norm.isf(-np.expm1(np.log1p(-1e-3) / pixels) / 2))
        rows.append(("largest |z| by chance", pixels, float(np.median(largest))))
        rows.append(("limit for 1 alarm in 1000 images", pixels, limit))
        rows.append(("a fixed limit of 3 sigma", pixels, 3.0))
    title = "How far the worst pixel of a correct image lies off"
    draw_lines(rows, "pixels", "sigmas", title, folder / "limits.svg")


def stopping(folder: Path) -> None:
    """Difference of the mean over samples, for a right render and one 2 % too bright, beside what a look can see."""
    from scipy.stats import norm

    from raytwin.compare.sequential import look_level, look_number

    rng, rows, right, bright = np.random.default_rng(3), [], 0.0, 0.0
    sigma, taken = 0.02, 0
    for samples in (4, 8, 16, 32, 64, 128, 256):
        fresh = samples - taken
        right += float(rng.normal(0, sigma * np.sqrt(fresh)))
        bright += float(rng.normal(0.02 * fresh, sigma * np.sqrt(fresh)))
        taken = samples
        seen = norm.isf(look_level(1e-3, look_number(samples)) / 2) * sigma / np.sqrt(samples)
        rows.append(("a correct render", samples, abs(right) / samples))
        rows.append(("one 2 % too bright", samples, abs(bright) / samples))
        rows.append(("what this look fails", samples, float(seen)))
    draw_lines(rows, "samples", "difference of the mean", "When a difference is certain", folder / "stopping.svg")


FIGURES: dict[str, tuple[str, Callable[[Path], None]]] = {
    "levels": ("levels.webp", levels),
    "static-and-shape": ("static-and-shape.webp", static_and_shape),
    "solvers": ("solvers.svg", solvers),
    "noise": ("noise.svg", noise),
    "limits": ("limits.svg", limits),
    "stopping": ("stopping.svg", stopping),
}
"""Name in a page -> (file, the function that writes it)."""


def make() -> None:
    """Make the figures that are not there yet."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for file, write in FIGURES.values():
        if not (FOLDER / file).exists():
            write(FOLDER)


if __name__ == "__main__":
    make()
