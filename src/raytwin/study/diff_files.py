"""Any two images of any renderers: read, measured, judged. A is tested against the reference B."""

import os
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import msgspec
import numpy as np

from raytwin.compare import METRICS, Comparison, Report, Verdict, measure
from raytwin.compare import compare as compare_images
from raytwin.compare.finding import at, notes
from raytwin.errors import InputError
from raytwin.images.image import Image
from raytwin.images.image_input import ENDINGS, LoadedImage, as_image, read_side
from raytwin.judging import DiffSettings
from raytwin.notebook import InNotebook
from raytwin.renderers import references
from raytwin.renderers.references import Reference
from raytwin.scene import Scene, Tolerance
from raytwin.scene.scene_files import read_scene
from raytwin.scene.toml_json import plain

if TYPE_CHECKING:
    from raytwin.explain.ledger import Ledger
    from raytwin.photos import camera  # with OpenCV, which a scene whose camera is given needs not


@dataclass(frozen=True, eq=False, kw_only=True)
class Compared(InNotebook):
    """The image `test` beside its `reference`, and all that is known of them.

    `photo` and `augmented`, the same with the scene's objects in it, are sRGB uint8. `pose`: the photo's
    view in the `calibration`.
    """

    made_by: ClassVar[str] = "compare"

    test: Image
    reference: Image
    report: Report
    tolerance: Tolerance
    settings: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    photo: np.ndarray | None = None
    augmented: np.ndarray | None = None
    calibration: "camera.Calibration | None" = None
    pose: "camera.View | None" = None
    ledger: "Ledger | None" = None

    @property
    def comparison(self) -> Comparison:
        return self.report.comparison

    @property
    def verdict(self) -> Verdict:
        """The answer: "pass", "differs", "fail" or "undecided"."""
        return self.comparison.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons in words, the cause first where one is named."""
        return self.comparison.reasons

    @property
    def cause(self) -> str:
        """The named cause; empty where none is known."""
        return self.comparison.cause

    @property
    def passed(self) -> bool:
        return self.comparison.passed

    @property
    def noisy(self) -> bool:
        """One of the two has noise, so that a single error means little."""
        return self.test.variance is not None or self.reference.variance is not None

    @property
    def worth(self) -> dict[str, str]:
        """What the result of a stage is worth, to be shown beside its seconds."""
        p999 = self.comparison.radiance.p999_abs
        return {
            "calibrate": f"rms {self.calibration.rms_px:.3f} px" if self.calibration else "camera given",
            "tracer": "no error: not all values are numbers" if p999 is None else f"p99.9 error {p999:.2g}",
            "twin": "the reference",
        }

    def table(self) -> list[dict[str, Any]]:
        """Return the ledger, a row per part of the light: what `pandas.DataFrame` takes."""
        return [part.to_dict() for part in self.report.ledger or ()]

    def numbers(self) -> dict[str, Any]:
        """Return what the JSON holds."""
        return self.report.numbers()

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain values."""
        values: dict[str, Any] = plain(self.numbers())
        return values

    def __repr__(self) -> str:
        because = f": {self.cause or self.reasons[0]}" if self.reasons else ""
        level = f", light level {self.report.rung}" if self.report.rung else ""
        return f"<raytwin.{self.made_by} {self.verdict.upper()} {self.report.scene}{level}{because}>"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Diff(Compared):
    """All that `raytwin.compare` found. `metrics` has every row of METRICS, None where it has no value.

    `a`, `b`: what the two are called.
    """

    a: str
    b: str
    metrics: dict[str, float | None]

    def numbers(self) -> dict[str, Any]:
        """The comparison's keys, and beside them every metric: what JSON holds."""
        more = {"seconds": self.report.seconds, "metrics": self.metrics}
        numbers: dict[str, Any] = plain(self.report.numbers() | more)
        return numbers


class Side(NamedTuple):
    """One of two images: what it is called, its pixels, its scene and rung, where these are known."""

    name: str
    loaded: LoadedImage
    scene: Scene | None = None
    rung: str | None = None
    tolerance: Tolerance | None = None


