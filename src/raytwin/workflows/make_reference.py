"""References: images of known worth in EXR files, `<folder>/<scene>/<rung>.exr`, that later renders are held to.

Each file stands alone: beside the pixels, its header has what made them, the scene with its camera found, a hash of
the scene as it is written, and a checksum of everything, since EXR itself does not notice a flipped byte.

    make    render with the twin, show what changes, write
    check   is the file whole, is its scene still the one on disk, does today's Mitsuba agree?
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from raytwin import files, twin
from raytwin.compare import Comparison, SequentialComparison, compare
from raytwin.errors import InputError, check_one_of
from raytwin.image import Image
from raytwin.image_pool import ImagePool
from raytwin.progress import Progress, Stages, silent
from raytwin.references import FILES, Reference, load, path_of, scene_hash, sealed, stale
from raytwin.rungs import RUNGS
from raytwin.scene import Camera, MitsubaScene, Scene, SceneFile
from raytwin.scene.scene_changes import changes
from raytwin.workflows.rounds import Budget, Rounds, round_seed
from raytwin.workflows.settings import ReferenceSettings

PIXELS = 336 * 252
"""About what a reference has: a shadow's edge is still some pixels from the next, and all files fit a repository."""
SAMPLES, CHECKED_SAMPLES = 4096, 256
STINTS, BATCHES = 8, 8
"""A long render comes in so many pieces, each kept in the cache when done, each of so many independent batches."""
LEVEL = "path"
"""The light level that the reference of a Mitsuba file is stored under; its integrator decides what it is."""
MOVED_PX = 0.05
"""Pixels by which a new calibration may move the picture before its reference counts as stale."""


def size_of(image_size: tuple[int, int]) -> tuple[int, int]:
    """(width, height) of about PIXELS pixels in the camera's aspect ratio; never more than the camera has."""
    width, height = image_size
    if width * height <= PIXELS:
        return image_size
    small = max(1, round(math.sqrt(PIXELS * width / height)))
    return small, max(1, round(small * height / width))


def find_scene(path: str | Path, progress: Progress = silent) -> SceneFile | MitsubaScene:
    """The scene with its camera found: calibrated, where it has photos. Finding it once serves all rungs."""
    if files.is_mitsuba(path):
        return files.read_mitsuba(path)
    written = files.read_scene(path)
    if written.photos is None:
        return written
    from raytwin.calib.find_camera import find_camera

    return written.with_camera(find_camera(written, progress=progress)[0].camera)


def _at_size(found: SceneFile, size: tuple[int, int] | None) -> SceneFile:
    camera = found.scene.camera
    return found.with_camera(camera.resized(*(size or size_of(camera.image_size))))


def moved(scene: Scene, a: Camera, b: Camera) -> float:
    """Pixels between what two cameras see: the largest distance over points of the scene that lie in a's picture."""
    if a == b:
        return 0.0
    from raytwin.calib.photos.lens_model import project

    steps = np.linspace(-1, 1, 9)
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    parts = [np.reshape([s.center for s in scene.spheres], (-1, 3))]
    parts += [p.center + grid @ np.array([p.half_u, p.half_v]) for p in scene.rectangles]
    points = np.concatenate(parts)
    for c in (a, b):
        points = points[(points @ np.asarray(c.R_cam_board).T + c.t_cam_board)[:, 2] > 0]
    if not len(points):
        return 0.0
    at = [
        project(points, np.asarray(c.R_cam_board), np.asarray(c.t_cam_board), np.asarray(c.K), c.dist) for c in (a, b)
    ]
    inside = ((at[0] > -0.5) & (at[0] < np.array(a.image_size) - 0.5)).all(axis=-1)
    return float(np.linalg.norm(at[0] - at[1], axis=-1)[inside].max(initial=0.0))


# ------------------------------------------------------------------------------------------ rendering


