"""Time whole calibrations over image scale, each beside its error in unseen photos.

Timed as users meet it: photos on disk -> decode, find the tags, fit -> camera. `measure.paper` prints the table.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import msgspec
import numpy as np
from photo_helpers import BOARD, read_truth, seen
from PIL import Image as Pillow

from raytwin.errors import InputError
from raytwin.images.photo_files import list_photos, read_grey
from raytwin.photos import boards
from raytwin.photos import camera as camera_package
from raytwin.photos.camera import Calibration, Tag, detection
from raytwin.study.photograph import photograph_board

FOLDS = 5
"""Parts of the photos; each is held out once."""


class Setting(NamedTuple):
    """One way to calibrate: `shrink` the photos to 1/n of their side; search at raytwin's scales or at full size."""

    shrink: int = 1
    full: bool = False
    threads: int | None = None

    def find(self, grey: np.ndarray) -> list[Tag]:
        """The tags in the photo's own pixels: u' of a photo shrunk to 1/n lies at u = (u' + 1/2) n - 1/2."""
        found, n = [], self.shrink
        for tag in detection.detect(np.asarray(Pillow.fromarray(grey).reduce(n)), BOARD.family):
            center, *corners = map(tuple, ((np.array([tag.center, *tag.corners]) + 0.5) * n - 0.5).tolist())
            found.append(msgspec.structs.replace(tag, center=center, corners=tuple(corners)))
        return found


WHOLE, OURS, QUARTER = "full size, one thread", "raytwin's own", "photos shrunk to 1/4"
SETTINGS = {WHOLE: Setting(full=True, threads=1), OURS: Setting(), QUARTER: Setting(4, full=True)}
"""What the paper does is to shrink the photos."""


class Cost(NamedTuple):
    """`heldout`: the rms error in photos that the fit did not use, against the tags' true centres, in pixels of the
    photos as taken."""

    seconds: float
    heldout: float


@contextmanager
def photographed(count: int, size: tuple[int, int]) -> Iterator[Path]:
    """Give a folder with synthetic photos of BOARD and their truth."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        boards.write_board(folder / "board.toml", BOARD)
        photograph_board(folder / "board.toml", folder / "photos", count=count, size=size, samples=4)
        yield folder / "photos"


def held_out(tags: Mapping[str, Sequence[Tag]], found: Calibration, true: Mapping[str, Sequence[Tag]]) -> float:
    """Return the rms over photos that a fit of `found`'s model has not seen; only their poses are fitted to `true`."""
    names, rms, counts = [view.photo for view in found.views], [], []
    for k in range(FOLDS):
        rest = {name: tags[name] for i, name in enumerate(names) if i % FOLDS != k}
        camera = camera_package.calibrate_detections(rest, found.image_size, BOARD, found.model)
        for name in names[k::FOLDS]:
            rms.append(camera_package.refined_pose(camera.K, camera.dist, true[name], BOARD)[0].rms_px)
            counts.append(len(true[name]))
    return float(np.average(np.square(rms), weights=counts) ** 0.5)


def medians(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each call; they are made in turn."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(taken) for name, taken in seconds.items()}


def costs(folder: Path, repeats: int) -> dict[str, Cost]:
    """Return what each setting costs on the synthetic photos in `folder`, where that can be told."""
    taken, truth = list_photos(folder), read_truth(folder / "truth.toml")
    true = dict(zip(truth.photos, seen(truth, truth.photos.values(), BOARD).values(), strict=True))

    def calibrate(setting: Setting) -> tuple[dict[str, list[Tag]], Calibration]:
        scales = (1.0,) if setting.full else detection.REDUCTIONS
        with mock.patch.object(detection, "REDUCTIONS", scales), ThreadPoolExecutor(setting.threads) as pool:
            tags = pool.map(lambda photo: setting.find(read_grey(photo)), taken)
        by_name = {photo.name: found for photo, found in zip(taken, tags, strict=True)}
        return by_name, camera_package.calibrate_detections(by_name, truth.image_size, BOARD)

    errors = {}
    for name in SETTINGS:
        try:
            tags, camera = calibrate(SETTINGS[name])
            errors[name] = held_out(tags, camera, true)
        except InputError as error:
            print(f"{name}: {error}", file=sys.stderr)
    seconds = medians({name: lambda s=SETTINGS[name]: calibrate(s) for name in errors}, repeats)
    return {name: Cost(seconds[name], error) for name, error in errors.items()}
