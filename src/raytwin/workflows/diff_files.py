"""Any two image files of any renderers: read, measured, judged. A is tested against the reference B."""

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec

from raytwin import files, references
from raytwin.compare import METRICS, Comparison, Limits, Report, compare, limit_findings, measure
from raytwin.diagnose.diagnosis import explain
from raytwin.errors import InputError
from raytwin.image import Image
from raytwin.image_input import ENDINGS, read_side, renders_at
from raytwin.scene import Scene, Tolerance
from raytwin.workflows.diff_settings import DiffSettings

SLOW = ("flip_hdr", "flip_ldr")
"""Metrics that take longer than all else: only where asked for."""


@dataclass(frozen=True, eq=False)
class Diff:
    """All that `raytwin diff` found. `metrics` has every row of METRICS, null where it has no value.

    `limits` decided where there are any, else `compare` did, by `tolerance` and noise. `warnings` never fail.
    """

    a: Path
    b: Path
    test: Image
    reference: Image
    report: Report
    metrics: dict[str, float | None]
    tolerance: Tolerance
    limits: Limits | None = None
    warnings: tuple[str, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)

    @property
    def comparison(self) -> Comparison:
        return self.report.comparison

    @property
    def passed(self) -> bool:
        return self.comparison.passed

    def numbers(self) -> dict[str, Any]:
        """The comparison's keys, and beside them every metric, the limits and the warnings: what JSON holds."""
        more = {"metrics": self.metrics, "limits": self.limits, "warnings": self.warnings}
        numbers: dict[str, Any] = files.plain(self.report.numbers() | {"seconds": self.report.seconds} | more)
        return numbers


def diff(a: str | Path, b: str | Path, settings: DiffSettings | None = None, **options: Any) -> Diff:
    """Compare the image `a` with the reference `b`: files, or folders or patterns of renders that differ by seed.

    `options` are fields of DiffSettings: `diff(a, b, tolerance=1e-4, flip=True)`.
    """
    chosen = replace(settings or DiffSettings(), **options)
    part, layer, limits = chosen.part, chosen.layer, chosen.limits
    a, b = Path(a), Path(b)
    start = time.perf_counter()
    sides = [
        read_side(path, part, layer, v, n) for path, v, n in zip((a, b), chosen.variances, chosen.samples, strict=True)
    ]
    begins = tuple(files.read_origin(renders_at(path)[0], part) for path in (a, b))
    test, reference = sides[1].fitted(sides[0].image), sides[0].fitted(sides[1].image)
    read = time.perf_counter() - start
    held = Tolerance(p999_abs=chosen.tolerance)
    made = compare(
        test,
        reference,
        tolerance=held,
        false_alarm_rate=chosen.false_alarm_rate,
        flip=chosen.flip,
        noise="both" if sides[0].measured else chosen.noise,
        detectable_bias=chosen.detectable_bias,
        half_steps=(sides[0].rounding.half, sides[1].rounding.half),
    )
    start = time.perf_counter()
    if made.verdict == "fail" and limits is None:
        scene, rung = _scene_of(b, part)
        made = made.because(*explain(test, reference, scene, rung, rounding=sides[0].rounding))
    made = _decided(made, test, reference, limits, begins)
    warned = limit_findings(test, reference, chosen.warn)[0] if chosen.warn is not None and made.passed else []
    metrics = msgspec.structs.asdict(made.radiance)
    metrics |= measure(
        test.mean, reference.mean, [n for n in METRICS if n not in metrics and (chosen.flip or n not in SLOW)]
    )
    seconds = {"read": read, "compare": made.seconds + time.perf_counter() - start}
    of_files = {"A": str(a), "B": str(b), "part": part, "layer": layer}
    decided = _limits_in_words(limits) if limits else {"tolerance": f"{chosen.tolerance:g}"}
    if limits is None and (test.variance is not None or reference.variance is not None):
        decided["false-alarm rate"] = f"{chosen.false_alarm_rate:g}"
    return Diff(
        a=a,
        b=b,
        test=test,
        reference=reference,
        report=Report(f"{a.name} against {b.name}", "", made, seconds),
        metrics={name: metrics.get(name) for name in METRICS},
        tolerance=held,
        limits=limits,
        warnings=tuple(f.text for f in warned),
        settings={k: v for k, v in of_files.items() if v is not None} | decided,
    )


def _scene_of(path: Path, part: str | None) -> tuple[Scene | None, str]:
    """The scene and the rung of a reference that `reference make` has written; None of any other file."""
    if part is not None or path.suffix != ".exr" or not path.is_file():
        return None, "shadow"
    try:
        return references.load(path).scene, path.stem
    except InputError:
        return None, "shadow"


def pairs(a: Path, b: Path) -> list[tuple[str, Path | None, Path | None]]:
    """The images of two folders, and of the folders within, by name: None where one of them lacks it."""
    inside = [{str(p.relative_to(f)): p for p in f.rglob("*") if p.suffix.lower() in ENDINGS} for f in (a, b)]
    names = sorted(inside[0].keys() | inside[1].keys())
    if not names:
        raise InputError(a, "images that are in both folders", "none in either")
    return [(name, inside[0].get(name), inside[1].get(name)) for name in names]


def lacking(name: str, folder: Path) -> Report:
    """The report on an image that one of two folders lacks."""
    return Report(name, "", Comparison("fail", (f"{name} is missing in {folder}",)))


def _decided(
    made: Comparison, test: Image, reference: Image, limits: Limits | None, begins: tuple[tuple[int, int], ...]
) -> Comparison:
    """The comparison with the limits' verdict, where there are any; and pixels at another place always fail."""
    if limits is not None:
        exceeded, counted = limit_findings(test, reference, limits)
        reasons = tuple(f.text for f in exceeded) or (counted,)
        made = msgspec.structs.replace(made, verdict="fail" if exceeded else "pass", reasons=reasons)
    if begins[0] != begins[1]:
        (x, y), (u, v) = begins
        apart = f"A's pixels begin at (x={x}, y={y}) of the display window, B's at (x={u}, y={v})"
        made = msgspec.structs.replace(made, verdict="fail", reasons=(apart, *(() if made.passed else made.reasons)))
    return made


def limits(
    option: str,
    error: float | None = None,
    relative: float | None = None,
    percent: float | None = None,
    hard: float | None = None,
    pixels: int | None = None,
) -> Limits | None:
    """The limits that were given, the others as idiff has them; None where none was. `option` names them in errors."""
    asked = {"error": error, "relative": relative, "percent": percent, "hard": hard, "pixels": pixels}
    given: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
    named = {"error": option, "hard": option.replace("--", "--hard"), "pixels": "--allowfailures"}
    for name, value in given.items():
        if not value >= 0:
            raise InputError(named.get(name, option + name), "a number >= 0", value)
    return Limits(**given) if given else None


def _limits_in_words(limits: Limits) -> dict[str, str]:
    meaning = {
        "error": "a pixel may err by",
        "relative": "and by this share of the value",
        "percent": "percent of the pixels that may err more",
        "pixels": "number of pixels that may err more",
        "hard": "no pixel may err by more than",
    }
    return {text: f"{getattr(limits, name):g}" for name, text in meaning.items()}
