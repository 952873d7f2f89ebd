"""light.toml: a photo's light as `[sun]` and `[sky]` of a scene, and beside it how well it is known.

    [sun]                       # as in scene.toml
    to_light = [0.44, 0.34, 0.83]
    irradiance = [3.1, 2.9, 2.7]

    [sky]
    radiance = [0.30, 0.32, 0.36]       # or map = "light.exr"

    [sigma]                     # one standard deviation
    sun_degrees = 0.4
    irradiance = [0.09, 0.08, 0.08]
    radiance = [0.01, 0.01, 0.01]       # of a map: of the constant sky that lights level paper as much

    [paper]
    albedo = 0.85               # assumed
    color = [1.01, 1.0, 0.98]   # radiance of white paper in full light, of luminance 1

Radiance is relative to the board's white paper: a photo's exposure is what that paper has in it.
"""

import os
from pathlib import Path

import msgspec
import numpy as np

from raytwin.images.image import Image
from raytwin.images.image_formats import write_image
from raytwin.photos.boards.board import PAPER, Board
from raytwin.photos.lighting.light_models import Light
from raytwin.photos.lighting.linear_photo import read_linear
from raytwin.scene import Camera, Radiance, Record, Scene, Sky, Sun
from raytwin.scene.record_base import Fraction, NonNegative
from raytwin.scene.scene import NO_SUN
from raytwin.scene.scene_files import read_sky_map
from raytwin.scene.toml_json import read_toml, to_record, write_toml


class LightSigma(Record, frozen=True):
    sun_degrees: NonNegative = 0.0
    irradiance: Radiance = (0.0, 0.0, 0.0)
    radiance: Radiance = (0.0, 0.0, 0.0)


class Paper(Record, frozen=True):
    albedo: Fraction
    color: Radiance


class WrittenLight(Record, frozen=True):
    """A light.toml: see above."""

    sky: Sky
    paper: Paper
    sun: Sun = NO_SUN
    sigma: LightSigma = LightSigma()

    def on(self, scene: Scene) -> Scene:
        """Return the scene under this light."""
        return msgspec.structs.replace(scene, sun=self.sun, sky=self.sky)


def read_light(path: str | os.PathLike) -> WrittenLight:
    file = Path(path)
    data = read_toml(file)
    read_sky_map(file, data)
    return to_record(file, data, WrittenLight)


def write_light(path: str | os.PathLike, light: Light, paper: np.ndarray, comment: str = "") -> None:
    """Write the file, and its map beside it under the same name as EXR."""
    path = Path(path)
    table: dict = {}
    if light.to_light is not None:
        table["sun"] = {"to_light": light.to_light.tolist(), "irradiance": light.E.tolist()}
    if light.around is not None:
        write_image(path.with_suffix(".exr"), Image(light.around, samples=0))
        table["sky"] = {"map": path.with_suffix(".exr").name}
    else:
        table["sky"] = {"radiance": light.Ls.tolist()}
    table["sigma"] = {
        "sun_degrees": float(np.degrees(light.sigma)), "irradiance": light.E_sd.tolist(),
        "radiance": light.Ls_sd.tolist(),
    }  # fmt: skip
    table["paper"] = {"albedo": PAPER, "color": paper.tolist()}
    write_toml(path, table, comment)


def photo_exposure(path: str | os.PathLike, camera: Camera, board: Board, light: WrittenLight) -> np.ndarray:
    """Return the photo's linear value of radiance 1 (H, W, 3), by its white paper and the lens's falloff."""
    return read_linear(Path(path), camera, board).value_of_one(np.array(light.paper.color))
