"""The translation between two images, from coarse to fine, and whether noise explains it."""

import math
from typing import NamedTuple

import numpy as np

from raytwin.array_types import Float, Float32
from raytwin.compare.finding import Finding
from raytwin.compare.significance import sidak, two_sided

GRANTED_SHIFT = 0.01
"""Pixels by which two images may be shifted: a tenth of what calibration can tell."""

LIGHT = 16
"""Pixels on the side of the blocks whose brightness may change."""


class Shift(NamedTuple):
    """The test image shows at (x + dx, y + dy) what the reference shows at (x, y), pixels.

    `sigma` is the larger standard deviation of the two, `dof` the degrees of freedom behind it. `explained`: the share
    of the squared difference that goes with the shift; what is left of a whole shift's is nearly nothing. `light`: the
    share that another brightness of every 16 x 16 pixels explains.
    """

    dx: float
    dy: float
    sigma: float
    dof: float
    explained: float = 1.0
    light: float = 0.0

    @property
    def significant(self) -> bool:
        return self.length > max(5 * self.sigma, 2 * GRANTED_SHIFT)

    @property
    def certain(self) -> bool:
        """Beyond its sigma, and the cause of most of the difference: a missing shadow pulls at the edges too."""
        return self.significant and (self.length > 1 or (self.explained > 0.5 and self.better_than_light))

    @property
    def better_than_light(self) -> bool:
        """It explains more of the difference than another brightness of every 16 x 16 pixels would."""
        return self.length > 1 or self.explained > self.light

    @property
    def length(self) -> float:
        return float(np.hypot(self.dx, self.dy))


def find_shift(
    test: Float[np.ndarray, "h w c"], reference: Float[np.ndarray, "h w c"], most_pixels: int = 1_000_000
) -> Shift | None:
    """The translation (dx, dy) for which t(x + dx) = r(x), from coarse to fine; None where nothing fixes it.

    Lucas and Kanade 1981, symmetric: t - r = -grad(m) . (dx, dy) + gain m + offset, m = (t + r) / 2, by least squares,
    so that a wrong brightness is not read as a shift. `sigma` comes from the residuals.
    """
    factor = max(1, int(np.ceil(np.sqrt(test.shape[0] * test.shape[1] / most_pixels))))
    levels = [(_binned(test, factor), _binned(reference, factor))]
    while min(levels[-1][0].shape) >= 64 and len(levels) < 6:
        coarse, other = (_binned(i[..., None], 2) for i in levels[-1])
        levels.append((coarse, other))
    dx = dy = 0.0
    step: Shift | None = None
    for t, r in reversed(levels):
        dx, dy = 2 * dx, 2 * dy
        for _ in range(2):
            step = _step(t, r, round(dx), round(dy))
            if step is None:
                break
            moved = (round(dx), round(dy)) != (round(step.dx), round(step.dy))
            dx, dy = step.dx, step.dy
            if not moved:
                break
    if step is None:
        return None
    if not _explains(step, *levels[0]):
        return None
    return step._replace(dx=factor * step.dx, dy=factor * step.dy, sigma=factor * step.sigma)


def _explains(shift: Shift, t: Float[np.ndarray, "h w"], r: Float[np.ndarray, "h w"]) -> bool:
    """A shift of more than a pixel is one only if it makes the images more alike: two different pictures have none."""
    if shift.length <= 1:
        return True
    moved, still = (
        1 - float(np.corrcoef(np.stack([part.ravel() for part in _overlap(t, r, dx, dy)]))[0, 1])
        for dx, dy in ((round(shift.dx), round(shift.dy)), (0, 0))
    )
    return moved < still / 2


def _overlap(
    t: Float[np.ndarray, "h w"], r: Float[np.ndarray, "h w"], dx: int, dy: int
) -> tuple[Float[np.ndarray, "y x"], Float[np.ndarray, "y x"]]:
    """The parts of t and r that show the same when t is r moved by whole pixels."""
    h, w = t.shape
    return (
        t[max(dy, 0) : h + min(dy, 0), max(dx, 0) : w + min(dx, 0)],
        r[max(-dy, 0) : h + min(-dy, 0), max(-dx, 0) : w + min(-dx, 0)],
    )


def _binned(x: Float[np.ndarray, "h w c"], factor: int) -> Float32[np.ndarray, "h//{factor} w//{factor}"]:
    """The mean over factor x factor pixels and all channels, float32 (H // factor, W // factor)."""
    h, w, c = x.shape[0] // factor, x.shape[1] // factor, x.shape[2]
    x = x[: h * factor, : w * factor]
    rows = x.reshape(h, factor, w * factor * c).sum(axis=1, dtype=np.float32)
    return np.asarray(rows.reshape(h, w, factor * c).mean(axis=-1))


_SMOOTH = np.array([1, 4, 6, 4, 1], np.float32) / 16

