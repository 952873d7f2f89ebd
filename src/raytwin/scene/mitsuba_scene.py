"""A scene that only Mitsuba's file knows: raytwin keeps what identifies it, and models nothing of it."""

import hashlib

import msgspec

from raytwin.scene.record_base import PixelCount, Record
from raytwin.scene.scene import Tolerance


class MitsubaScene(Record, frozen=True):
    """A Mitsuba XML file: what stands for a Scene where any renderer's scene will do.

    `file`: what Mitsuba and other programs are given. `image_size` is the film's, or the one that is asked for.
    `files`: the file and every one that it names, relative to its folder, with their SHA-256; an XML file's leaves
    comments out. `names`: of its shapes, in Mitsuba's order, once Mitsuba has loaded it (`twin.named_shapes`).
    """

    name: str
    file: str
    image_size: tuple[PixelCount, PixelCount]
    files: dict[str, str]
    names: tuple[str, ...] = ()
    tolerance: Tolerance = Tolerance()

    @property
    def digest(self) -> str:
        """SHA-256 of the contents of all files and of the image's size, 32 hexadecimal digits."""
        return hashlib.sha256(msgspec.json.encode((sorted(self.files.items()), self.image_size))).hexdigest()[:32]