@dataclass(frozen=True)
class Settings:
    """How a reference is rendered. `sampling` as the twin has it: `center` or `area`."""

    samples: int = SAMPLES
    seed: int = 0
    sampling: str = "center"

    def noisy(self, rung: str) -> bool:
        return RUNGS[rung].noisy or (self.sampling == "area" and RUNGS[rung].lit)


def render(scene: Scene, rung: str, settings: Settings, progress: Progress = silent) -> Image:
    """The twin's image, with its surface at the rung `surface` alone; noisy ones in stints that the cache keeps.

    An interrupted render goes on where it stopped. The batches of all stints together give the variance.
    """
    if not settings.noisy(rung):
        image = twin.render(scene, rung, sampling=settings.sampling)
        return replace(image, surface=None) if RUNGS[rung].lit else image
    if settings.samples < 1 or settings.samples % (STINTS * BATCHES):
        raise InputError("samples", f"a multiple of {STINTS * BATCHES}", settings.samples)
    pool = ImagePool()
    samples = settings.samples // STINTS
    for stint in range(STINTS):
        progress(f"{scene.name}/{rung}", stint, STINTS)
        seed = round_seed(settings.seed, stint)
        pool.add(twin.render(scene, rung, sampling=settings.sampling, samples=samples, batches=BATCHES, seed=seed))
    progress(f"{scene.name}/{rung}", STINTS, STINTS)
    return replace(pool.image, surface=None)


def describe(scene: Scene, name: str, hashed: str, rung: str, settings: Settings) -> dict[str, str]:
    """The header's provenance: what made the pixels, by which versions."""
    about = twin.provenance(scene, rung, sampling=settings.sampling, samples=settings.samples, seed=settings.seed)
    about |= {"scene": name, "scene_hash": hashed, "size": "{} x {}".format(*scene.camera.image_size)}
    about["filter"] = "box" if settings.sampling == "area" else "none: all rays through the pixel's centre"
    about["renderer"] = "Mitsuba"
    return about


# ------------------------------------------------------------------------------------------ make


@dataclass(frozen=True, eq=False)
class Change:
    """A reference about to be written, what lay there before (None: nothing, or damaged), and how they differ."""

    new: Reference
    old: Reference | None
    notes: tuple[str, ...] = ()
    comparison: Comparison | None = None

    @property
    def kind(self) -> str:
        """`new`, `damaged`, `same` or `changed`."""
        if self.old is None:
            return "damaged" if self.notes else "new"
        return "same" if self.old.header == self.new.header else "changed"

    def lines(self) -> list[str]:
        """What changes, in words."""
        where = f"{self.new.header['scene']}/{self.new.header['rung']}"
        if self.kind in ("new", "same"):
            return [f"{where}: {self.kind}"]
        lines = [f"{where}: {self.kind}", *(f"  {note}" for note in self.notes)]
        if c := self.comparison:
            r = c.radiance
            lines.append(f"  the new beside the old: {c.verdict}")
            lines += [f"    {reason}" for reason in c.reasons]
            if r.rmse is not None:
                lines.append(f"    rmse {r.rmse:.3g}, worst {r.max_abs:.3g}, ratio of the means {r.mean_ratio:.6g}")
        return lines


def change_of(new: Reference, old: Reference | None, notes: tuple[str, ...] = ()) -> Change:
    """Return how the new differs from the old; `notes`: why there is no old one."""
    if old is None:
        return Change(new, None, notes)
    compared = compare(new.image, old.image, tolerance=new.tolerance)
    return Change(new, old, tuple(header_changes(old.header, new.header)), compared)


