"""What came of two images: one record, which JSON, pages, notebooks and the terminal are views of."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from raytwin.compare import Comparison, Report, Verdict
from raytwin.images.image import Image
from raytwin.notebook import InNotebook
from raytwin.scene import Tolerance, toml_json

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
        plain: dict[str, Any] = toml_json.plain(self.numbers())
        return plain

    def __repr__(self) -> str:
        because = f": {self.cause or self.reasons[0]}" if self.reasons else ""
        level = f", light level {self.report.rung}" if self.report.rung else ""
        return f"<raytwin.{self.made_by} {self.verdict.upper()} {self.report.scene}{level}{because}>"
