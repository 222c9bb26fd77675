"""Baselines of every motion model, which know the training takes alone: their mean and covariance
at each step, and those with one autocorrelation over time,

    Cov(e_k, e_l) = S_k^½ r(|k − l|) S_l^½,    r(l) = Σ e_kᵀe_{k+l} / Σ e_kᵀe_k,

e_k the deviations from the mean, S_k their covariance at step k less the one of a measured pose,
both sums over takes, joints and steps, less the measurement's too. Tables name the first NONE and
the second MEMORY (:mod:`pipeline.core.filters`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.filters import MEMORY, NONE
from pipeline.filtering.linear import linear_filter
from pipeline.filtering.measurement import Measurements
from pipeline.models.normal import root, without_measurement
from pipeline.statistics.takes import takes_moments


def baseline_predictions(
    training: np.ndarray, poses: np.ndarray, measurement: np.ndarray
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return by baseline the errors (..., K − 1, n) in rad of the predicted poses, measured minus
    predicted, and their predicted covariances (K − 1, n, n) in rad².

    The second is given the pose y_k = e_k + N(0, Σ) that was measured a step before:
    E(e_{k+1} | y_k) = Cov(e_{k+1}, e_k)(S_k + Σ)⁻¹ y_k. ``training`` (takes, K, n) and ``poses``
    (..., K, n) rad are the training takes and the predicted ones, ``measurement`` (n, n) rad² Σ.
    """
    mean, covariance = takes_moments(training)
    off = poses - mean
    roots, _ = deviation_roots(training, measurement)
    each = roots @ roots
    across = autocorrelation(training, measurement)[1] * (roots[1:] @ roots[:-1])
    gain = np.swapaxes(np.linalg.solve(each[:-1] + measurement, np.swapaxes(across, 1, 2)), 1, 2)
    left = each[1:] + measurement - gain @ np.swapaxes(across, 1, 2)
    return {
        NONE: (off[..., 1:, :], covariance[1:]),
        MEMORY: (
            off[..., 1:, :] - np.matvec(gain, off[..., :-1, :]),
            (left + np.swapaxes(left, 1, 2)) / 2,
        ),
    }


def autocorrelated_filter(
    poses: np.ndarray,
    measurement: np.ndarray,
    takes: Sequence[Measurements],
    dt: float,
    chain: Chain,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return means (T, K, n) in rad and covariances (T, K, n, n) in rad² of the poses of the T
    ``takes`` at each step given the frames up to it, by :func:`linear_filter`; and the number of
    axes, over all steps, along which S_k is set to zero.
    ``poses`` (takes, K, n) rad are those of the training takes, ``measurement`` (n, n) rad² the
    noise of one, ``takes`` the measurements at times on a motion grid of step ``dt`` (s).
    """
    roots, without = deviation_roots(poses, measurement)
    prior = path_covariance(roots, autocorrelation(poses, measurement))
    return *linear_filter(poses.mean(axis=0), prior, takes, dt, chain), without


def deviation_roots(poses: np.ndarray, measurement: np.ndarray) -> tuple[np.ndarray, int]:
    """Return (K, n, n) rad, S_k^½ of ``poses`` (takes, K, n) in rad, and the number of axes, over
    all steps, along which S_k is zero; ``measurement`` (n, n) in rad² of a measured pose.
    """
    _, covariance = takes_moments(poses)
    left = [without_measurement(each, measurement) for each in covariance]
    return np.stack([root(each) for each, _ in left]), sum(without for _, without in left)


def autocorrelation(poses: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """Return r (K,) of ``poses`` (takes, K, n); white noise's where they hold measurement alone.

    The measurement is white, as high at every frequency; where the takes' spectrum is lower, by
    chance, it is set to zero, so that r is a positive semidefinite sequence.
    """
    deviation = poses - poses.mean(axis=0)
    takes, steps, _ = deviation.shape
    power = np.sum(np.abs(np.fft.rfft(deviation, 2 * steps, axis=1)) ** 2, axis=(0, 2))
    noise = (takes - 1) * steps * np.trace(measurement)
    products = np.fft.irfft(np.maximum(power - noise, 0.0), 2 * steps)[:steps]
    return products / products[0] if products[0] > 0 else np.eye(1, steps)[0]


def path_covariance(roots: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """Return (K, n, K, n) rad², Cov(e_k, e_l) of ``roots`` (K, n, n) and ``correlation`` (K,)."""
    steps = np.arange(len(correlation))
    apart = correlation[np.abs(steps[:, None] - steps)]
    return np.einsum("kia,lja,kl->kilj", roots, roots, apart)
