"""The figures of the explanations, made by raytwin itself when the site is built.

A page says `<!-- figure: NAME: caption -->`; `docs/hooks.py` puts the picture there once it is made. To add one, write
a function that writes its file into a folder, and its row in FIGURES.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from gallery import MADE, run
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

import raytwin
from raytwin import twin
from raytwin.files.photo_files import to_bytes
from raytwin.image import Image
from raytwin.rungs import RUNGS

FOLDER = MADE / "figures"
WIDTH, HEIGHT = 240, 180
"""Of one picture of a strip, pixels."""
TITLE = 22
"""Height of the line above each picture, pixels."""
INK, PAPER = (40, 44, 52), (255, 255, 255)


def scene_of(name: str, width: int = WIDTH) -> raytwin.Scene:
    """Return a built-in scene at the figures' width."""
    scene = raytwin.read_scene(f"scenes/{name}").scene
    return scene.with_camera(scene.camera.resized(width, width * HEIGHT // WIDTH))


def strip(panels: Sequence[tuple[str, np.ndarray]], path: Path) -> None:
    """Write pictures (bytes, (H, W, 3)) side by side, each below its title."""
    canvas = Picture.new("RGB", (len(panels) * (WIDTH + 8) - 8, HEIGHT + TITLE), PAPER)
    pen, font = ImageDraw.Draw(canvas), ImageFont.load_default(14)
    for column, (title, pixels) in enumerate(panels):
        canvas.paste(Picture.fromarray(pixels), (column * (WIDTH + 8), TITLE))
        pen.text((column * (WIDTH + 8), 2), title, fill=INK, font=font)
    canvas.save(path, quality=85)


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


FIGURES: dict[str, tuple[str, Callable[[Path], None]]] = {
    "levels": ("levels.webp", levels),
    "static-and-shape": ("static-and-shape.webp", static_and_shape),
    "solvers": ("solvers.svg", solvers),
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
