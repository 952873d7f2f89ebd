"""Seconds of a whole calibration against its held-out error, over image scale and the detector's settings.

Timed as users meet it: photos on disk -> decode, find the tags, fit -> camera. SETTINGS says what varies. The photos
are synthetic ones, whose true camera is known.
"""

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from raytwin import files
from raytwin.bench.bench_record import Bench, Calibrated, LeftOut
from raytwin.bench.bench_run import check_numbers, machine
from raytwin.bench.frontier import median_iqr
from raytwin.bench.timing import Measured, repeat
from raytwin.calib import boards, photos, synthetic_photos
from raytwin.calib.boards import Board, Grid
from raytwin.calib.photos import Tag
from raytwin.errors import InputError
from raytwin.progress import Progress, silent
from raytwin.workflows.photograph import photograph_board
from raytwin.workflows.versions import versions

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
SHRUNK_ALONE = "photos shrunk, one thread"

SETTINGS: tuple[Setting, ...] = (
    Setting(WHOLE, 1.0, reductions=(1.0,), threads=1),
    Setting(OURS, 1.0),
    Setting(SHRUNK_ALONE, 1 / 4, shrink=4, reductions=(1.0,), threads=1),
    *(Setting(SHRUNK, 1 / n, shrink=n, reductions=(1.0,)) for n in (2, 4, 8)),
    *(Setting(REDUCED, 1 / n, reductions=(float(n),)) for n in (1, 2, 4, 8)),
)
"""The first is what the others' seconds are divided by. `shrunk` is the paper's trick.

They are tried in this order: what the ratios need comes first."""

FOLDS = 5
"""Parts of the photos; each is held out once, so more parts cost more calibrations."""


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
    settings: Sequence[Setting] = SETTINGS,
    deadline: float,
    repeats: int = 7,
    progress: Progress = silent,
) -> tuple[list[Calibrated], list[LeftOut]]:
    """Measure every setting on the synthetic photos in `folder`, and say why those that are missing are.

    `deadline`: by time.perf_counter, for the timed calls; finding the held-out errors comes after it.
    """
    taken = files.list_photos(folder)
    size = files.photo_size(taken[0])
    truth = synthetic_photos.read_truth(folder / "truth.toml")
    true = true_tags(truth, board)
    found: dict[str, photos.Calibration] = {}
    done, reasons, longest = [], {}, 0.0
    for i, setting in enumerate(settings):
        progress("calibrate", i, len(settings))

        def call(seed: int, setting: Setting = setting) -> photos.Calibration:
            return photos.calibrate(taken, board, find=setting.find, threads=setting.threads)

        start = time.perf_counter()
        if start + longest > deadline:
            reasons[setting.name] = "no time to prepare it"
            continue
        try:
            found[setting.name] = call(0)
        except InputError as error:
            reasons[setting.name] = f"expected {error.expected}, got {error.got}"
            continue
        longest = max(longest, time.perf_counter() - start)
        done.append(Measured(setting, call, time.perf_counter() - start))
    repeat(done, lambda setting, calibration: {}, deadline, repeats)
    progress("calibrate", len(settings), len(settings))
    rows = []
    for m in done:
        c = found[m.method.name]
        if not m.seconds:
            reasons[m.method.name] = "no time left for a timed call"
        elif len(c.views) <= photos.LEAST_VIEWS:
            reasons[m.method.name] = "too few photos to hold one out"
        else:
            tags = photos.detect_photos(taken, board.kind, find=m.method.find)[0]
            unseen = held_out({Path(p).name: t for p, t in tags.items()}, c, board, true)
            rows.append(row_of(m.method, c, m.seconds, truth, unseen))
    return rows, [LeftOut(f"calibration: {method}", *size, why) for method, why in reasons.items()]


