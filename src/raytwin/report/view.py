"""What a page shows of two images, whoever made them: the tracer beside its twin, or any A beside any B."""

from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from raytwin.compare import METRICS, Comparison, Report, scaled
from raytwin.compare.report import Timing
from raytwin.compare.scale import scale_of
from raytwin.image import Image, Surface
from raytwin.report import numbers
from raytwin.scene import Tolerance
from raytwin.workflows.diff_files import Diff

if TYPE_CHECKING:
    from raytwin.analysis.ledger import Ledger
    from raytwin.calib.find_camera import TruthRow
    from raytwin.calib.photos import Calibration, PoseReport
    from raytwin.workflows.compare_scene import Result


@dataclass(frozen=True)
class Names:
    """How the two images are called: in a table's cell, in a sentence, above their pictures."""

    test: str
    reference: str
    the_test: str
    the_reference: str
    test_title: str
    reference_title: str


TWINS = Names("tracer", "twin", "the tracer", "the twin", "Tracer's image", "Twin's image")


@dataclass(frozen=True)
class Tile:
    """A large number under the verdict: what it is, its value in words, its unit, and a line below."""

    what: str
    value: str
    unit: str = ""
    below: str = ""


@dataclass(frozen=True, eq=False)
class PairView:
    """Two images and their comparison, ready for the page.

    `report` is None where nothing was judged; `tolerance` where something else than it decided: `held_to` says what
    did. `about` is a word and the name it introduces (rung, shadow). `objects` names `surface.ids` from 0 on.
    `metrics` are further ones: name, value, formula. `ledger`: its parts are maps in the viewer.
    """

    title: str
    report: Report | None
    test: Image
    reference: Image
    names: Names
    tolerance: Tolerance | None
    held_to: str
    motto: str
    about: tuple[str, str] = ("", "")
    tiles: tuple[Tile, ...] = ()
    objects: tuple[str, ...] = ()
    photo: np.ndarray | None = None
    augmented: np.ndarray | None = None
    calibration: "Calibration | None" = None
    pose: "PoseReport | None" = None
    truth: "tuple[TruthRow, ...]" = ()
    times: tuple[Timing, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    metrics: tuple[tuple[str, float | None, str], ...] = ()
    ledger: "Ledger | None" = None

    @property
    def comparison(self) -> Comparison | None:
        return self.report.comparison if self.report else None

    @property
    def flipped(self) -> bool:
        """FLIP was asked for, and has a value."""
        return self.comparison is not None and self.comparison.perceptual.flip_mean is not None

    @property
    def scale(self) -> float:
        """What the tolerance is relative to."""
        return scale_of(self.reference, self.test)

    @property
    def noisy(self) -> bool:
        """One of the two has noise, so that a single error means little."""
        return self.test.variance is not None or self.reference.variance is not None

    @property
    def rough(self) -> bool:
        """Single errors mean little: there is noise, or these are photos, which nothing judged."""
        return self.noisy or self.report is None

    @property
    def alike(self) -> bool:
        """Both are pictures of one size: only then is there an error to show."""
        return showable(self.test) and showable(self.reference) and self.test.shape == self.reference.shape

    @property
    def surfaces(self) -> tuple[Surface, Surface] | None:
        """What each pixel of the two sees, where both tell it."""
        a, b, shape = self.test.surface, self.reference.surface, self.reference.shape[:2]
        return (a, b) if a is not None and b is not None and np.shape(a.ids) == np.shape(b.ids) == shape else None

    @property
    def photographed(self) -> str | None:
        """The photo whose pose the camera has."""
        return PurePath(self.pose.photo).name if self.pose else None


def showable(image: Image) -> bool:
    """Numbers of shape (H, W, 3) with pixels in it."""
    x = image.mean
    return isinstance(x, np.ndarray) and x.dtype.kind in "fiub" and x.ndim == 3 and x.shape[2] == 3 and x.size > 0


def view_of(result: "Result") -> PairView:
    """The tracer beside its twin."""
    c, about = result.comparison, result.report
    tolerance = in_radiance(result.tolerance, result.twin, result.subject)
    return PairView(
        title=about.scene,
        about=("rung", about.rung) if about.rung else ("of", "a Mitsuba file"),
        report=about,
        test=result.subject,
        reference=result.twin,
        names=TWINS,
        tolerance=tolerance,
        held_to="the scene's tolerance",
        motto="a hand-written ray tracer beside its Mitsuba twin",
        objects=result.scene.names,
        photo=result.photo,
        augmented=result.augmented,
        calibration=result.calibration,
        pose=result.pose,
        truth=result.truth,
        times=result.times,
        settings=result.settings,
        versions=result.versions,
        ledger=result.ledger,
        tiles=(
            silhouette_tile(c, tolerance),
            Tile(
                "Radiance error, 99.9 %",
                numbers.shown(c.radiance.p999_abs),
                below="noise included"
                if result.subject.variance is not None or result.twin.variance is not None
                else f"held to {numbers.short(tolerance.p999_abs)}",
            ),
            Tile(
                "Tracer", numbers.seconds(about.seconds.get("tracer")), below=f"RMSE {numbers.shown(c.radiance.rmse)}"
            ),
            Tile(
                "Twin",
                numbers.seconds(about.seconds.get("twin")),
                below=f"{result.twin.samples} sample{'s' * (result.twin.samples != 1)} a pixel",
            ),
        ),
    )


def in_radiance(tolerance: Tolerance, reference: Image, test: Image) -> Tolerance:
    """The tolerance as the comparison of the two images holds it, where they are pictures."""
    return scaled(tolerance, reference, test) if showable(reference) and showable(test) else tolerance


def silhouette_tile(comparison: Comparison, tolerance: Tolerance) -> Tile:
    apart = comparison.geometry.mask_mismatch_pixels
    unit = "pixel differs" if apart == 1 else "pixels differ"
    return Tile("Silhouettes", numbers.shown(apart), unit, f"held to {tolerance.mask_pixels}")


def view_of_diff(found: Diff) -> PairView:
    """A beside B, whoever rendered them."""
    r = found.comparison.radiance
    noisy = found.test.variance is not None or found.reference.variance is not None
    held = None if found.limits else in_radiance(found.tolerance, found.reference, found.test)
    below = "noise included" if noisy else "" if held is None else f"held to {numbers.short(held.p999_abs)}"
    others = [k for k, v in found.metrics.items() if k not in r.__struct_fields__ and v is not None]
    return PairView(
        title=found.a,
        about=("against", found.b),
        report=found.report.saying(*(f"warning: {w}" for w in found.warnings)),
        test=found.test,
        reference=found.reference,
        names=Names("A", "B", "A", "B", f"A: {found.a}", f"B: {found.b}"),
        tolerance=held,
        held_to="the limits" if found.limits else "noise and tolerance" if noisy else "the tolerance",
        motto="any image beside its reference",
        tiles=(
            Tile("Error, 99.9 %", numbers.shown(r.p999_abs), below=below),
            Tile("Error, worst", numbers.shown(r.max_abs), below="max |A − B|"),
            Tile("RMSE", numbers.shown(r.rmse), below=f"relMSE {numbers.shown(r.relmse)}"),
            Tile("Ratio of means", numbers.shown(r.mean_ratio, 5), below="mean(A) / mean(B)"),
        ),
        objects=tuple(f"object {i}" for i in range(1 + _most(found.test, found.reference))),
        times=tuple(Timing(stage, seconds, "-") for stage, seconds in found.report.seconds.items()),
        settings=found.settings,
        metrics=tuple((k, found.metrics[k], METRICS[k].formula) for k in others),
    )


def _most(*images: Image) -> int:
    """The largest object number in the images' surfaces."""
    return min(max((int(i.surface.ids.max(initial=-1)) for i in images if i.surface is not None), default=-1), 10_000)
