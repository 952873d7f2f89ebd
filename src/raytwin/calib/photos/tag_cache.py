"""Tags found in photos, cached between runs: the same detector does not search a photo of the same bytes again."""

import contextlib
import hashlib
import os
from itertools import pairwise
from pathlib import Path

import msgspec

from raytwin import files
from raytwin.calib.photos import detection
from raytwin.calib.photos.detection import Tag, detect_photo

CACHE = files.Cache("tags", ".json", 64 << 20)
"""Some ten thousand photos."""
LARGEST = 4 << 20
"""Bytes of one file; ten thousand tags take less."""
MADE_BY = Path(detection.__file__), Path(files.photo_files.__file__)
PACKAGES = "pupil-apriltags", "opencv-contrib-python-headless", "pillow", "numpy"


def detect_photo_once(path: str | os.PathLike, kind: str) -> list[Tag]:
    """`detect_photo`, or what it found in these very bytes before. A photo without tags is searched every time."""
    with contextlib.suppress(OSError):
        key = key_of(files.check_file(path, "a photo (JPEG or PNG)").read_bytes(), kind)
        size = files.photo_size(path)
        if tags := CACHE.load(key, lambda file: _read(file, size)):
            return tags
        found = detect_photo(path, kind)
        CACHE.store(key, lambda to: to.write_bytes(msgspec.json.encode(found)))
        return found
    return detect_photo(path, kind)  # and say what cannot be read


def key_of(photo: bytes, kind: str) -> str:
    """The name of the tags of that kind in a photo of these bytes."""
    return hashlib.sha256(repr((files.made_by(MADE_BY, PACKAGES), kind)).encode() + photo).hexdigest()[:40]


def _read(path: Path, size: tuple[int, int]) -> list[Tag] | None:
    """The tags in a file, if they could be found in a photo of that size (width, height)."""
    if path.stat().st_size > LARGEST:
        return None
    tags = msgspec.json.decode(path.read_bytes(), type=list[Tag])
    in_order = all(a.id < b.id for a, b in pairwise(tags))
    return tags if in_order and all(_is_sound(tag, size) for tag in tags) else None


def _is_sound(tag: Tag, size: tuple[int, int]) -> bool:
    """Return whether the tag has four finite corners within the frame."""
    inside = all(-0.5 <= c <= n - 0.5 for point in (tag.center, *tag.corners) for c, n in zip(point, size, strict=True))
    return len(tag.corners) == 4 and tag.id >= 0 and inside
