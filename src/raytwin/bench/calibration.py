"""Seconds of a whole calibration against its held-out error, over image scale and the detector's settings.

Timed as users meet it: photos on disk -> decode, find the tags, fit -> camera. SETTINGS says what varies. The photos
are synthetic ones, whose true camera is known, or a folder of real ones.
"""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from raytwin import files, photos, pipeline
from raytwin.bench.frontier import median_iqr
from raytwin.bench.measure import Measured, repeat
from raytwin.bench.record import Calibrated, LeftOut
from raytwin.errors import InputError
from raytwin.photos import Board, Grid, Tag

BOARD = Board("tag36h11", 0.030, Grid(5, 7, 0.038))
"""What is photographed where no board is given."""

SYNTHETIC_SAMPLES = 4
"""Light paths a pixel of a synthetic photo: their noise stays below the sensor's."""


@dataclass(frozen=True)
class Setting:
    """One way to calibrate: a row of SETTINGS.

    `shrink`: the photos are shrunk to 1/n of the side, and that is all that is looked at; `reductions`: searched at
    1/n of the side, the tags' edges refined on the whole photo (photos.detect's scales, None: its own choice).
    """

    family: str
    scale: float
    shrink: int = 1
    reductions: tuple[float, ...] | None = None
    threads: int | None = None
    noisy: bool = False

    @property
    def name(self) -> str:
        return f"{self.family}, scale {self.scale:g}"

    def find(self, grey: np.ndarray, family: str) -> list[Tag]:
        if self.shrink > 1:
            return detect_shrunk(grey, family, self.shrink)
        return photos.detect(grey, family, self.reductions)


WHOLE, OURS, SHRUNK, REDUCED = "full size, one thread", "raytwin's own", "photos shrunk", "reduced search, refined"

SETTINGS: tuple[Setting, ...] = (
    Setting(WHOLE, 1.0, reductions=(1.0,), threads=1),
    Setting(OURS, 1.0),
    *(Setting(SHRUNK, 1 / n, shrink=n, reductions=(1.0,)) for n in (2, 4, 8)),
    *(Setting(REDUCED, 1 / n, reductions=(float(n),)) for n in (1, 2, 4, 8)),
)
"""The first is what the others' seconds are divided by. `shrunk` is the paper's trick."""


def detect_shrunk(grey: np.ndarray, family: str, n: int) -> list[Tag]:
    """The tags of a grey photo shrunk to 1/n of its side, in the photo's own pixels.

    A small pixel is the mean of n x n: its centre u' lies at u = (u' + 1/2) n - 1/2, pixel centres being whole numbers.
    """
    from PIL import Image as Pillow

    small = np.asarray(Pillow.fromarray(grey).reduce(n))

    def back(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] + 0.5) * n - 0.5, (point[1] + 0.5) * n - 0.5

    # At the right and lower edges the last small pixel may reach beyond the photo; tags there are cut, and dropped.
    return [
        msgspec.structs.replace(tag, center=back(tag.center), corners=tuple(map(back, tag.corners)))
        for tag in photos.detect(small, family, (1.0,))
    ]