def make(
    scene: str | Path,
    rung: str,
    folder: str | Path,
    settings: ReferenceSettings | None = None,
    *,
    found: SceneFile | MitsubaScene | None = None,
    progress: Progress = silent,
    **options: Any,
) -> Change:
    """What the reference would become; `save(change.new)` writes it.

    `options`: fields of ReferenceSettings. An old one that is whole and fits its scene and settings is taken over
    without rendering, unless `again`. `found`: what `find_scene` gave, where it was asked already.
    """
    asked = replace(settings or ReferenceSettings(), **options)
    found = found or find_scene(scene, progress)
    if isinstance(found, MitsubaScene):
        return _made_from_file(found, rung, folder, asked, progress)
    written = files.read_scene(scene)
    path, hashed = path_of(folder, written.name, rung), scene_hash(written)
    old, notes = _there(path)
    known = old if old is not None and old.written is not None else None
    same_scene = known is not None and known.header["scene_hash"] == hashed
    chosen = _settings(known.header if known else {}, asked)
    found = _at_size(found, asked.size or (known.origin().camera.image_size if known and same_scene else None))
    if known and same_scene and _same_but_for_digits(found.scene, known.origin().camera):
        found = found.with_camera(known.origin().camera)
    header = describe(found.scene, written.name, hashed, rung, chosen)
    same = known and not asked.again and all(known.header.get(k) == header[k] for k in _DECIDES)
    if known and same and known.camera == found.camera:
        header |= {k: v for k, v in known.header.items() if k not in ("set_up", "checksum")}
        return Change(sealed(path, known.image, header, found), known)
    return change_of(sealed(path, render(found.scene, rung, chosen, progress), header, found), old, notes)


def _made_from_file(
    found: MitsubaScene, rung: str, folder: str | Path, asked: ReferenceSettings, progress: Progress
) -> Change:
    """As `make`: of a Mitsuba file there is one level of light, LEVEL, and its film decides where rays go."""
    check_one_of("--rung", rung, (LEVEL,))
    if asked.sampling not in (None, "area"):
        raise InputError("--sampling", "area: a Mitsuba file's film decides where rays go", asked.sampling)
    path = path_of(folder, found.name, rung)
    old, notes = _there(path)
    chosen = _settings(old.header if old is not None and old.of_file else {}, replace(asked, sampling="area"))
    width, height = asked.size or (found.image_size if old is None else old.image.shape[1::-1])
    sized = files.with_film(found, width=width, height=height)
    header = twin.mitsuba_provenance(sized, chosen.samples, chosen.seed, STINTS * BATCHES)
    header |= {
        "scene": found.name, "rung": rung, "scene_hash": sized.digest, "size": f"{width} x {height}",
        "sampling": "area", "filter": "the film's own", "renderer": "Mitsuba",
        FILES: msgspec.json.encode(found.files).decode(),
    }  # fmt: skip
    decides = ("scene_hash", "samples", "seed", "size")
    if old is not None and old.of_file and not asked.again and all(old.header.get(k) == header[k] for k in decides):
        return Change(old, old)
    image = twin.render_mitsuba(sized, chosen.samples, chosen.seed, STINTS * BATCHES, progress=progress)
    return change_of(sealed(path, image, header, None), old, notes)


def _there(path: Path) -> tuple[Reference | None, tuple[str, ...]]:
    """What lies there; nothing, and why, where it is damaged."""
    try:
        return (load(path) if path.exists() else None), ()
    except InputError as error:
        return None, (str(error),)


def _settings(had: dict[str, str], asked: ReferenceSettings) -> Settings:
    """What is given, else what the old one had (without noise it tells no samples), else the default."""
    before = int(had.get("samples", 1))
    return Settings(
        asked.samples or (before if before > 1 else SAMPLES),
        int(had.get("seed", 0)) if asked.seed is None else asked.seed,
        asked.sampling or had.get("sampling", "center"),
    )


def _same_but_for_digits(found: Scene, before: Camera) -> bool:
    return before.image_size == found.camera.image_size and moved(found, before, found.camera) <= MOVED_PX


_DECIDES = ("scene_hash", "rung", "sampling", "samples", "seed", "depth", "size")


