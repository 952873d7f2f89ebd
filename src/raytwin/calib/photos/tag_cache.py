"""Tags found in photos, kept between runs: a photo of the same bytes is not searched again by the same detector."""

import contextlib
import hashlib
import os
from itertools import pairwise
from pathlib import Path

import msgspec

from raytwin import files
from raytwin.calib.photos import detection
from raytwin.calib.photos.detection import Tag, detect_photo

LIMIT = 64 << 20
"""Bytes in all: some ten thousand photos."""
LARGEST = 4 << 20
"""Bytes of one file; ten thousand tags take less."""
MADE_BY = Path(detection.__file__), Path(files.photo_files.__file__)
PACKAGES = "pupil-apriltags", "opencv-contrib-python-headless", "pillow", "numpy"


def detect_photo_once(path: str | os.PathLike, kind: str) -> list[Tag]:
    """`detect_photo`, or what it found in these very bytes before. A photo without tags is searched every time."""
    with contextlib.suppress(OSError):
        file = path_of(files.check_file(path, "a photo (JPEG or PNG)").read_bytes(), kind)
        if not files.is_plain(file):
            return detect_photo(path, kind)
        if tags := _load(file, files.photo_size(path)):
            return tags
        found = detect_photo(path, kind)
        _store(file, found)
        return found
    return detect_photo(path, kind)  # and say what cannot be read


def path_of(photo: bytes, kind: str) -> Path:
    """Where the tags of that kind in a photo of these bytes are kept."""
    digest = hashlib.sha256(repr((files.made_by(MADE_BY, PACKAGES), kind)).encode() + photo)
    return files.cache_folder() / "tags" / f"{digest.hexdigest()[:40]}.json"


def _load(path: Path, size: tuple[int, int]) -> list[Tag] | None:
    """The tags kept in a file, if they are what could be found in a photo of that size (width, height)."""
    try:
        if path.stat().st_size > LARGEST:
            return None
        tags = msgspec.json.decode(path.read_bytes(), type=list[Tag])
    except (OSError, ValueError, RecursionError):
        return None
    if not all(_is_sound(tag, size) for tag in tags) or any(a.id >= b.id for a, b in pairwise(tags)):
        return None
    files.mark_used(path)
    return tags


def _is_sound(tag: Tag, size: tuple[int, int]) -> bool:
    """Of four corners, and within the frame; NaN is not."""
    inside = all(-0.5 <= c <= n - 0.5 for point in (tag.center, *tag.corners) for c, n in zip(point, size, strict=True))
    return len(tag.corners) == 4 and tag.id >= 0 and inside


def _store(path: Path, tags: list[Tag]) -> None:
    """Keep the tags; a cache that cannot be written is no error."""
    files.keep(path, lambda to: to.write_bytes(msgspec.json.encode(tags)), LIMIT)
