"""What a page shows of two images: the tracer beside its twin, or any A beside any B."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from raytwin.compare import METRICS, Comparison, Report, scaled
from raytwin.compare.exact import scale_of
from raytwin.images.image import Image, Surface
from raytwin.scene import Tolerance
from raytwin.show.numbers import seconds, short, shown
from raytwin.show.terminal_text import counted
from raytwin.study.diff_files import Compared, Diff

if TYPE_CHECKING:
    from raytwin.study.compare_scene import Result

MOST_OBJECTS = 10_000
"""Objects that are named at most: an EXR may hold any number."""


class Names(NamedTuple):
    """How the two images are called: in a table's cell, and above their pictures."""

    test: str
    reference: str
    test_title: str
    reference_title: str


class Tile(NamedTuple):
    """A large number under the verdict: what it is, its value in words, its unit, and a line below."""

    what: str
    value: str
    unit: str = ""
    below: str = ""


@dataclass(frozen=True, eq=False)
class PairView:
    """How a page shows two images: their names, the large numbers, and the tolerance in radiance.

    `about` is a word and the name it introduces (light level, shadow). `objects`
    names `surface.ids` from 0 on. `metrics`: further ones by name, value, formula.
    """

    pair: Compared
    title: str
    names: Names
    motto: str = ""
    about: tuple[str, str] = ("", "")
    objects: tuple[str, ...] = ()
    metrics: tuple[tuple[str, float | None, str], ...] = ()

    @property
    def held_to(self) -> str:
        """What the verdict was decided by, in words."""
        return "noise and tolerance" if self.pair.noisy else "the tolerance"

    @property
    def test(self) -> Image:
        return self.pair.test

    @property
    def reference(self) -> Image:
        return self.pair.reference

    @property
    def report(self) -> Report:
        return self.pair.report

    @property
    def comparison(self) -> Comparison:
        return self.pair.comparison

    @cached_property
    def tolerance(self) -> Tolerance:
        """As the comparison of the two images holds it, where they are pictures."""
        pictures = showable(self.reference) and showable(self.test)
        return scaled(self.pair.tolerance, self.reference, self.test) if pictures else self.pair.tolerance

    @cached_property
    def scale(self) -> float:
        """What the tolerance is relative to."""
        return scale_of(self.reference, self.test)

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """The large numbers: errors with their limits, and seconds where they were measured."""
        g, r, seconds_of = self.comparison.geometry, self.comparison.radiance, self.report.seconds
        found = []
        if (apart := g.mask_mismatch_pixels) is not None:
            unit = "pixel differs" if apart == 1 else "pixels differ"
            found.append(Tile("Silhouettes", shown(apart), unit, f"limit {self.tolerance.mask_pixels}"))
        limit = "noise included" if self.pair.noisy else f"limit {short(self.tolerance.p999_abs)}"
        found.append(Tile("Radiance error, 99.9 %", shown(r.p999_abs), below=limit))
        if (noise := self.comparison.statistics.noise_of_samples) is not None:
            title, unit = "This image has the noise of about", "samples per pixel"
            found.append(Tile(title, shown(noise, 2), unit, "of the reference's renderer"))
        if "tracer" in seconds_of:
            found.append(Tile("Tracer", seconds(seconds_of["tracer"]), below=f"RMSE {shown(r.rmse)}"))
            below = f"{counted(self.reference.samples, 'sample')} per pixel"
            return *found, Tile("Twin", seconds(seconds_of.get("twin")), below=below)
        found.append(Tile("RMSE", shown(r.rmse), below=f"worst {shown(r.max_abs)}"))
        return *found, Tile("Ratio of means", shown(r.mean_ratio, 5), below="mean(test) / mean(reference)")

    @property
    def alike(self) -> bool:
        """Both are pictures of one size: only then is there an error to show."""
        return showable(self.test) and showable(self.reference) and self.test.shape == self.reference.shape

    @property
    def surfaces(self) -> tuple[Surface, Surface] | None:
        """The surfaces of both images; None unless both have one of the image's size."""
        a, b, shape = self.test.surface, self.reference.surface, self.reference.shape[:2]
        return (a, b) if a is not None and b is not None and np.shape(a.ids) == np.shape(b.ids) == shape else None


def showable(image: Image) -> bool:
    """Numbers of shape (H, W, 3) with pixels in it."""
    x = image.mean
    return isinstance(x, np.ndarray) and x.dtype.kind in "fiub" and x.ndim == 3 and x.shape[2] == 3 and x.size > 0


def view_of(pair: "Result | Diff") -> PairView:
    """Return the view of what `compare_scene` or `compare` gave."""
    return _of_diff(pair) if isinstance(pair, Diff) else _of_scene(pair)


def _of_scene(result: "Result") -> PairView:
    """The tracer beside its twin."""
    about = result.report
    return PairView(
        pair=result,
        title=about.scene,
        about=("light level", about.rung) if about.rung else ("of", "a Mitsuba file"),
        names=Names("tracer", "twin", "Tracer's image", "Twin's image"),
        motto=f"{result.settings.get('subject', 'a ray tracer')} beside its Mitsuba twin",
        objects=result.scene.names,
    )


def numbered(*images: Image) -> tuple[str, ...]:
    """Return a name for each object number in the images' surfaces."""
    most = max((int(i.surface.ids.max(initial=-1)) for i in images if i.surface is not None), default=-1)
    return tuple(f"object {i}" for i in range(1 + min(most, MOST_OBJECTS)))


def _of_diff(found: Diff) -> PairView:
    """Any image A beside any image B."""
    known = found.comparison.radiance.__struct_fields__
    return PairView(
        pair=found,
        title=found.a,
        about=("against", found.b),
        names=Names("A", "B", f"A: {found.a}", f"B: {found.b}"),
        motto="any image beside its reference",
        objects=numbered(found.test, found.reference),
        metrics=tuple(
            (name, value, METRICS[name].formula)
            for name, value in found.metrics.items()
            if name not in known and value is not None
        ),
    )
