"""The main job: photos -> camera -> tracer beside twin -> comparison. It wires the halves together."""

import importlib.metadata
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from raytwin import boards, files, photographer, photos, twin
from raytwin.augment import augment, draw_pyramid, errors_by_region
from raytwin.compare import Comparison, Report, compare
from raytwin.compare.report import Timing
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.progress import Progress, silent
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, Lambert, Rectangle, Scene, SceneFile, Sky, Sun, Tolerance
from raytwin.speed import ENGINES, trace
from raytwin.tracer import RADIANCE


@dataclass(frozen=True)
class TruthRow:
    """One calibrated quantity beside the truth that the synthetic photographer wrote down."""

    name: str
    truth: float
    found: float
    sigma: float | None
    unit: str


@dataclass(frozen=True, eq=False)
class Result:
    """All that `raytwin compare` found; every report is a view of it."""

    scene: Scene
    tolerance: Tolerance
    report: Report
    subject: Image
    twin: Image
    photo: np.ndarray | None = None
    augmented: np.ndarray | None = None
    calibration: photos.Calibration | None = None
    pose: photos.PoseReport | None = None
    truth: tuple[TruthRow, ...] = ()
    times: tuple[Timing, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def comparison(self) -> Comparison:
        return self.report.comparison


class Stopwatch:
    """Seconds of each named stage, in order."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def time(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start


# ------------------------------------------------------------------------------------------ photos -> Camera


def list_photos(folder: str | Path) -> list[Path]:
    """The photos of a folder, by name. Raises InputError where there are none."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(folder, "a folder of photos", "no such folder" if not folder.exists() else "a file")
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in (".jpg", ".jpeg", ".png"))
    if not found:
        raise InputError(folder, "photos (.jpg, .jpeg, .png)", "none")
    return found


def find_camera(
    written: SceneFile, photo: str | None = None, progress: Progress = silent
) -> tuple[Scene, Path | None, photos.Calibration | None, photos.PoseReport | None]:
    """What is to be rendered, its camera found: calibrated from its photos, standing where `photo` was taken.

    A scene with an explicit camera comes back as it is. Returns the scene, the photo's path, calibration and pose.
    """
    asked = written.photos
    if asked is None:
        if photo is not None:
            raise InputError(
                "--photo", "a scene whose camera is calibrated from photos", f"{written.name}, whose is given"
            )
        return written.scene, None, None, None
    folder = Path(written.folder)
    board = boards.read_board(folder / asked.board)
    taken = list_photos(folder / asked.photos)
    name = photo or asked.photo
    if name not in (names := [p.name for p in taken]):
        where = "--photo" if photo else f"{folder / 'scene.toml'}: camera.photo"
        raise InputError(where, f"one of {', '.join(names)}", name)
    calibration = photos.calibrate(taken, board, model=asked.model, progress=lambda d, n: progress("calibrate", d, n))
    pose = photos.pose_of_photo(calibration, folder / asked.photos / name, board)
    camera = photos.camera_at(calibration, pose.refined)
    return written.at(camera), folder / asked.photos / name, calibration, pose


def compare_truth(
    truth: photographer.Truth, calibration: photos.Calibration, camera: Camera, photo: str
) -> tuple[TruthRow, ...]:
    """Found beside true: focal lengths and centre in pixels, the compared photo's pose in degrees and millimetres."""
    rows = []
    for name, true, found in (
        ("fx", truth.K[0][0], camera.fx),
        ("fy", truth.K[1][1], camera.fy),
        ("cx", truth.K[0][2], camera.cx),
        ("cy", truth.K[1][2], camera.cy),
    ):
        rows.append(TruthRow(name, true, found, calibration.sigma.get(name), "px"))
    if photo in truth.photos:
        R, t = (np.asarray(a) for a in truth.photos[photo])
        angle = photos.rotation_degrees(np.asarray(camera.R_cam_board), R)
        rows.append(TruthRow("rotation off by", 0.0, angle, None, "degrees"))
        apart = 1e3 * np.linalg.norm(np.asarray(camera.eye) - (-R.T @ t))
        rows.append(TruthRow("eye off by", 0.0, float(apart), None, "mm"))
    return tuple(rows)


# ------------------------------------------------------------------------------------------ the main job


