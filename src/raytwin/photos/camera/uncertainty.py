"""Estimate a calibration's uncertainty from how its photos disagree, and that of a projected pixel from it.

Tags in one photo do not err on their own: blur, a board that is not quite as described, a focus that moved, pull all of
them the same way. So the photo is the unit. Where photos err alike, the covariance is s² H^-1; where they disagree,
the jackknife is honest:

    C = S s² H^-1 S,  S_k² = max(1, V_k / (s² H^-1)_kk),  V_k = (n - 1) / n Σ d_ik²,

d_i: how far the numbers move without photo i of n. Neither is believed where it is the smaller: V of few photos may be
small by chance, and that makes sigma some 8 % too large where photos do err alike.

A camera that is a little wrong is for the most part a camera that looks a little elsewhere, and every pose found with
it looks elsewhere by the same amount: such an error is invisible in use. What counts is what is left. So a point fixed
to the board, not to the camera, is followed: the perturbed poses carry it along, on average over the views, by a turn
omega and a shift tau, and only then is it projected through the perturbed lens:

    q' = project(p + omega x p + tau; intrinsics + d),  J = dq' / d(intrinsics, omega, tau),  Var[q] = J C J^T.

After mrcal's projection uncertainty (Kogan, mrcal.secretsauce.net/uncertainty.html), to first order.
"""

import math
from dataclasses import dataclass

import numpy as np

from raytwin.photos.camera import lens_model
from raytwin.photos.camera.fit import MODELS, Fit, solve_scaled
from raytwin.scene.lens import inverse

CELL_PX = 16
"""Pixels: the side of a cell of the map."""


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
    """What the photos' disagreement says: `covariance` (m, m) of `Fit.shared`; `noise_px`: one standard deviation of a
    coordinate that would explain it; `moves` (n, m), `errors` (n,): see `leave_one_out`."""

    covariance: np.ndarray
    noise_px: float
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
    return FitUncertainty(covariance, math.sqrt(s2 * wider[:4].mean()), moves, errors)


def with_poses(found: Fit, known: FitUncertainty) -> np.ndarray:
    """(k + 6, k + 6): the covariance of K and distortion and of the views' mean omega and tau."""
    k, m, v = len(found.form.names), len(found.shared), len(found.R)
    T = np.concatenate([np.eye(k, m), found.follow.mean(axis=0)])
    covariance = T @ known.covariance @ T.T
    covariance[k:, k:] += known.noise_px**2 * np.einsum("vir,vjr->ij", found.inverse_B, found.inverse_B) / v**2
    return covariance


def deviations(calibration, pixels: np.ndarray, distance: float) -> np.ndarray:
    """(n,): one standard deviation, in the direction that is worst, of what is seen at `pixels` (n, 2), in pixels.

    What is seen lies `distance` metres from the camera, or at infinity. NaN where the lens has no inverse: no ray
    belongs to such a pixel.
    """
    pixels, (fx, fy, cx, cy) = np.asarray(pixels, float), np.array(calibration.K)[[0, 1, 0, 1], [0, 1, 2, 2]]
    at = (pixels - (cx, cy)) / (fx, fy)
    x, y, seen = inverse(at[:, 0], at[:, 1], lens_model.five(calibration.dist).tolist())
    rays = np.where(seen[:, None], np.stack([x, y, np.ones(len(x))], axis=1), (0.0, 0.0, 1.0))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    _, of_lens, of_point = lens_model.linearise(
        rays, pixels, calibration.K, calibration.dist, MODELS[calibration.model]
    )
    by_pose = lens_model.of_pose(rays, of_point)
    # On unit rays d/d tau is that of a point 1 m away.
    by_pose[..., 3:] /= distance
    J = np.concatenate([of_lens, by_pose], axis=-1)
    variance = J @ np.array(calibration.basis.covariance) @ J.transpose(0, 2, 1)
    found = np.sqrt(np.maximum(np.linalg.eigvalsh(variance)[:, -1], 0))
    return np.where(seen, found, math.nan)


def uncertainty_map(calibration) -> np.ndarray:
    """(h, w): `deviations` at the middles of h x w equal cells of some CELL_PX pixels, as far off as the board was."""
    width, height = calibration.image_size
    w, h = max(2, round(width / CELL_PX)), max(2, round(height / CELL_PX))
    u, v = np.meshgrid((np.arange(w) + 0.5) * width / w - 0.5, (np.arange(h) + 0.5) * height / h - 0.5)
    return deviations(calibration, np.c_[u.ravel(), v.ravel()], calibration.basis.distance).reshape(h, w)


def pose_deviation(calibration, points: np.ndarray, R: np.ndarray, t: np.ndarray) -> tuple[float, float]:
    """One standard deviation of a pose found from board points (n, 3) with the calibrated camera: degrees, and metres.

    Of the camera's turn about its own centre, and of where that centre is. The camera's own error carries over, and the
    tags' noise adds to it: Var = F C F^T + s² (B^T B)^-1, F = -(B^T B)^-1 B^T A.
    """
    seen = points @ R.T + t
    _, of_lens, of_point = lens_model.linearise(
        seen, np.zeros((len(seen), 2)), calibration.K, calibration.dist, MODELS[calibration.model]
    )
    A, B = (j.reshape(2 * len(seen), -1) for j in (of_lens, lens_model.of_pose(seen, of_point)))
    local = solve_scaled(B.T @ B, np.eye(6))
    follow = -local @ B.T @ A
    k = A.shape[1]
    variance = follow @ np.array(calibration.basis.covariance)[:k, :k] @ follow.T
    variance += calibration.basis.noise_px**2 * local
    return math.degrees(math.sqrt(np.trace(variance[:3, :3]))), math.sqrt(np.trace(variance[3:, 3:]))
