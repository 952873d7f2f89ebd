"""Several renderers on several scenes: a comparison per cell, each stored under a hash of all that decides it."""

import hashlib
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import scipy.stats

import raytwin
from raytwin import files, references
from raytwin.compare import Comparison
from raytwin.compare.scale import scaled
from raytwin.contract.subject import find_subject
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.scene import MitsubaScene, Tolerance
from raytwin.workflows.compare_mitsuba import compare_with_reference
from raytwin.workflows.compare_scene import Result, compare_scene
from raytwin.workflows.make_reference import read_scene
from raytwin.workflows.settings import OF_MANY, CompareSettings

RATE = 1e-3
"""False-alarm rate from which the distance to the limit is measured."""
ROOT = Path(raytwin.__file__).parent
NAMED = re.compile(r"(\w[\w .-]*)=(.+)", re.DOTALL)
"""NAME=WHAT, where a subject is given a shorter name."""


class Job(NamedTuple):
    """A cell that is to be made. `references`: a folder of references in the twin's place; None for the twin."""

    name: str
    scene: str
    scene_name: str
    settings: CompareSettings
    references: Path | None
    key: str


class Cell(msgspec.Struct, frozen=True):
    """What came of one comparison. `verdict` is "error" where there is none; `reason` then says why.

    `margin`: the error by what is allowed, of images without noise; else the whole image's deviation by what noise may
    have: 1 is the limit. `seconds`: of the subject's render, `twin_seconds`: of the twin's, `other_seconds`: of all
    else. `thumbnail`: the difference, a data URL; `report`: the whole report, from the page's folder.
    """

    key: str
    scene: str
    subject: str
    rung: str
    verdict: str
    reason: str = ""
    cause: str = ""
    rmse: float | None = None
    relmse: float | None = None
    p999_abs: float | None = None
    margin: float | None = None
    seconds: float | None = None
    twin_seconds: float | None = None
    other_seconds: float | None = None
    made: str = ""
    thumbnail: str = ""
    report: str = ""

    @property
    def exit_code(self) -> int:
        """As of a comparison: 0 passes or differs as expected, 1 fails, 2 is undecided or no comparison."""
        return {"pass": 0, "differs": 0, "fail": 1}.get(self.verdict, 2)


def read_list(path: str | Path) -> tuple[list[str], list[str], dict[str, Any]]:
    """A TOML file's `scenes`, its `[subjects]` (name = "what") or list, and its settings, as options have them."""
    given = files.read_toml(path)
    scenes, subjects = given.pop("scenes", []), given.pop("subjects", [])
    if isinstance(subjects, Mapping):
        subjects = [f"{name}={what}" for name, what in subjects.items()]
    for key, value in (("scenes", scenes), ("subjects", subjects)):
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise InputError(f"{path}: {key}", "a list of texts, or a table of them", repr(value)[:60])
    for key in given:
        if key not in OF_MANY:
            raise files.unknown_key(path, key, ("scenes", "subjects", *OF_MANY))
    return [str(scene) for scene in scenes], list(subjects), given


def with_settings(settings: CompareSettings, given: Mapping[str, Any], where: str | Path) -> CompareSettings:
    """The settings with those of a file in the place of defaults: what the command line says stays."""
    usual = CompareSettings()
    chosen = {name: value for name, value in given.items() if getattr(settings, name) == getattr(usual, name)}
    if isinstance(size := chosen.get("size"), str):
        match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", size)
        if not match:
            raise InputError(f"{where}: size", "WIDTHxHEIGHT in pixels, as 640x480", size)
        chosen["size"] = (int(match[1]), int(match[2]))
    if isinstance(chosen.get("light"), str):
        chosen["light"] = Path(where).parent / chosen["light"]
    return replace(settings, **chosen)


