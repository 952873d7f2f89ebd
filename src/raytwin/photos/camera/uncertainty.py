"""Estimate a calibration's uncertainty from how its photos disagree.

Tags in one photo do not err on their own: blur, a board that is not quite as described, a focus that moved, pull all of
them the same way. So the photo is the unit. Where photos err alike, the covariance is s² H^-1; where they disagree,
the jackknife is honest:

    C = S s² H^-1 S,  S_k² = max(1, V_k / (s² H^-1)_kk),  V_k = (n - 1) / n Σ d_ik²,

d_i: how far the numbers move without photo i of n. Neither is believed where it is the smaller: V of few photos may be
small by chance, and that makes sigma some 8 % too large where photos do err alike.
"""

import math
from dataclasses import dataclass

import numpy as np

from raytwin.photos.camera.fit import Fit, solve_scaled


def leave_one_out(found: Fit) -> tuple[np.ndarray, np.ndarray]:
    """By photo: how the shared numbers move without it (n, m), and the rms distance of its own tags then (n,),
    pixels."""
    moves, errors = [], []
    for A, r, seen in zip(found.A, found.r, found.observations.seen, strict=True):
        move = solve_scaled(found.total - A.T @ A, A.T @ r)
        moves.append(move)
        errors.append(math.sqrt(((r + A @ move) ** 2).sum() / seen.sum()))
    return np.array(moves), np.array(errors)


@dataclass(frozen=True, eq=False)
class FitUncertainty:
    """What the photos' disagreement says: `covariance` (m, m) of `Fit.shared`; `moves` (n, m), `errors` (n,): see
    `leave_one_out`."""

    covariance: np.ndarray
    moves: np.ndarray
    errors: np.ndarray


def fit_uncertainty(found: Fit, gap: np.ndarray | None = None) -> FitUncertainty:
    """Return the uncertainty of a fit; `gap` (k, k), the spread between models of the first k numbers, adds to it."""
    moves, errors = leave_one_out(found)
    s2 = max(found.variance, 1e-300)
    alike = s2 * found.inverse
    variance, jackknife = np.diag(alike), (1 - 1 / len(moves)) * (moves**2).sum(axis=0)
    wider = np.maximum(jackknife / np.where(variance > 0, variance, np.inf), 1)
    covariance = alike * np.sqrt(np.outer(wider, wider))
    if gap is not None:
        covariance[: len(gap), : len(gap)] += gap
    return FitUncertainty(covariance, moves, errors)
