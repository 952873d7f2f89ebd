"""What commands found, in a few lines of text for the terminal."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from raytwin.compare import Comparison
    from raytwin.photos.camera import Calibration
    from raytwin.study.compare_scene import Result
    from raytwin.study.diff_files import Diff


def summary(result: "Result") -> str:
    """Verdict and cause first, then what they rest on."""
    c = result.comparison
    g, r = c.geometry, c.radiance
    level = f", light level {result.report.rung}" if result.report.rung else ""
    differ = g.mask_mismatch_pixels
    outlines = (
        "not compared (the subject reports no objects)"
        if differ is None
        else f"{counted(differ, 'pixel')} differ{'s' * (differ == 1)}"
    )
    lines = [
        f"{c.verdict.upper()}  {result.report.scene}{level}{because(c)}",
        *(f"  {reason}" for reason in further(c)),
        f"  silhouettes: {outlines}",
        f"  radiance: p99.9 error {_number(r.p999_abs)}, worst {_number(r.max_abs)}, rmse {_number(r.rmse)}",
    ]
    return "\n".join(lines)


def diff_summary(found: "Diff") -> str:
    """Verdict first, its reasons, then every metric that has a value."""
    from raytwin.compare import METRICS  # what only tells of photos needs none
    from raytwin.show.numbers import shown

    c = found.comparison
    lines = [f"{c.verdict.upper()}  {found.report.scene}{because(c)}", *(f"  {reason}" for reason in further(c))]
    if c.geometry.shift_px is not None:
        lines.append(f"  {'shift':<14} {c.geometry.shift_px:.3g} px")
    if (samples := c.statistics.noise_of_samples) is not None:
        lines.append(f"  {'noise':<14} of about {shown(samples, 2)} samples per pixel of the reference's renderer")
    known = [(METRICS[name], value) for name, value in found.metrics.items() if value is not None]
    lines += [f"  {metric.name:<14} {value:<12.6g} {metric.formula}" for metric, value in known]
    return "\n".join(lines)


def calibration_summary(calibration: "Calibration") -> str:
    """K and distortion with their standard deviations, what each photo does to them, and every warning.

    `pull`: by how many of their standard deviations K's numbers move (rms) without the photo.
    """
    s, (width, height) = calibration.sigma, calibration.image_size
    lines = [f"{counted(len(calibration.views), 'photo')} of {width} x {height}, model {calibration.model}"]
    lines += [f"  {n:<3} {v:12.5g}" + (f" +- {s[n]:.2g}" if n in s else "") for n, v in intrinsics(calibration).items()]
    lines.append(f"  rms {calibration.rms_px:.3f} px")
    if (found := calibration.evidence).taken:
        lines += [
            f"  {'*' if model == found.taken else ' '} {model:<15} held out {error:.3f} px"
            for model, error in found.held_out_px.items()
        ]
    if (board := calibration.board).bend_mm:
        lines.append(f"  board bent by {board.bend_mm:.2g} +- {board.bend_sigma_mm:.1g} mm")
    lines.append("  photo                            tags   rms px   pull")
    lines += [f"  {v.photo[-32:]:<32} {v.tags:>4}   {v.rms_px:6.3f}   {v.influence:4.2f}" for v in calibration.views]
    lines += [f"  warning ({w.code}): {w.text}" for w in calibration.warnings]
    return "\n".join(lines)


def intrinsics(calibration: "Calibration") -> dict[str, float]:
    """Return K's numbers and the distortion's, by name."""
    k = calibration.K
    found = {"fx": k[0][0], "fy": k[1][1], "cx": k[0][2], "cy": k[1][2]}
    return found | dict(zip(("k1", "k2", "p1", "p2", "k3"), calibration.dist, strict=False))


def augment_summary(rows: list[dict[str, Any]]) -> str:
    """A line per photo."""
    return "\n".join(f"{row['photo']}  pose rms {row['pose_rms_px']:.3f} px" for row in rows)


def because(comparison: "Comparison") -> str:
    """`: the sun is π times too bright`: the end of a verdict's first line, empty where no cause is named."""
    likely = " (likely)" if comparison.cause and comparison.findings[0].kind != "proved" else ""
    return f": {comparison.cause}{likely}" if comparison.cause else ""


def further(comparison: "Comparison") -> tuple[str, ...]:
    """The reasons that are not in the verdict's first line already."""
    return comparison.reasons[1:] if comparison.cause else comparison.reasons


def counted(count: int, noun: str) -> str:
    """
    >>> counted(1, "photo"), counted(0, "pixel")
    ('1 photo', '0 pixels')
    """
    return f"{count} {noun}{'s' * (count != 1)}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