def jobs_of(
    scenes: Sequence[str | Path], subjects: Sequence[str], settings: CompareSettings, folder: Path | None = None
) -> list[Job]:
    """Return a job for each scene and subject; `folder`: references in the twin's place.

    Raises InputError for scenes and subjects that cannot be, before anything is rendered.
    """
    if not scenes or not subjects:
        what = "--subject" if scenes else "SCENE"
        raise InputError(what, "at least one", "none")
    light = ""
    if settings.light is not None:
        if folder is not None:
            raise InputError("--light", "no --references beside it: these have their scene's own light", settings.light)
        from raytwin.calib.lighting.light_file import read_light  # with OpenCV

        light = repr(read_light(settings.light))
        settings = replace(settings, light=str(Path(settings.light).absolute()))
    code = files.made_by((ROOT,), ("mitsuba", "drjit", "numpy"))
    asked = repr([getattr(settings, name) for name in OF_MANY])
    known = {}
    for text in subjects:
        match = NAMED.fullmatch(text)
        name, what = (match[1].strip(), match[2]) if match and not Path(text).exists() else (text, text)
        if name in known:
            raise InputError("--subject", "names that differ (NAME=WHAT)", name)
        find_subject(what, settings.rung)  # for its checks
        known[name] = what
    jobs, folder = [], folder and folder.absolute()
    for scene, (name, what) in product(scenes, known.items()):
        path = files.find_scene(scene)
        title, content = _scene_of(path)
        parts = (code, content, _content(what), asked, str(folder or ""), light)
        key = hashlib.sha256("\0".join((*parts, name)).encode()).hexdigest()[:24]
        chosen = replace(settings, subject=what, parts=False)
        jobs.append(Job(name, str(path.absolute()), title, chosen, folder, key))
    return jobs


def judge(job: Job) -> tuple[Cell, Result | None]:
    """Make one cell: the comparison and what the page needs of it; an InputError becomes a cell without one."""
    began = time.perf_counter()
    try:
        if job.references is not None:
            result = compare_with_reference(job.scene, job.settings, job.references)
        else:
            result = compare_scene(job.scene, job.settings)
    except InputError as error:
        return failed(job, error), None
    found, spent = result.comparison, result.report.seconds
    renders = spent.get("tracer", 0.0), spent.get("twin", 0.0)
    rendering = sum(renders)
    radiance = found.radiance
    said = [reason for reason in found.reasons if not reason.startswith("cause")]
    return Cell(
        job.key,
        job.scene_name,
        job.name,
        result.report.rung or "",
        found.verdict,
        said[0] if said else "",
        found.cause,
        radiance.rmse,
        radiance.relmse,
        radiance.p999_abs,
        margin(found, result.test, result.reference, result.tolerance),
        *renders,
        time.perf_counter() - began - rendering,
        datetime.now(UTC).isoformat(timespec="seconds"),
    ), result


def failed(job: Job, error: Exception) -> Cell:
    """The cell of a comparison that could not be made."""
    name = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return Cell(job.key, job.scene_name, job.name, job.settings.rung, "error", f"{name}{error}", made=now)


def margin(found: Comparison, test: Image, reference: Image, tolerance: Tolerance) -> float | None:
    """How near to its limit a comparison is: 1 is the limit. None where nothing tells."""
    z = found.statistics.z_mean
    if z is not None:
        return abs(z) / float(scipy.stats.norm.isf(RATE / 6))  # both sides of three channels
    if found.radiance.p999_abs is None or test.shape != reference.shape:
        return None
    return found.radiance.p999_abs / scaled(tolerance, reference, test).p999_abs


def _scene_of(path: Path) -> tuple[str, str]:
    """Its name, and a hash of all that it is."""
    found = read_scene(path)
    if isinstance(found, MitsubaScene):
        return found.name, found.digest
    return found.name, references.scene_hash(found) + repr(found.tolerance)


def _content(what: str) -> str:
    """A subject's text, with a hash of every file that it names: a changed program is another one."""
    words = [what, what.rpartition(":")[0], *what.split()]
    found = [Path(word) for word in dict.fromkeys(words) if word and Path(word).is_file()]
    folder = sorted(Path(what).iterdir()) if Path(what).is_dir() else []
    hashes = [hashlib.sha256(file.read_bytes()).hexdigest() for file in (*found, *folder) if file.is_file()]
    return "\n".join((what, *hashes))
