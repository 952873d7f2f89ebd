"""The result of comparing two images, the verdict with every number behind it, and the keys of comparison.json."""

from typing import Any, Literal

import msgspec

from raytwin.compare.finding import Finding, notes
from raytwin.scene import Record


class Geometry(Record, frozen=True):
    """Where things are seen, before how bright they are.

    `mask_mismatch_pixels`: pixels whose centre sees another object; `depth_max_rel`: largest |t - t_ref| / t_ref and
    `normal_max_deg`: largest angle, both over pixels that see the same object; `shift_px`: length of the translation
    between the two images, pixels. It is null where the pictures hold too little detail to tell, or where a
    change of the light explains more of the difference.
    """

    mask_mismatch_pixels: int | None = None
    depth_max_rel: float | None = None
    normal_max_deg: float | None = None
    shift_px: float | None = None


class Radiance(Record, frozen=True):
    """Errors of radiance over all finite values, as METRICS defines them; `p999_abs`: 99.9 % quantile of |error|."""

    max_abs: float | None = None
    p999_abs: float | None = None
    rmse: float | None = None
    relmse: float | None = None
    relmse_trimmed: float | None = None
    mean_ratio: float | None = None


class Statistics(Record, frozen=True):
    """What noise cannot explain. Null for noise-free images, except the share of failing pixels.

    `z_mean`: the image's mean error, beyond what is granted, over its standard deviation (signed, worst channel);
    `z_tile_worst`: the same for the least plausible tile; `pixel_fail_fraction`: share of pixels with a value that
    fails its own test, or is an outlier of those without noise;
    `minimum_detectable_bias`: the smallest error of the whole image's mean, relative to the reference's mean, that
    this comparison would have found with probability 0.9; `minimum_detectable_tile_bias`: of 24 x 24 pixels anywhere.
    `looks`: how often rounds of samples were looked at; `samples_to_certainty`: samples per pixel at the last of them,
    null where it left the verdict undecided. `noise_of_samples`: the samples per pixel of the reference's renderer that
    have the test's noise.
    """

    z_mean: float | None = None
    z_tile_worst: float | None = None
    pixel_fail_fraction: float | None = None
    minimum_detectable_bias: float | None = None
    minimum_detectable_tile_bias: float | None = None
    looks: int | None = None
    samples_to_certainty: int | None = None
    noise_of_samples: float | None = None


class Perceptual(Record, frozen=True):
    """Mean of HDR-FLIP's error map, 0 to 1; null where it was not asked for."""

    flip_mean: float | None = None


Verdict = Literal["pass", "differs", "fail", "undecided"]
"""`differs`: as expected, since one side models less light on purpose. `undecided`: too little is known to decide."""


class Comparison(Record, frozen=True):
    """The verdict on two images and every number behind it; `findings` say why, the worst first.

    A pass has findings too: what it could have seen. `seconds` is what the comparison itself took. `failing`: (x, y,
    width, height) of the tiles that fail, and of blocks with values that do; for pictures, not in comparison.json.
    `excluded_bias`: the data speak ten to one against any larger bias of the whole image (Wald), relative to its mean;
    not in comparison.json either.
    """

    verdict: Verdict
    findings: tuple[Finding, ...] = ()
    geometry: Geometry = Geometry()
    radiance: Radiance = Radiance()
    statistics: Statistics = Statistics()
    perceptual: Perceptual = Perceptual()
    seconds: float = 0.0
    failing: tuple[tuple[int, int, int, int], ...] = ()
    excluded_bias: float | None = None

    @property
    def reasons(self) -> tuple[str, ...]:
        """The findings in words."""
        return tuple(finding.reason for finding in self.findings)

    def judged(self, verdict: Verdict, *findings: Finding) -> "Comparison":
        """The same numbers with this verdict and these reasons."""
        return msgspec.structs.replace(self, verdict=verdict, findings=findings)

    def saying(self, *further: str) -> "Comparison":
        """The same comparison, with these reasons after the others."""
        return self.judged(self.verdict, *self.findings, *notes(further))

    def because(self, *causes: Finding) -> "Comparison":
        """The same comparison, with the causes before the other reasons if they name one, else after them."""
        named = bool(causes) and causes[0].names_a_cause
        return self.judged(self.verdict, *((*causes, *self.findings) if named else (*self.findings, *causes)))

    @property
    def cause(self) -> str:
        """The sentence of the first cause that is named; empty where none is."""
        named = not self.passed and bool(self.findings) and self.findings[0].names_a_cause
        return self.findings[0].text if named else ""

    @property
    def passed(self) -> bool:
        """The images agree, or differ only as expected."""
        return self.verdict in ("pass", "differs")

    @property
    def exit_code(self) -> int:
        """0: agrees, or differs as expected; 1: failed; 2: undecided."""
        return {"pass": 0, "differs": 0, "fail": 1, "undecided": 2}[self.verdict]


STAGES = ("calibrate", "tracer", "twin", "compare")
"""The stages that comparison.json always names, null where one was not run."""


class Part(Record, frozen=True):
    """A row of the ledger: one named part of the error against the whole light.

    `seconds`: per frame, on the cheapest rung that has it. `share_of_light`: its mean divided by that of all light,
    signed: less than 0 where light is missing. `share_of_error`: its correlation with the whole error over that error's
    square; all add up to 1. `noise`: the rms standard error of the part, where it was sampled.
    """

    part: str
    rmse: float | None = None
    seconds: float | None = None
    share_of_light: float | None = None
    share_of_error: float | None = None
    noise: float | None = None


class Report(Record, frozen=True):
    """`comparison` of `scene` at `rung`, the seconds of every stage by name, and what computed them (`backend`).

    `rung` and `ledger` are None where nothing is known of the scene's light: a Mitsuba file.
    """

    scene: str
    rung: str | None
    comparison: Comparison
    seconds: dict[str, float] = msgspec.field(default_factory=dict)
    backend: dict[str, Any] = msgspec.field(default_factory=dict)
    ledger: tuple[Part, ...] | None = ()

    def saying(self, *further: str) -> "Report":
        """The same with further reasons, behind the others."""
        return msgspec.structs.replace(self, comparison=self.comparison.saying(*further))

    def numbers(self) -> dict[str, Any]:
        """What comparison.json holds, in its order."""
        about: dict[str, Any] = {"scene": self.scene, "rung": self.rung}
        made = msgspec.structs.asdict(self.comparison)
        own, *_ = (made.pop(key) for key in ("seconds", "failing", "excluded_bias", "findings"))
        about |= {"verdict": made.pop("verdict"), "reasons": self.comparison.reasons}
        seconds = {stage: self.seconds.get(stage, own if stage == "compare" else None) for stage in STAGES}
        return about | made | {"ledger": self.ledger, "seconds": seconds, "backend": self.backend}
