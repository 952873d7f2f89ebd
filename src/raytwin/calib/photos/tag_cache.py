"""Tags found in photos, cached between runs: the same detector does not search a photo of the same bytes again."""

import contextlib
import hashlib
import os
from pathlib import Path

import msgspec

from raytwin import files
from raytwin.calib.photos import detection
from raytwin.calib.photos.detection import Tag, detect_photo

CACHE = files.Cache("tags", ".json", 64 << 20)
"""Some ten thousand photos."""
MADE_BY = Path(detection.__file__), Path(files.photo_files.__file__)
PACKAGES = "pupil-apriltags", "opencv-contrib-python-headless", "pillow", "numpy"


def detect_photo_once(path: str | os.PathLike, kind: str) -> list[Tag]:
    """`detect_photo`, or what it found in these very bytes before. A photo without tags is searched every time."""
    with contextlib.suppress(OSError):
        key = key_of(files.check_file(path, "a photo (JPEG or PNG)").read_bytes(), kind)
        if tags := CACHE.load(key, lambda file: msgspec.json.decode(file.read_bytes(), type=list[Tag])):
            return tags
        found = detect_photo(path, kind)
        CACHE.store(key, lambda to: to.write_bytes(msgspec.json.encode(found)))
        return found
    return detect_photo(path, kind)  # and say what cannot be read


def key_of(photo: bytes, kind: str) -> str:
    """The name of the tags of that kind in a photo of these bytes."""
    return hashlib.sha256(repr((files.made_by(MADE_BY, PACKAGES), kind)).encode() + photo).hexdigest()[:40]