def true_tags(truth: synthetic_photos.Truth, board: Board) -> dict[str, list[Tag]]:
    """Return where the true camera sees the centres of all the board's tags that lie within the frame, by photo.

    They judge every setting alike: by its own detections a coarse one would be charged for their noise twice, and one
    that loses the difficult tags would be rewarded for it.
    """
    points = np.array([(*center, 0.0) for center in board.centers().values()])
    shown = {}
    for photo, (R, t) in truth.photos.items():
        pixels = photos.project(points, np.array(R), np.array(t), np.array(truth.K), truth.dist)
        inside = np.all((pixels > -0.5) & (pixels < np.array(truth.image_size) - 0.5), axis=1)
        shown[photo] = [
            Tag(i, tuple(p), (tuple(p),) * 4, 0.0)
            for i, p, ok in zip(board.centers(), pixels.tolist(), inside.tolist(), strict=True)
            if ok
        ]
    return shown


def held_out(
    tags: Mapping[str, Sequence[Tag]], found: photos.Calibration, board: Board, true: Mapping[str, Sequence[Tag]]
) -> float:
    """Return the rms in pixels over photos that a fit of `found`'s model has not seen, a fifth of them by turns.

    The camera's pose alone is fitted to each photo's `true` tags.
    """
    names = [view.photo for view in found.views]
    squares, count = 0.0, 0
    folds = min(FOLDS, len(names))
    for k in range(folds):
        rest = {name: tags[name] for i, name in enumerate(names) if i % folds != k}
        camera = photos.calibrate_detections(rest, found.image_size, board, found.model)
        for name in names[k::folds]:
            pose, _ = photos.refined_pose(camera.K, camera.dist, true[name], board)
            squares, count = squares + len(true[name]) * pose.rms_px**2, count + len(true[name])
    return (squares / count) ** 0.5


def row_of(
    setting: Setting, c: photos.Calibration, seconds: Sequence[float], truth: synthetic_photos.Truth, error: float
) -> Calibrated:
    focal = 100 * max(abs(c.K[i][i] / truth.K[i][i] - 1) for i in (0, 1))
    median, iqr = median_iqr(seconds)
    return Calibrated(
        setting.family, setting.scale, len(c.views), median, error, "synthetic", iqr, sum(v.tags for v in c.views),
        c.model, focal, c.image_size[0], c.image_size[1],
    )  # fmt: skip


@dataclass(frozen=True)
class Shoot:
    """The synthetic photos: how many, of what size (width, height), of which board."""

    count: int = 15
    size: tuple[int, int] = (4032, 3024)
    board: Board = BOARD


@contextmanager
def photographed(shoot: Shoot, progress: Progress = silent) -> Iterator[Path]:
    """A folder with the synthetic photos and their truth, gone afterwards. No budget counts the time that it takes."""
    with tempfile.TemporaryDirectory(prefix="raytwin-bench-") as temporary:
        folder = Path(temporary)
        boards.write_board(folder / "given.toml", shoot.board)
        photograph_board(
            folder / "given.toml", folder / "photos", count=shoot.count, size=shoot.size, samples=SYNTHETIC_SAMPLES,
            progress=progress,
        )  # fmt: skip
        yield folder / "photos"


def bench_calibration(
    shoot: Shoot = Shoot(), *, budget: float = 300.0, repeats: int = 7, progress: Progress = silent
) -> Bench:
    """Measure calibrations alone, in about `budget` seconds once the synthetic photos are there."""
    check_numbers("--budget", (budget,))
    check_numbers("--repeats", (repeats,))
    with photographed(shoot, progress) as folder:
        start = time.perf_counter()
        deadline = start + budget
        rows, left = measure_calibration(folder, shoot.board, deadline=deadline, repeats=repeats, progress=progress)
    return Bench(
        scene="calibration", machine=machine(), versions=versions(), budget=float(budget),
        seconds=time.perf_counter() - start, rows=(), calibration=tuple(rows), left_out=tuple(left),
    )  # fmt: skip
