"""A scene that only Mitsuba's file knows: raytwin keeps its text and what identifies it, and models nothing of it."""

import hashlib
from xml.etree.ElementTree import canonicalize

import msgspec

from raytwin.scene.record_base import PixelCount, Record
from raytwin.scene.scene import Tolerance


class MitsubaScene(Record, frozen=True):
    """A Mitsuba XML file, read and checked: what stands for a Scene where any renderer's scene will do.

    `text`: the file's elements with includes and parameters put in and an id for each shape; `names`: these ids, in the
    file's order. `file`: what a program is given. `folder`: where the names of `files` start; `files`: every file that
    the text names, with its SHA-256. `image_size` is the film's.
    """

    name: str
    file: str
    text: str
    folder: str
    image_size: tuple[PixelCount, PixelCount]
    names: tuple[str, ...] = ()
    files: dict[str, str] = msgspec.field(default_factory=dict)
    tolerance: Tolerance = Tolerance()

    @property
    def digest(self) -> str:
        """SHA-256 of the text and of the contents of every file that it names, 32 hexadecimal digits."""
        text = canonicalize(self.text, strip_text=True)
        return hashlib.sha256(msgspec.json.encode((text, sorted(self.files.items())))).hexdigest()[:32]
