"""AprilTags in a photo: pupil_apriltags, shifted by half a pixel into OpenCV's convention."""

import os
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pupil_apriltags

from raytwin.errors import InputError
from raytwin.images.photo_files import read_grey
from raytwin.progress import Progress, silent
from raytwin.scene import Record

SEARCH_SIDE, REDUCTIONS, SMALLEST_SEARCHED = 3000, (4.0, 2.0, 1.0), 16.0
"""Photos with a longer side, pixels, are searched at 1/n of it; edges are refined at full scale in any case. Found
nothing, or a tag with an edge below SMALLEST_SEARCHED of the reduced pixels, they are searched at the next n."""


class Tag(Record, frozen=True):
    """A tag seen in a photo, in OpenCV's pixels: (0, 0) is the centre of the top-left pixel.

    `center` is where the tag's diagonals cross, the image of its centre: under perspective not the mean of its corners.
    `corners`: lower left, lower right, upper right, upper left of the upright tag.
    """

    id: int
    center: tuple[float, float]
    corners: tuple[tuple[float, float], ...]


class _Detector(pupil_apriltags.Detector):
    """A detector that lives as long as the process and is never destroyed."""

    def __del__(self) -> None:
        # The library's own frees the tag family first, then reads it while destroying the detector: a crash at exit.
        pass


_idle = defaultdict[str, list[_Detector]](list)
"""By family, the detectors that no thread uses; there are as many as were ever in use at once."""


def detect(pixels: np.ndarray, family: str = "tag36h11") -> list[Tag]:
    """The tags in a photo, sRGB uint8 (H, W, 3) or grey (H, W), by id.

    Dropped are ids seen twice, tags that need more than one corrected bit, and tags whose white ring the frame cuts.
    """
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(pixels), cv2.COLOR_RGB2GRAY)
    grey, size = np.ascontiguousarray(grey), np.array(grey.shape[::-1])
    try:
        detector = _idle[family].pop()
    except IndexError:
        # One thread each: a second one gains nothing within a photo, but a second photo at once gains all.
        detector = _Detector(family, nthreads=1)
    for reduction in REDUCTIONS if size.max() > SEARCH_SIDE else REDUCTIONS[-1:]:
        detector.tag_detector_ptr.contents.quad_decimate = reduction
        found = [d for d in detector.detect(grey) if d.hamming <= 1]
        if found and min(_edges(d.corners).min() for d in found) >= SMALLEST_SEARCHED * reduction:
            break
    _idle[family].append(detector)
    # A cell's width, at least an eighth of the edge, must lie between every corner and the frame.
    room = [min(d.corners.min(), (size - d.corners).min()) - _edges(d.corners).max() / 8 for d in found]
    whole = [d for d, spare in zip(found, room, strict=True) if spare >= 0]
    times = Counter(d.tag_id for d in whole)
    # AprilTag's (0, 0) is the corner of the first pixel, OpenCV's is its centre.
    tags = [
        Tag(d.tag_id, tuple((d.center - 0.5).tolist()), tuple(map(tuple, (d.corners - 0.5).tolist())))
        for d in whole
        if times[d.tag_id] == 1
    ]
    return sorted(tags, key=lambda tag: tag.id)


def _edges(corners: np.ndarray) -> np.ndarray:
    return np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)


def detect_photo(path: str | os.PathLike, family: str = "tag36h11") -> list[Tag]:
    """The tags in a photo's file; InputError, with the reason, where there is none."""
    grey = read_grey(path)
    if tags := detect(grey, family):
        return tags
    if mirrored := detect(grey[:, ::-1], family):
        raise InputError(path, f"{family} tags", f"a mirrored photo (its mirror image shows {len(mirrored)} tags)")
    raise InputError(path, f"{family} tags", "no tag that appears once")


def detect_photos(
    photos: Sequence[str | os.PathLike], family: str, progress: Progress = silent
) -> tuple[dict[str, list[Tag]], dict[str, str]]:
    """Tags by photo's path, and by path what is wrong with photos that show none or are damaged."""
    tags: dict[str, list[Tag]] = {}
    wrong: dict[str, str] = {}
    progress("detect", 0, len(photos))
    # Decoding and detecting both let other threads run.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        searches = [pool.submit(detect_photo, photo, family) for photo in photos]
        for done, (photo, search) in enumerate(zip(photos, searches, strict=True), start=1):
            try:
                tags[str(photo)] = search.result()
            except InputError as error:
                wrong[str(photo)] = error.got
            progress("detect", done, len(photos))
    return tags, wrong