FOOTPRINT = float(np.square(_SMOOTH).sum()) ** 2
"""White noise keeps this share of its variance under the filter: 1 / FOOTPRINT pixels share one error."""


def _smoothed(x: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h-4 w-4"]:
    """Binomial filter, no padding: four rows and columns fewer. An edge one pixel factor has no gradient without it."""
    x = np.asarray(sum(w * x[i : i + len(x) - 4] for i, w in enumerate(_SMOOTH)))
    return np.asarray(sum(w * x[:, i : i + x.shape[1] - 4] for i, w in enumerate(_SMOOTH)))


def _step(t: Float[np.ndarray, "h w"], r: Float[np.ndarray, "h w"], dx: int, dy: int) -> Shift | None:
    """One least-squares step around the whole shift (dx, dy)."""
    h, w = t.shape
    if h - abs(dy) < 16 or w - abs(dx) < 16:
        return None
    t, r = (_smoothed(i) for i in _overlap(t, r, dx, dy))
    m = (t + r) / 2
    gx, gy = (m[1:-1, 2:] - m[1:-1, :-2]) / 2, (m[2:, 1:-1] - m[:-2, 1:-1]) / 2
    d, m = (t - r)[1:-1, 1:-1].ravel().astype(np.float64), m[1:-1, 1:-1].ravel()
    A = np.stack([-gx.ravel(), -gy.ravel(), m - m.mean(), np.ones_like(m)]).astype(np.float64)
    normal = A @ A.T
    if not np.isfinite(normal).all():
        return None
    # A flat image, or one with edges in one direction only, leaves the shift open.
    if np.linalg.eigvalsh(normal[:2, :2])[0] <= 1e-9 * max(float(np.square(m).sum()), 1e-30):
        return None
    solution = np.linalg.lstsq(normal, A @ d, rcond=None)[0]
    residual = d - solution @ A
    inverse = np.linalg.pinv(normal)
    # Edges carry the shift and the noise at once: each pixel counts with its own residual (White 1980) ...
    influence = np.square((inverse[:2] @ A) * residual)
    variance = influence.sum(axis=1) / FOOTPRINT
    carrying = np.square(influence.sum(axis=1)) / np.maximum(np.square(influence).sum(axis=1), 1e-300)
    # ... and neighbours' residuals, smoothed alike, are one. Squares of Gaussian residuals scatter too: of n alike
    # (sum)² / sum of squares is n / 3.
    dof = max(3 * float(carrying.min()) * FOOTPRINT - 1, 0.5)
    flat = d - np.linalg.lstsq(normal[2:, 2:], A[2:] @ d, rcond=None)[0] @ A[2:]
    energy = float(flat @ flat)
    explained = 1 - float(residual @ residual) / energy if energy > 0 else 0.0
    light = _lit(flat.reshape(gx.shape), m.reshape(gx.shape).astype(np.float64)) / energy if energy > 0 else 0.0
    # As many unknowns as blocks explain some noise too: R² adjusted for them.
    free = math.prod(-(-n // LIGHT) for n in gx.shape) / max(flat.size * FOOTPRINT, 1.0)
    light = 1 - (1 - light) / (1 - free) if free < 1 else 0.0
    x, y = dx + float(solution[0]), dy + float(solution[1])
    return Shift(x, y, float(np.sqrt(variance.max())), dof, explained, light)


def _lit(d: Float[np.ndarray, "h w"], m: Float[np.ndarray, "h w"]) -> float:
    """How much of Σ d² the best factor of m in every LIGHT x LIGHT block takes away: Σ (Σ d m)² / Σ m²."""

    def blocks(x: np.ndarray) -> np.ndarray:
        rows = np.add.reduceat(x, np.arange(0, x.shape[0], LIGHT), axis=0)
        return np.add.reduceat(rows, np.arange(0, x.shape[1], LIGHT), axis=1)

    dm, mm = blocks(d * m), blocks(m * m)
    return float(np.divide(np.square(dm), mm, out=np.zeros_like(dm), where=mm > 0).sum())


def shift_findings(shift: Shift, share: float, factor: float = 1.0) -> list[Finding]:
    """The shift between two noisy images as a test with the false-alarm rate `share`, beyond GRANTED_SHIFT.

    `factor`: the variance of sums by that of independent pixels. A shift that explains the difference no better than a
    change of light is none.
    """
    sigma = shift.sigma * math.sqrt(factor)
    z = max(max(abs(shift.dx), abs(shift.dy)) - GRANTED_SHIFT, 0) / sigma if sigma > 0 else 0.0
    named = float(two_sided(z, max(shift.dof / factor, 0.5))) < sidak(share, 2) and shift.better_than_light
    return [shift_finding(shift)] if named else []


def shift_finding(shift: Shift) -> Finding:
    return Finding(
        "shift",
        f"the test image is shifted by ({shift.dx:+.3f}, {shift.dy:+.3f}) pixels against the reference "
        f"(sigma {shift.sigma:.2g})",
    )
