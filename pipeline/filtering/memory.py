"""The linear filter of minimum variance that knows what the training takes alone say: the spread of
their deviations at each step, which is all that no filter knows, and one correlation over time.

    Cov(e_k, e_l) = S_k^½ r(|k − l|) S_l^½,    r(l) = Σ e_kᵀe_{k+l} / Σ e_kᵀe_k,

S_k the takes' covariance at step k less that of a measured pose, both sums over takes, joints and
the steps that there are, less the measurement's too. Without measured frames it is no filter; what
it makes of them comes on top.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.filtering.linear import linear_filter
from pipeline.filtering.measurement import Measurements
from pipeline.models.normal import root, without_measurement
from pipeline.statistics.takes import takes_moments


def memory_filter(
    poses: np.ndarray,
    measurement: np.ndarray,
    takes: Sequence[Measurements],
    dt: float,
    chain: Chain,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Means (T, K, n) in rad and covariances (T, K, n, n) in rad² of the poses of the T ``takes``
    at each step given the frames up to it; along how many axes, over all steps, the training takes
    spread no more than their measurement, where theirs is taken for none.

    Args:
        poses: (takes, K, n) rad, the training takes.
        measurement: (n, n) rad², noise of a measured pose.
        takes: what was measured of the takes that are filtered.
        dt: step of the motion grid in s.
        chain: the arm.
    """
    roots, without = spreads(poses, measurement)
    law = remembered(roots, memory(poses, measurement))
    return *linear_filter(poses.mean(axis=0), law, takes, dt, chain), without


def spreads(poses: np.ndarray, measurement: np.ndarray) -> tuple[np.ndarray, int]:
    """(K, n, n) rad, S_k^½ of the training takes' ``poses`` (takes, K, n) in rad, and along how
    many axes, over all steps, S_k is nothing; ``measurement`` (n, n) in rad² of a measured pose.
    """
    _, covariance = takes_moments(poses)
    left = [without_measurement(each, measurement) for each in covariance]
    return np.stack([root(each) for each, _ in left]), sum(without for _, without in left)


def memory(poses: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """(K,) r of the training takes, arguments as in :func:`spreads`; of takes that are nothing but
    measurement that of white noise.

    The measurement is white, as high at every frequency; where the takes' spectrum is lower, by
    chance, nothing is left of it, so that r is a positive semidefinite sequence.
    """
    deviation = poses - poses.mean(axis=0)
    takes, steps, _ = deviation.shape
    power = np.sum(np.abs(np.fft.rfft(deviation, 2 * steps, axis=1)) ** 2, axis=(0, 2))
    noise = (takes - 1) * steps * np.trace(measurement)
    products = np.fft.irfft(np.maximum(power - noise, 0.0), 2 * steps)[:steps]
    return products / products[0] if products[0] > 0 else np.eye(1, steps)[0]


def remembered(root_of_spread: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """(K, n, K, n) rad², Cov(e_k, e_l) of ``root_of_spread`` (K, n, n) and ``correlation`` (K,)."""
    steps = np.arange(len(correlation))
    apart = correlation[np.abs(steps[:, None] - steps)]
    return np.einsum("kia,lja,kl->kilj", root_of_spread, root_of_spread, apart)
