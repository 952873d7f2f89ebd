"""How near drawn photos come to photos in which the objects really are, in codes of 8 bits by region.

python -m measure.draw_regions DRAWN PHOTO TRUE     # three pictures that scenes/desk/lit.toml's camera took
"""

import argparse
from pathlib import Path

import numpy as np

from raytwin.fast import trace
from raytwin.images.photo_files import from_bytes, read_photo
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene


def codes_by_region(drawn: np.ndarray, photo: np.ndarray, true: np.ndarray, scene: Scene) -> dict[str, float]:
    """Mean absolute error of `drawn` (H, W, 3) in 8-bit steps: of drawn objects, of the shadows that were drawn on what
    the photo shows, of the rest, and of all. `scene.camera` took the photo. A region without pixels is left out."""
    surface = trace(scene, "surface", "numpy32").surface
    assert surface is not None
    over = np.array([*(not thing.in_photo for thing in scene.objects), False])[surface.ids]
    # A code is 1e-3 of white or more: what JPEG changes in ink is no shadow.
    shadows = ~over & (from_bytes(drawn) + 0.02 < 0.9 * (from_bytes(photo) + 0.02)).any(axis=-1)
    regions = {"objects": over, "shadows": shadows, "rest": ~over & ~shadows, "all": np.ones_like(over)}
    off = np.abs(drawn.astype(int) - true).mean(axis=-1)
    return {name: float(off[mask].mean()) for name, mask in regions.items() if mask.any()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pictures", type=Path, nargs=3)
    scene = read_scene(Path(__file__).parents[2] / "scenes" / "desk" / "lit.toml")
    pictures = (read_photo(path) for path in parser.parse_args().pictures)
    for name, codes in codes_by_region(*pictures, scene).items():
        print(f"{name:<8} {codes:.2f}")


if __name__ == "__main__":
    main()
