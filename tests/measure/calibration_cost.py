"""Time whole calibrations over image scale and the detector's settings, each beside its error in unseen photos.

    python -m measure.calibration_cost [PHOTOS [WIDTH [REPEATS]]]

Timed as users meet it: photos on disk -> decode, find the tags, fit -> camera. The photos are synthetic (15 of 4032 x
3024 by default). *Held out* is the rms error in photos that the fit did not use, in pixels of the photos as taken,
against the true centres of the tags.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from photo_helpers import BOARD, seen
from PIL import Image as Pillow

from raytwin.errors import InputError
from raytwin.images.photo_files import list_photos, read_grey
from raytwin.photos import boards, synthetic_photos
from raytwin.photos import camera as camera_package
from raytwin.photos.camera import Calibration, Tag
from raytwin.study.photograph import photograph_board

FOLDS = 5
"""Parts of the photos; each is held out once."""


class Setting(NamedTuple):
    """One way to calibrate: `shrink` the photos to 1/n of their side, or search at `reductions` and refine."""

    shrink: int = 1
    reductions: tuple[float, ...] | None = (1.0,)
    threads: int | None = None

    def find(self, grey: np.ndarray) -> list[Tag]:
        """The tags in the photo's own pixels: u' of a photo shrunk to 1/n lies at u = (u' + 1/2) n - 1/2."""
        found, n = [], self.shrink
        for tag in camera_package.detect(np.asarray(Pillow.fromarray(grey).reduce(n)), BOARD.family, self.reductions):
            center, *corners = map(tuple, ((np.array([tag.center, *tag.corners]) + 0.5) * n - 0.5).tolist())
            found.append(msgspec.structs.replace(tag, center=center, corners=tuple(corners)))
        return found


WHOLE, OURS, QUARTER = "full size, one thread", "raytwin's own", "photos shrunk to 1/4"
SETTINGS = {
    WHOLE: Setting(threads=1),
    OURS: Setting(reductions=None),
    f"{QUARTER}, one thread": Setting(4, threads=1),
    **{f"photos shrunk to 1/{n}": Setting(n) for n in (2, 4, 8)},
    **{f"searched at 1/{n}, refined": Setting(reductions=(float(n),)) for n in (1, 2, 4, 8)},
}
"""What the paper does is to shrink the photos."""


class Cost(NamedTuple):
    """`heldout`: the rms error in pixels; `focal`: the focal length's error in percent."""

    seconds: float
    heldout: float
    focal: float


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


def costs(folder: Path, repeats: int, names: Iterable[str] = SETTINGS) -> dict[str, Cost]:
    """Return what each setting costs on the synthetic photos in `folder`, where that can be told."""
    taken, truth = list_photos(folder), synthetic_photos.read_truth(folder / "truth.toml")
    true = dict(zip(truth.photos, seen(truth, truth.photos.values(), BOARD).values(), strict=True))

    def calibrate(setting: Setting) -> tuple[dict[str, list[Tag]], Calibration]:
        with ThreadPoolExecutor(setting.threads) as pool:
            tags = pool.map(lambda photo: setting.find(read_grey(photo)), taken)
        by_name = {photo.name: found for photo, found in zip(taken, tags, strict=True)}
        return by_name, camera_package.calibrate_detections(by_name, truth.image_size, BOARD)

    errors = {}
    for name in names:
        try:
            tags, camera = calibrate(SETTINGS[name])
            unseen = held_out(tags, camera, true)
        except InputError as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        errors[name] = unseen, 100 * max(abs(camera.K[i][i] / truth.K[i][i] - 1) for i in (0, 1))
    seconds = medians({name: lambda s=SETTINGS[name]: calibrate(s) for name in errors}, repeats)
    return {name: Cost(seconds[name], *error) for name, error in errors.items()}


def main(count: str = "15", width: str = "4032", repeats: str = "3") -> None:
    with photographed(int(count), (int(width), int(width) * 3 // 4)) as folder:
        for name, cost in costs(folder, int(repeats)).items():
            print(f"{name:<34} {cost.seconds:8.3g} s {cost.heldout:8.3g} px held out {cost.focal:8.3g} % focal length")


if __name__ == "__main__":
    main(*sys.argv[1:])