def header_changes(old: dict[str, str], new: dict[str, str]) -> Iterator[str]:
    """`samples: 4096, was 1024`, for every key that differs."""
    for key in sorted(old.keys() | new.keys()):
        a, b = old.get(key, "nothing"), new.get(key, "nothing")
        if a == b or key == "checksum":
            continue
        if key == "set_up" and "nothing" not in (a, b):
            scenes = (files.to_record(key, msgspec.json.decode(text), SceneFile) for text in (a, b))
            yield from changes(*scenes)
        else:
            yield f"{key}: {b}, was {a}"


# ------------------------------------------------------------------------------------------ check


@dataclass(frozen=True, eq=False)
class Check:
    """What is wrong with a reference (nothing: `problems` is empty), and the render that it was held to.

    `exit_code`: 1 where it disagrees with its scene or with today's render, 2 where that cannot be told: the file is
    missing or damaged, or the comparison is undecided.
    """

    path: Path
    exit_code: int
    problems: tuple[str, ...] = ()
    reference: Reference | None = None
    today: Image | None = None
    comparison: Comparison | None = None

    @property
    def passed(self) -> bool:
        return self.exit_code == 0


def check(
    scene: str | Path,
    rung: str,
    folder: str | Path,
    *,
    budget: Budget = Budget(samples=CHECKED_SAMPLES),  # noqa: B008 (immutable)
    detectable_bias: float | None = None,
    detectable_tile_bias: float | None = None,
    found: SceneFile | MitsubaScene | None = None,
    progress: Progress = silent,
) -> Check:
    """Is the file there and whole, its scene the one on disk, and today's render the same but for noise?

    Today's render comes in rounds, until the verdict is certain or the `budget` is spent; the biases are those of
    SequentialComparison. Its seeds are its own, always the same: the answer changes when the software does, not by
    chance.
    """
    found = found or find_scene(scene, progress)
    path = path_of(folder, found.name, rung)
    try:
        old = load(path)
    except InputError as error:
        return Check(path, 2, (str(error),))
    if why := stale(old, scene) or (None if isinstance(found, MitsubaScene) else strayed(old, found)):
        return Check(path, 1, (f"{path}: stale: {why}",), old)
    sampling, seed = old.header["sampling"], int(old.header["seed"]) + 1
    exact = not isinstance(found, MitsubaScene) and not Settings(sampling=sampling).noisy(rung)
    if exact:
        today = render(old.origin(), rung, Settings(sampling=sampling), progress)
        comparison = compare(today, old.image, tolerance=old.tolerance)
    else:

        def render_round(samples: int, seed: int) -> Image:
            if isinstance(found, MitsubaScene):
                width, height = old.image.shape[1::-1]
                return twin.render_mitsuba(files.with_film(found, width=width, height=height), samples, seed)
            return replace(twin.render(old.origin(), rung, sampling=sampling, samples=samples, seed=seed), surface=None)

        check = SequentialComparison(
            old.image, tolerance=old.tolerance, detectable_bias=detectable_bias,
            detectable_tile_bias=detectable_tile_bias,
        )  # fmt: skip
        names = (f"{path.parent.name}/{rung}", "twin")
        comparison = Rounds(check, render_round, None, seed, Stages(progress), names=names).decide(budget)
        today = check.image("test")
    said = "cannot be told from today's render" if comparison.exit_code == 2 else "today's render disagrees"
    problems = () if comparison.passed else (f"{path}: {said}", *comparison.reasons)
    return Check(path, comparison.exit_code, problems, old, today, comparison)


def strayed(old: Reference, found: SceneFile) -> str | None:
    """Why the reference no longer fits the camera that its scene's photos give today; None where it does."""
    camera = old.origin().camera
    by = moved(found.scene, camera, _at_size(found, camera.image_size).scene.camera)
    return f"today's calibration moves the picture by {by:.2g} px" if by > MOVED_PX else None
