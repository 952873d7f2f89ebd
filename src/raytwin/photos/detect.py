"""AprilTags in a photo: pupil_apriltags, shifted by half a pixel into OpenCV's convention."""

import functools
import os
import threading
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import pupil_apriltags

from raytwin import files
from raytwin.errors import InputError
from raytwin.scene import Record

Progress = Callable[[int, int], None]
"""Called as progress(done, total) after every step."""

_lock = threading.Lock()


class NoTags(InputError):
    """The photo is sound, but shows no tag of the family that can be read."""


class Tag(Record, frozen=True):
    """A tag seen in a photo, in OpenCV's pixels: (0, 0) is the centre of the top-left pixel.

    `center` is where the tag's diagonals cross, the image of its centre; the mean of its corners is not, under
    perspective. `corners`: lower left, lower right, upper right, upper left of the upright tag. `margin` is how
    clearly the bits could be told apart (AprilTag's decision margin, in grey levels).
    """

    id: int
    center: tuple[float, float]
    corners: tuple[tuple[float, float], ...]
    margin: float


class _Detector(pupil_apriltags.Detector):
    """Kept for the life of the process, so never destroyed."""

    def __del__(self) -> None:
        # The library's own frees the tag family first, then reads it while destroying the detector: a crash at exit.
        pass


@functools.cache
def _detector(family: str) -> _Detector:
    return _Detector(family, nthreads=os.cpu_count() or 1, quad_decimate=1.0)


SEARCH_SIDE = 3000
"""Photos with a longer side are searched at half of it; edges are refined at full scale in any case.

Measured against known truth: the same error of the centres, a quarter of the time.
"""


def detect(pixels: np.ndarray, family: str = "tag36h11") -> list[Tag]:
    """The tags in a photo, sRGB uint8 (H, W, 3) or grey (H, W), by id.

    An id seen at two places says nothing about which is the board's: both are dropped. So are tags that need more
    than one corrected bit, and tags whose white ring the frame cuts: what is left of them has its centre elsewhere.
    """
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(pixels), cv2.COLOR_RGB2GRAY)
    size = np.array(grey.shape[::-1])
    detector = _detector(family)
    with _lock:
        detector.tag_detector_ptr.contents.quad_decimate = 2.0 if size.max() > SEARCH_SIDE else 1.0
        found = detector.detect(np.ascontiguousarray(grey))
    found = [d for d in found if d.hamming <= 1 and _is_whole(d.corners, size)]
    seen: dict[int, int] = {}
    for d in found:
        seen[d.tag_id] = seen.get(d.tag_id, 0) + 1
    # AprilTag's (0, 0) is the corner of the first pixel, OpenCV's is its centre.
    return [
        Tag(
            d.tag_id,
            tuple((d.center - 0.5).tolist()),
            tuple(tuple(c) for c in (d.corners - 0.5).tolist()),
            float(d.decision_margin),
        )
        for d in sorted(found, key=lambda d: d.tag_id)
        if seen[d.tag_id] == 1
    ]


def _is_whole(corners: np.ndarray, size: np.ndarray) -> bool:
    """Whether a cell's width (at least an eighth of the edge) lies between every corner and the frame."""
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max()
    return bool(corners.min() >= edge / 8 and (size - corners).min() >= edge / 8)


def detect_photo(path: str | os.PathLike, family: str = "tag36h11") -> list[Tag]:
    """The tags in a photo's file; InputError where there is none, or where the photo is mirrored."""
    pixels = files.read_photo(path)
    if tags := detect(pixels, family):
        return tags
    if mirrored := detect(pixels[:, ::-1], family):
        raise NoTags(path, f"{family} tags", f"a mirrored photo (its mirror image shows {len(mirrored)} tags)")
    raise NoTags(path, f"{family} tags", "none")


def detect_photos(
    photos: Sequence[str | os.PathLike], family: str, progress: Progress | None = None
) -> tuple[dict[str, list[Tag]], dict[str, str]]:
    """Tags by photo's path, and by photo's path what is wrong with those that show none."""
    tags: dict[str, list[Tag]] = {}
    wrong: dict[str, str] = {}
    for done, photo in enumerate(photos, start=1):
        try:
            tags[str(photo)] = detect_photo(photo, family)
        except NoTags as error:
            wrong[str(photo)] = error.got
        if progress:
            progress(done, len(photos))
    return tags, wrong
