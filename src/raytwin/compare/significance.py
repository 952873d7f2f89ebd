"""Probabilities: levels of tests that share a rate, Student's t and the Gaussian, and their quantiles."""

import math

import numpy as np

from raytwin.array_types import Float, Float64


def sidak(rate: float, tests: float) -> float:
    """1 - (1 - rate)^(1 / tests): the level of each of `tests` independent tests that share `rate`."""
    return -math.expm1(math.log1p(-rate) / tests)


def welch(parts: list[tuple[float, float]]) -> float:
    """(Σ v)² / Σ (v² / ν): the degrees of freedom of a sum of variances v that have ν each (Welch 1947, Satterthwaite).

    Adding the ν instead would trust a noisy image of two batches as much as the reference that it is compared with.
    """
    total, below = sum(v for v, _ in parts), sum(v * v / nu for v, nu in parts)
    return total * total / below if below > 0 else math.inf


def less_skewed(z: Float[np.ndarray, "*n"], skewness: Float[np.ndarray, "*n"] | float) -> Float64[np.ndarray, "*n"]:
    """The standard deviations, as a Gaussian would have them, of a mean of this skewness that is z too low; both >= 0.

        r = sqrt(2 (w - ln(1 + w))) / g,  w = g z

    A mean whose noise has the variance s² and the third moment g s³ is taken for a Poisson variable, in units of its
    events: 1 / g² of them were seen, and (1 + w) / g² expected. r is the signed root of twice the logarithm of the two
    likelihoods' ratio. r = z - g z² / 3 + ... is Johnson's t (1978), but grows with z at any skewness, where Johnson's
    turns back (Sutton 1993, Chen 1995; Hall 1992 has another monotone one).
    """
    g = np.broadcast_to(np.asarray(skewness, np.float64), np.shape(z))
    w = g * z
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(w > 1e-4, np.sqrt(2 * (w - np.log1p(w))) / g, z))


def as_skewed(r: Float[np.ndarray, "*n"], skewness: Float[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
    """z with less_skewed(z, skewness) = r, to a hundredth below g r = 3: three terms of a series."""
    s = skewness * r
    return np.asarray(r * (1 + s / 3 + s * s / 36))


def two_sided(z: Float[np.ndarray, "*n"] | float, dof: Float[np.ndarray, "*n"] | float) -> Float64[np.ndarray, "*n"]:
    """P(|T| >= z) for Student's t with `dof` degrees of freedom (the Gaussian where infinite)."""
    from scipy.special import ndtr, stdtr

    finite = np.isfinite(dof)
    return np.asarray(2.0 * np.where(finite, stdtr(np.where(finite, dof, 1.0), -np.abs(z)), ndtr(-np.abs(z))))


def quantile(p: float, dof: Float[np.ndarray, "*n"] | float) -> Float64[np.ndarray, "*n"]:
    """z with P(|T| >= z) = p, the inverse of `two_sided`."""
    from scipy.special import ndtri, stdtrit

    finite = np.isfinite(dof)
    return np.asarray(np.where(finite, -stdtrit(np.where(finite, dof, 1.0), p / 2), -ndtri(p / 2)))