def measure_calibration(
    folder: Path,
    board: Board,
    *,
    name: str = "",
    settings: Sequence[Setting] = SETTINGS,
    deadline: float,
    repeats: int = 7,
    progress: pipeline.Progress = pipeline.silent,
) -> tuple[list[Calibrated], list[LeftOut]]:
    """Every setting on the photos in `folder`, and why those that are missing are; the quickest are tried first.

    `folder` may hold a truth.toml, which tells the true error of the focal length. `name`: what the rows call the
    photos. `deadline`: by time.perf_counter.
    """
    taken = pipeline.list_photos(folder)
    size = files.photo_size(taken[0])
    truth_file = folder / "truth.toml"
    truth = photos.read_truth(truth_file) if truth_file.exists() else None
    found: dict[str, photos.Calibration] = {}
    done, left, last = [], [], 0.0
    for i, setting in enumerate(sorted(settings, key=expected)):
        progress(f"calibrate {name}".strip(), i, len(settings))

        def call(seed: int, setting: Setting = setting) -> photos.Calibration:
            return photos.calibrate(taken, board, find=setting.find, threads=setting.threads)

        start = time.perf_counter()
        if start + 2 * last > deadline:
            left.append(LeftOut(f"calibration: {setting.name}", *size, f"no time: the one before took {last:.2g} s"))
            continue
        try:
            found[setting.name] = call(0)
        except InputError as error:
            left.append(LeftOut(f"calibration: {setting.name}", *size, f"expected {error.expected}, got {error.got}"))
            continue
        last = time.perf_counter() - start
        done.append(Measured(setting, call, last))
    repeat(done, lambda setting, calibration: {}, deadline, repeats)
    progress(f"calibrate {name}".strip(), len(settings), len(settings))
    rows = []
    for m in sorted(done, key=lambda m: settings.index(m.method)):
        if not m.seconds:
            left.append(LeftOut(f"calibration: {m.method.name}", *size, "no time left for a timed call"))
            continue
        rows.append(row_of(m.method, found[m.method.name], m.seconds, name, truth))
    return rows, left


def expected(setting: Setting) -> float:
    """For the order alone: pixels searched, by one thread or many."""
    scale = setting.scale if setting.reductions else 0.25
    return scale**2 * (2 if setting.threads == 1 else 1) + (0.001 if setting.shrink == 1 else 0)


def row_of(setting: Setting, c: photos.Calibration, seconds: Sequence[float], name: str, truth) -> Calibrated:
    focal = None
    if truth is not None:
        focal = 100 * max(abs(c.K[i][i] / truth.K[i][i] - 1) for i in (0, 1))
    held_out = c.evidence.trials[c.model].held_out_px
    median, iqr = median_iqr(seconds)
    return Calibrated(
        setting.family, setting.scale, len(c.views), median, held_out, name, iqr, sum(v.tags for v in c.views),
        c.model, focal, c.image_size[0], c.image_size[1],
    )  # fmt: skip


class Shoot(msgspec.Struct, frozen=True):
    """The synthetic photos: how many, of what size (width, height), of which board."""

    count: int = 15
    size: tuple[int, int] = (4032, 3024)
    board: Board = BOARD


class Taken(msgspec.Struct, frozen=True):
    """Real photos: a folder and the board that they show."""

    folder: Path
    board: Board


def measure_calibrations(
    shoot: Shoot, taken: Sequence[Taken], until: float, repeats: int = 7, progress: pipeline.Progress = pipeline.silent
) -> tuple[list[Calibrated], list[LeftOut]]:
    """`measure_calibration` on synthetic photos with truth, then on each folder of real ones, each with its share of
    the time until `until`. The synthetic photos are taken into a folder that is gone afterwards; no row counts that.
    """
    options = {"repeats": repeats, "progress": progress}
    with tempfile.TemporaryDirectory(prefix="raytwin-bench-") as temporary:
        folder = Path(temporary)
        photos.write_board(folder / "given.toml", shoot.board)
        pipeline.photograph_board(
            folder / "given.toml",
            folder / "photos",
            count=shoot.count,
            size=shoot.size,
            samples=SYNTHETIC_SAMPLES,
            progress=progress,
        )
        deadline = portion(until, 1 + len(taken))
        rows, left = measure_calibration(folder / "photos", shoot.board, name="synthetic", deadline=deadline, **options)
    for i, real in enumerate(taken):
        deadline = portion(until, len(taken) - i)
        found, without = measure_calibration(
            real.folder, real.board, name=real.folder.name, deadline=deadline, **options
        )
        rows += found
        left += without
    return rows, left


def portion(until: float, parts: int) -> float:
    """The end of the first of `parts` equal parts of the time from now on."""
    now = time.perf_counter()
    return now + (until - now) / parts
