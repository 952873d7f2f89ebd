"""Mitsuba files whose film has a crop window."""

from pathlib import Path
from xml.etree import ElementTree as ET

from raytwin.scene import MitsubaScene
from raytwin.scene.mitsuba_file import _film, _with_film


def with_window(scene: MitsubaScene, x: int, y: int, width: int, height: int) -> MitsubaScene:
    """The scene that shows this part of its image alone, from pixel (x, y) on."""
    film = _film(Path(scene.file), ET.fromstring(scene.text))
    window = {"crop_offset_x": film["crop_offset_x"] + x, "crop_offset_y": film["crop_offset_y"] + y}
    return _with_film(scene, film | window | {"crop_width": width, "crop_height": height})
