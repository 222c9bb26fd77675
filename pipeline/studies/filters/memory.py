"""The second moments of the deviations as the training takes show them: the spread of each step,
which is all that no filter knows, and one correlation over time.

    Cov(e_k, e_l) = S_k^½ r(|k − l|) S_l^½,    r(l) = Σ e_kᵀe_{k+l} / Σ e_kᵀe_k,

S_k the takes' covariance at step k less that of a measured pose, both sums over takes and over the
steps that there are: so r is a positive definite sequence, and the law one. Its prior is no filter;
what it makes of the frames comes on top.
"""

from __future__ import annotations

import numpy as np

from pipeline.models.covariance import root, without_measurement


def spreads(poses: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """(K, n, n) rad, S_k^½ of the training takes' ``poses`` (takes, K, n) in rad; ``measurement``
    (n, n) in rad² of a measured pose.
    """
    deviation = poses - poses.mean(axis=0)
    covariance = np.einsum("tki,tkj->kij", deviation, deviation) / (len(poses) - 1)
    return np.stack([root(without_measurement(each, measurement)[0]) for each in covariance])


def memory(poses: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """(K,) r of the training takes, arguments as in :func:`spreads`."""
    deviation = poses - poses.mean(axis=0)
    takes, steps, _ = deviation.shape
    power = np.sum(np.abs(np.fft.rfft(deviation, 2 * steps, axis=1)) ** 2, axis=(0, 2))
    products = np.fft.irfft(power, 2 * steps)[:steps]
    products[0] -= takes * steps * np.trace(measurement)
    return products / products[0]


def first_order(correlation: np.ndarray, lag: int) -> np.ndarray:
    """(K,) the correlation of a deviation of which a step leaves the same share each time, as a
    closed loop does: that of ``correlation`` (K,) at ``lag``, which is to be positive there.
    """
    return np.maximum(correlation[lag], 0.0) ** (np.arange(len(correlation)) / lag)


def remembered(root_of_spread: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """(K, n, K, n) rad², Cov(e_k, e_l) of ``root_of_spread`` (K, n, n) and ``correlation`` (K,)."""
    steps = np.arange(len(correlation))
    apart = correlation[np.abs(steps[:, None] - steps)]
    return np.einsum("kia,lja,kl->kilj", root_of_spread, root_of_spread, apart)