def compare(a: Any, b: Any, settings: DiffSettings | None = None, **options: Any) -> Diff:
    """Compare the image `a` with the reference `b`: verdict, cause, metrics, and pictures in a notebook.

    Each of the two is an array (H, W, 3) of linear radiance, row 0 on top (NumPy, torch, Dr.Jit, Mitsuba's TensorXf and
    Bitmap); an Image; a path to an EXR, PFM or 8-bit picture, to a folder or a pattern of renders; a list or an array
    (k, H, W, 3) of at least 4 independent renders; a function `render(seed)`, called 8 times; or a `reference`.

    `settings` or `options`: fields of DiffSettings, as `tolerance=1e-4`, `variances=(v, None)`, `flip=True`. Where the
    scene is known, from a reference or by `scene=` and `rung=`, a failure names its cause among all faults of the
    catalogue. Raises InputError for what is no image. Images of different sizes, NaN and infinity fail.

    >>> import numpy as np
    >>> grey = np.full((8, 8, 3), 0.5)
    >>> compare(grey, grey)
    <raytwin.compare PASS image against reference: the images agree: 99.9 % of the values to 0 (allowed 5e-06), all to
    0>
    >>> compare(1.1 * grey, grey).verdict
    'fail'
    """
    chosen = replace(settings or DiffSettings(), **options)
    start = time.perf_counter()
    test_side, reference_side = (
        _side(thing, name, chosen, i) for i, (thing, name) in enumerate(((a, "image"), (b, "reference")))
    )
    if test_side.name == reference_side.name:
        names = told_apart(a, b) if _is_path(a) and _is_path(b) else ("image", "reference")
        test_side, reference_side = test_side._replace(name=names[0]), reference_side._replace(name=names[1])
    made_of = test_side.loaded, reference_side.loaded
    test, reference = made_of[1].fitted(made_of[0].image), made_of[0].fitted(made_of[1].image)
    read = time.perf_counter() - start
    limit = chosen.bounds
    if reference_side.tolerance is not None and chosen.tolerance == DiffSettings.tolerance:
        limit = reference_side.tolerance
    made = compare_images(
        test,
        reference,
        replace(chosen.judging, tolerance=limit, noise="both" if made_of[0].measured else chosen.noise),
        flip=chosen.flip,
        half_steps=(made_of[0].rounding.half, made_of[1].rounding.half),
    )
    start = time.perf_counter()
    if made.verdict == "fail":
        from raytwin.explain.diagnosis import explain  # what passes needs no cause

        scene, rung = _known_scene(chosen, reference_side, test)
        rounding, of_reference = (loaded.rounding for loaded in made_of)
        made = made.because(*explain(test, made_of[1].image, scene, rung, rounding, of_reference=of_reference))
    made = _in_place(made, test.begins, reference.begins)
    metrics = msgspec.structs.asdict(made.radiance) | {"flip_hdr": made.perceptual.flip_mean}
    metrics |= measure(test.mean, reference.mean, [n for n in METRICS if n not in metrics])
    seconds = {"read": read, "compare": made.seconds + time.perf_counter() - start}
    of_files = {"A": _named(a), "B": _named(b), "layer": chosen.layer}
    decided = {"tolerance": f"{limit.p999_abs:g}"}
    if test.variance is not None or reference.variance is not None:
        decided["false-alarm rate"] = f"{chosen.false_alarm_rate:g}"
    told = [
        note
        for thing, side in ((a, test_side), (b, reference_side))
        if not _is_path(thing)
        for note in side.loaded.notes
    ]
    return Diff(
        a=test_side.name,
        b=reference_side.name,
        test=test,
        reference=reference,
        report=Report(f"{test_side.name} against {reference_side.name}", "", made, seconds).saying(*told),
        metrics={name: metrics.get(name) for name in METRICS},
        tolerance=limit,
        settings={k: v for k, v in of_files.items() if v is not None} | decided,
    )


def _side(thing: Any, name: str, chosen: DiffSettings, i: int) -> Side:
    """Read the first (i = 0) or second (1) of the two images; `name`: what it is called where it has no name."""
    if isinstance(thing, Reference):
        title = f"{thing.path.parent.name}/{thing.path.stem}"
        return Side(title, LoadedImage(thing.image), scene=thing.scene, rung=thing.path.stem, tolerance=thing.tolerance)
    if not _is_path(thing):
        own = getattr(thing, "__name__", name)
        loaded = as_image(thing, chosen.variances[i], chosen.renders)
        image = replace(loaded.image, samples=loaded.image.samples or chosen.samples[i])
        return Side(own, loaded._replace(image=image))
    path = Path(thing)
    loaded = read_side(path, chosen.layer, chosen.variances[i], chosen.samples[i])
    return Side(path.name, loaded, *(_scene_of(path) if i else ()))


def told_apart(a: str | Path, b: str | Path) -> tuple[str, str]:
    """The shortest ends of two paths that differ; their names where the paths are equal."""
    parts = Path(a).parts, Path(b).parts
    ends = [(str(Path(*parts[0][-k:])), str(Path(*parts[1][-k:]))) for k in range(1, 1 + max(map(len, parts)))]
    return next((pair for pair in ends if pair[0] != pair[1]), (Path(a).name, Path(b).name))


def _is_path(thing: Any) -> bool:
    return isinstance(thing, str | os.PathLike)


def _named(thing: Any) -> str | None:
    """Return the path, as the page's settings have it; None for what is no file."""
    return str(thing) if _is_path(thing) else str(thing.path) if isinstance(thing, Reference) else None


def _known_scene(chosen: DiffSettings, reference: Side, test: Image) -> tuple[Scene | None, str]:
    """Return the scene and rung that were named, at the image's size, else the reference's own."""
    rung = chosen.rung or reference.rung or "shadow"
    if chosen.scene is None:
        return reference.scene, rung
    height, width = test.shape[:2]
    return read_scene(chosen.scene).with_(size=(width, height)), rung


def _scene_of(path: Path) -> tuple[Scene | None, str | None]:
    """The scene and the rung of a reference that `reference make` has written; None of any other file."""
    if path.suffix != ".exr" or not path.is_file():
        return None, None
    try:
        return references.load(path).scene, path.stem
    except InputError:
        return None, None


def pairs(a: Path, b: Path) -> list[tuple[str, Path | None, Path | None]]:
    """The images of two folders, and of the folders within, by name: None where one of them lacks it."""
    inside = [{str(p.relative_to(f)): p for p in f.rglob("*") if p.suffix.lower() in ENDINGS} for f in (a, b)]
    names = sorted(inside[0].keys() | inside[1].keys())
    if not names:
        raise InputError(a, "images that are in both folders", "none in either")
    return [(name, inside[0].get(name), inside[1].get(name)) for name in names]


def lacking(name: str, folder: Path) -> Report:
    """The report on an image that one of two folders lacks."""
    return Report(name, "", Comparison("fail", notes([f"{name} is missing in {folder}"])))


def _in_place(made: Comparison, a: tuple[int, int], b: tuple[int, int]) -> Comparison:
    """Fail the comparison of pixels that begin at different places of their display windows."""
    if a == b:
        return made
    apart = f"A's pixels begin at {at(*a)} of the display window, B's at {at(*b)}"
    return made.judged("fail", *notes([apart]), *(() if made.passed else made.findings))
