"""References: images of known worth in EXR files, `<folder>/<scene>/<rung>.exr`, with which later renders are compared.

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

from raytwin import twin
from raytwin.compare import Comparison, Judging, SequentialComparison, compare
from raytwin.errors import InputError, check_one_of
from raytwin.images.image import Image
from raytwin.images.image_pool import ImagePool
from raytwin.progress import Progress, Stages, silent
from raytwin.renderers.references import FILES, Reference, load, path_of, scene_hash, sealed, stale
from raytwin.rungs import RUNGS
from raytwin.scene import MitsubaScene, Scene
from raytwin.scene.mitsuba_file import is_mitsuba, read_mitsuba
from raytwin.scene.scene_files import scene_and_photos
from raytwin.scene.toml_json import to_record
from raytwin.study.rounds import Budget, Rounds, round_seed
from raytwin.study.settings import ReferenceSettings

PIXELS = 336 * 252
"""Pixels of a reference, about: shadows' edges are still some pixels apart, and all files fit a repository."""
SAMPLES, CHECKED_SAMPLES = 4096, 256
STINTS, BATCHES = 8, 8
"""A long render is made in STINTS pieces of BATCHES independent batches; each piece is cached when it is done."""
BESIDE_THE_OLD = {"pass": "agrees with the old", "fail": "differs from the old", "undecided": "may differ from the old"}
LEVEL_OF_FILES = "path"
"""The light level that the reference of a Mitsuba file is stored under; its integrator decides what it is."""
IN_THE_FILE = "the size in the file's <film>, which every renderer of the file reads"


def size_of(image_size: tuple[int, int]) -> tuple[int, int]:
    """(width, height) of about PIXELS pixels in the camera's aspect ratio; never more than the camera has."""
    width, height = image_size
    if width * height <= PIXELS:
        return image_size
    small = max(1, round(math.sqrt(PIXELS * width / height)))
    return small, max(1, round(small * height / width))


def read_scene(path: str | Path) -> Scene | MitsubaScene:
    """The scene as it is written: raytwin's own, whose camera may stand nowhere yet, or a Mitsuba file."""
    return read_mitsuba(path) if is_mitsuba(path) else scene_and_photos(path)[0]


def find_scene(path: str | Path, progress: Progress = silent) -> Scene | MitsubaScene:
    """The scene with its camera found: calibrated, where it has photos. Finding it once serves all rungs."""
    if is_mitsuba(path) or scene_and_photos(path)[1] is None:
        return read_scene(path)
    from raytwin.photos.find_camera import find_camera

    return find_camera(path, progress=progress)[0]