def run(
    path: str | Path,
    *,
    rung: str = "shadow",
    engine: str = "numpy64",
    solver: str = "robust",
    sampling: str = "center",
    samples: int | None = None,
    seed: int = 0,
    photo: str | None = None,
    size: tuple[int, int] | None = None,
    trim: str = "conic",
    cache: bool = True,
    flip: bool = False,
    progress: Progress = silent,
) -> Result:
    """Compare the hand-written tracer with its Mitsuba twin on the scene at `path`.

    `rung`: `surface`, `lambert` and `shadow` are computed by both; for `sky` and `path`, which the tracer does not
    climb, it stays at `shadow`, and the comparison shows what the further light adds. `size` (width, height) renders
    at other than the camera's own size. `samples`: the twin's samples per pixel, by default 1 where every sample
    through the pixel's centre is the same, else 64. `flip` adds the perceptual metric, which is slow.
    """
    if rung not in RUNGS:
        raise InputError("--rung", f"one of {', '.join(RUNGS)}", rung)
    if engine not in ENGINES:
        raise InputError("--engine", f"one of {', '.join(ENGINES)}", engine)
    if sampling not in twin.SAMPLINGS:
        raise InputError("--sampling", f"one of {', '.join(twin.SAMPLINGS)}", sampling)
    if samples is not None and samples < 1:
        raise InputError("--samples", "a whole number >= 1", samples)
    watch = Stopwatch()
    written = files.read_scene(path)
    with watch.time("backend"):
        backend = twin.activate()
    with watch.time("calibrate"):
        scene, photo_path, calibration, pose = find_camera(written, photo, progress)
    truth: tuple[TruthRow, ...] = ()
    if photo_path is not None and (truth_file := photo_path.parent / "truth.toml").exists():
        truth = compare_truth(photographer.read_truth(truth_file), calibration, scene.camera, photo_path.name)
    if size is not None:
        scene = scene.with_camera(scene.camera.resized(*size))
    climbed = rung if rung in RADIANCE else list(RADIANCE)[-1]
    with watch.time("tracer"):
        progress("tracer", 0, 1)
        subject = trace(scene, climbed, engine, solver, trim)
        progress("tracer", 1, 1)
    noisy = RUNGS[rung].noisy or sampling == "area"
    with watch.time("twin"):
        other = twin.render(
            scene,
            rung,
            sampling=sampling,
            samples=samples or (64 if noisy else 1),
            seed=seed,
            cache=cache,
            progress=lambda share: progress("twin", round(100 * share), 100),
        )
    with watch.time("compare"):
        progress("compare", 0, 1)
        comparison = compare(subject, other, tolerance=written.tolerance, flip=flip)
        progress("compare", 1, 1)
    picture = augmented = None
    if photo_path is not None:
        picture = files.read_photo(photo_path)
        if size is None:
            augmented = augment(picture, scene, engine=fast_engine(backend)).pixels
    report = Report(
        scene.name,
        rung,
        comparison,
        dict(watch.seconds),
        backend={
            "twin_variant": backend.variant,
            "tracer_engine": engine,
            "libllvm": backend.libllvm,
            "solver": solver,
        },
    )
    settings = {
        "rung of the tracer": climbed,
        "rung of the twin": rung,
        "tracer's engine": engine,
        "sphere solver": solver,
        "twin's sampling": sampling,
        "twin's samples per pixel": str(other.samples),
        "trim boxes": trim,
    }
    return Result(
        scene=scene,
        tolerance=written.tolerance,
        report=report,
        subject=subject,
        twin=other,
        photo=picture,
        augmented=augmented,
        calibration=calibration,
        pose=pose,
        truth=truth,
        times=_times(watch.seconds, comparison, calibration),
        settings=settings,
        versions=versions(),
    )


def fast_engine(backend: twin.Backend) -> str:
    """The fastest row of ENGINES on this machine."""
    return {"llvm_ad_rgb": "drjit32", "cuda_ad_rgb": "cuda32"}.get(backend.variant, "numpy32")


def _times(
    seconds: dict[str, float], comparison: Comparison, calibration: photos.Calibration | None
) -> tuple[Timing, ...]:
    worth = {
        "backend": "-",
        "calibrate": f"rms {calibration.rms_px:.3f} px" if calibration else "camera given",
        "tracer": f"p99.9 error {comparison.radiance.p999_abs:.2g}",
        "twin": "the reference",
        "compare": "-",
    }
    return tuple(Timing(stage, s, worth[stage]) for stage, s in seconds.items())


def versions() -> dict[str, str]:
    """Of Python and of the packages whose version may change a number."""
    named = ("raytwin", "mitsuba", "drjit", "numpy", "opencv-contrib-python-headless", "pupil-apriltags")
    return {"python": platform.python_version()} | {n: importlib.metadata.version(n) for n in named}


# ------------------------------------------------------------------------------------------ photos with objects in them