def render(
    scene: Scene, rung: str, sampling: str, samples: int = SAMPLES, seed: int = 0, progress: Progress = silent
) -> Image:
    """The twin's image, with its surface at the rung `surface` alone; noisy ones in stints that the cache keeps.

    An interrupted render goes on where it stopped. The batches of all stints together give the variance.
    """
    if not RUNGS[rung].sampled(sampling):
        image = twin.render(scene, rung, sampling=sampling)
        return replace(image, surface=None) if RUNGS[rung].lit else image
    if samples < 1 or samples % (STINTS * BATCHES):
        raise InputError("samples", f"a multiple of {STINTS * BATCHES}", samples)
    pool = ImagePool()
    for stint in range(STINTS):
        progress(f"{scene.name}/{rung}", stint, STINTS)
        own = round_seed(seed, stint)
        pool.add(twin.render(scene, rung, sampling=sampling, samples=samples // STINTS, batches=BATCHES, seed=own))
    progress(f"{scene.name}/{rung}", STINTS, STINTS)
    return replace(pool.image, surface=None)


def describe(
    placed: Scene | MitsubaScene, hashed: str, rung: str, sampling: str, samples: int, seed: int
) -> dict[str, str]:
    """The header's provenance: what made the pixels, by which versions; `hashed`: raytwin's scene as it is written."""
    if isinstance(placed, MitsubaScene):
        size, kernel, hashed = placed.image_size, "the film's own", placed.digest
        about = twin.mitsuba_provenance(placed, samples, seed, STINTS * BATCHES)
        about |= {"rung": rung, "sampling": "area", FILES: msgspec.json.encode(placed.files).decode()}
    else:
        size = placed.camera.image_size
        kernel = "box" if sampling == "area" else "none: all rays through the pixel's centre"
        about = twin.provenance(placed, rung, sampling=sampling, samples=samples, seed=seed)
    about |= {"scene": placed.name, "scene_hash": hashed, "size": "{} x {}".format(*size)}
    return about | {"filter": kernel, "renderer": "Mitsuba"}


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
        if self.comparison:
            r = self.comparison.radiance
            lines += [f"  {BESIDE_THE_OLD[self.comparison.verdict]}", *(f"    {s}" for s in self.comparison.reasons)]
            if r.rmse is not None:
                lines.append(f"    rmse {r.rmse:.3g}, worst {r.max_abs:.3g}, ratio of the means {r.mean_ratio:.6g}")
        return lines


def make(
    scene: str | Path,
    rung: str,
    folder: str | Path,
    settings: ReferenceSettings | None = None,
    *,
    found: Scene | MitsubaScene | None = None,
    progress: Progress = silent,
    **options: Any,
) -> Change:
    """Return what the reference would become; `save(change.new)` writes it.

    `options`: fields of ReferenceSettings. An old one that is whole and fits its scene and settings is taken over
    without rendering, unless `again`; the camera that it has stays while its scene is the same. A Mitsuba file
    has the one level LEVEL_OF_FILES, and its film decides where rays go. `found`: what `find_scene` returned, if it was
    called already.
    """
    asked, found = replace(settings or ReferenceSettings(), **options), found or find_scene(scene, progress)
    of_file = isinstance(found, MitsubaScene)
    if of_file:
        check_one_of("--rung", rung, (LEVEL_OF_FILES,))
        if asked.sampling not in (None, "area"):
            raise InputError("--sampling", "area: a Mitsuba file's film decides where rays go", asked.sampling)
        asked = replace(asked, sampling="area")
    path = path_of(folder, found.name, rung)
    old, notes = _stored(path)
    known = old if old is not None and not old.golden and old.of_file == of_file else None
    how = _sampling(known.header if known else {}, asked)
    hashed = "" if of_file else scene_hash(scene)
    placed = _placed(found, asked.size, known, hashed)
    header = describe(placed, hashed, rung, *how)
    sealed_scene = None if isinstance(placed, MitsubaScene) else placed
    if known and not asked.again and all(known.header.get(key) == header.get(key) for key in _DECIDES):
        header |= {k: v for k, v in known.header.items() if k not in ("set_up", "checksum")}
        return Change(sealed(path, known.image, header, sealed_scene), known)
    if isinstance(placed, MitsubaScene):
        image = twin.render_mitsuba(placed, *how[1:], STINTS * BATCHES, progress=progress)
    else:
        image = render(placed, rung, *how, progress)
    return _change(sealed(path, image, header, sealed_scene), old, notes)


def accept(new: Reference, folder: str | Path, because: str = "") -> Change:
    """Return what the folder's reference would become: the `new` one, with the reason in its header."""
    header = {k: v for k, v in new.header.items() if k != "because"} | ({"because": because} if because else {})
    path = path_of(folder, header["scene"], header["rung"])
    return _change(sealed(path, new.image, header, new.scene), *_stored(path))


def _change(new: Reference, old: Reference | None, notes: tuple[str, ...]) -> Change:
    if old is None:
        return Change(new, None, notes)
    compared = compare(new.image, old.image, tolerance=new.tolerance)
    return Change(new, old, tuple(header_changes(old.header, new.header)), compared)


def _stored(path: Path) -> tuple[Reference | None, tuple[str, ...]]:
    """Return the reference at the path; None without one, and why where it is damaged."""
    try:
        return (load(path) if path.exists() else None), ()
    except InputError as error:
        return None, (str(error),)


def _sampling(had: dict[str, str], asked: ReferenceSettings) -> tuple[str, int, int]:
    """Sampling, samples and seed: as asked, else as the old one had (1 sample: it has no noise), else the defaults."""
    before = int(had.get("samples", 1))
    samples = asked.samples or (before if before > 1 else SAMPLES)
    return asked.sampling or had.get("sampling", "center"), samples, int(had.get("seed", 0))


def _placed(
    found: Scene | MitsubaScene, size: tuple[int, int] | None, known: Reference | None, hashed: str
) -> Scene | MitsubaScene:
    """The scene at the size that is asked for, else the known one's, whose camera stays while the scene is the same."""
    if isinstance(found, MitsubaScene):
        if size not in (None, found.image_size):
            raise InputError("--size", IN_THE_FILE, "{} x {}".format(*size))
        return found
    before = None if known is None else known.origin().camera
    if before and known and known.header["scene_hash"] == hashed and size in (None, before.image_size):
        return found.with_camera(before)
    width, height = before.image_size if before else size_of(found.camera.image_size)
    if round(width * found.camera.height / found.camera.width) != height:  # it has another aspect ratio now
        width, height = size_of(found.camera.image_size)
    return found.with_camera(found.camera.resized(*(size or (width, height))))


_DECIDES = ("scene_hash", "rung", "sampling", "samples", "seed", "depth", "size")


def header_changes(old: dict[str, str], new: dict[str, str]) -> Iterator[str]:
    """`samples: 4096 (before: 1024)`, for every key that differs."""
    for key in sorted(old.keys() | new.keys()):
        a, b = old.get(key, "none"), new.get(key, "none")
        if a == b or key == "checksum":
            continue
        if key == "set_up" and "none" not in (a, b):
            before, now = (to_record(key, msgspec.json.decode(text), Scene) for text in (a, b))
            yield f"scene: now other {', '.join(now.differences(before))}"
        else:
            yield f"{key}: {b} (before: {a})"


@dataclass(frozen=True, eq=False)
class Check:
    """What is wrong with a reference (nothing: `problems` is empty), and the render that it was compared with.

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
    judging: Judging | None = None,
    found: Scene | MitsubaScene | None = None,
    progress: Progress = silent,
) -> Check:
    """Is the file there and whole, its scene the one on disk, and today's render the same but for noise?

    Today's render comes in rounds, until the verdict is certain or the `budget` is spent. `judging`: how, but for the
    tolerance, which is the reference's. Its seeds are its own, always the same: the answer changes when the software
    does, not by chance.
    """
    found = found or read_scene(scene)
    path = path_of(folder, found.name, rung)
    try:
        old = load(path)
    except InputError as error:
        return Check(path, 2, (str(error),))
    if why := stale(old, scene):
        return Check(path, 1, (f"{path}: stale: {why}",), old)
    sampling, seed = old.header["sampling"], int(old.header["seed"]) + 1

    def render_round(samples: int, seed: int) -> Image:
        if isinstance(found, MitsubaScene):
            return twin.render_mitsuba(found, samples, seed)
        return replace(twin.render(old.origin(), rung, sampling=sampling, samples=samples, seed=seed), surface=None)

    if not isinstance(found, MitsubaScene) and not RUNGS[rung].sampled(sampling):
        today = render(old.origin(), rung, sampling, progress=progress)
        comparison = compare(today, old.image, tolerance=old.tolerance)
    else:
        check = SequentialComparison(old.image, judging=judging, tolerance=old.tolerance)
        comparison = Rounds(check, render_round, None, seed, Stages(progress)).decide(budget)
        today = check.image("test")
    said = "cannot be told from today's render" if comparison.exit_code == 2 else "today's render disagrees"
    problems = () if comparison.passed else (f"{path}: {said}", *comparison.reasons)
    return Check(path, comparison.exit_code, problems, old, today, comparison)