def augment_photos(
    taken: list[Path],
    scene_path: str | Path,
    out: str | Path,
    *,
    camera: str | Path | None = None,
    board: str | Path | None = None,
    against: str | Path | None = None,
    shadows: bool = True,
    exposure: float = 1.0,
    progress: Progress = silent,
) -> list[dict]:
    """Draw the scene's objects into each photo and write it to `out` under its own name, upright, as PNG or JPEG.

    `camera`: a camera.toml, whose K and distortion count; without it the scene's own photos are calibrated. Each
    photo's pose comes from its own tags of `board` (the scene's, if none is named). `against`: a folder of true photos
    of the same names, the objects really there. Returns a row per photo: its name, its pose's rms in pixels, and with
    `against` the errors by region.
    """
    scene = files.read_scene(scene_path)
    asked = scene.photos
    if board is None and asked is None:
        raise InputError("--board", "a board's TOML file, since the scene names none", "nothing")
    definition = boards.read_board(board if asked is None or board is not None else Path(scene.folder) / asked.board)
    lens = find_camera(scene, progress=progress)[0].camera if camera is None else files.read_camera(camera)
    out = Path(out)
    if names := sorted(n for n in {p.name for p in taken} if sum(p.name == n for p in taken) > 1):
        raise InputError("photos", "names that differ, since each is written under its own", ", ".join(names))
    if any((out / p.name).exists() and (out / p.name).samefile(p) for p in taken):
        raise InputError("--out", "another folder than the photos'", out)
    engine = fast_engine(twin.activate())
    rows = []
    for done, path in enumerate(taken):
        progress("augment", done, len(taken))
        pixels = files.read_photo(path)
        if pixels.shape[1::-1] != lens.image_size:
            turned = ": the same, turned by a quarter" if pixels.shape[:2] == lens.image_size else ""
            found = f"{pixels.shape[1]} x {pixels.shape[0]}{turned}"
            raise InputError(path, f"{lens.width} x {lens.height} pixels, as the camera's", found)
        tags = photos.detect_photo(path, definition.family)
        pose = photos.pose_of_tags(lens.K, lens.dist, tags, definition, path.name).refined
        stand = msgspec.structs.replace(lens, R_cam_board=pose.R_cam_board, t_cam_board=pose.t_cam_board)
        here = scene.at(stand)
        result = augment(pixels, here, engine=engine, shadows=shadows, exposure=exposure)
        drawn = result.pixels
        for pyramid in scene.pyramids:
            drawn = draw_pyramid(drawn, stand, pyramid)
        row = {"photo": path.name, "pose_rms_px": pose.rms_px}
        if against is not None:
            truth = files.read_photo(Path(against) / path.name)
            row["regions"] = errors_by_region(result, truth, here)
        files.write_picture(out / path.name, files.upright(drawn, files.photo_orientation(path)), quality=95)
        rows.append(row)
    progress("augment", len(taken), len(taken))
    return rows


# ------------------------------------------------------------------------------------------ the synthetic photographer


WOOD = Lambert((0.36, 0.25, 0.17))
TABLE = Rectangle((0.0, 0.0, -0.002), (1.5, 0.0, 0.0), (0.0, 1.5, 0.0), WOOD, in_photo=True)
SUN = Sun((0.45, 0.35, 0.85), (2.3, 2.2, 2.05))
SKY = Sky((0.22, 0.24, 0.27))
"""What `photograph_board` uses where no scene is given: white paper comes out a little below white."""


def photograph_board(
    board: str | Path,
    out: str | Path,
    *,
    scene: str | Path | None = None,
    count: int = 14,
    size: tuple[int, int] = (2016, 1512),
    focal: float = 1560.0,
    dist: tuple[float, ...] = (0.08, -0.16),
    samples: int = 32,
    seed: int = 1,
    with_objects: bool = False,
    progress: Progress = silent,
) -> photographer.Truth:
    """`count` photos of the board on its table, and the truth (camera.toml's K, dist and every pose), written to `out`.

    Sun, sky and table (the planes below the board) come from `scene`, by default a plain desk. `focal` is in pixels of
    a photo 2016 wide, so that another size changes the pixels and not the view. The lens is centred a little off, as
    real ones are. `with_objects` puts the scene's spheres really there: the same seed gives the same poses and the same
    sensor noise, so that such photos are the truth for augmented ones.
    """
    definition = boards.read_board(board)
    width, height = size
    scale = width / 2016
    K = ((focal * scale, 0.0, 0.504 * width), (0.0, 1.001 * focal * scale, 0.497 * height), (0.0, 0.0, 1.0))
    lens = Camera(size, K, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)), (0.0, 0.0, 1.0), dist)
    files.check_camera(lens, "--focal, --size")
    stage = files.read_scene(scene).at(lens) if scene is not None else Scene("desk", lens, (TABLE,), (SUN, SKY))
    table = tuple(p for p in stage.rectangles if p.center[2] < 0)
    twin.activate()

    def render(view: Camera, texture: np.ndarray, sheet: Rectangle) -> np.ndarray:
        spheres = stage.spheres if with_objects else ()
        set_up = msgspec.structs.replace(stage, camera=view, objects=(*spheres, sheet, *table))
        made = twin.render(
            set_up, "path", sampling="area", samples=samples, seed=seed, textures={len(spheres): texture}, cache=False
        )
        return made.mean

    return photographer.photograph(
        definition, lens, count, Path(out), render, seed=seed, progress=lambda d, n: progress("photograph", d, n)
    )
