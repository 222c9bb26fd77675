"""The next pose as the training takes alone say it, the plain baselines of every motion model.

none: their mean and spread at the step, whatever was measured before. memory: that spread and one
correlation over time, the law of :mod:`pipeline.filtering.memory`, given the pose that was measured
before: of deviations e_k from the mean and y_k = e_k + N(0, Σ) as measured,

    E(e_{k+1} | y_k) = A y_k,    A = Cov(e_{k+1}, e_k)(S_k + Σ)⁻¹.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.filters import MEMORY, NONE
from pipeline.filtering.memory import memory, spreads
from pipeline.statistics.takes import takes_moments


def predicted_alone(
    training: np.ndarray, poses: np.ndarray, measurement: np.ndarray
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """By baseline the errors (..., K − 1, n) in rad of the predicted poses, measured minus
    predicted, and the covariances (K − 1, n, n) in rad² that were predicted of them.

    Args:
        training: (takes, K, n) rad, the training takes' poses.
        poses: (..., K, n) rad, those of the takes that are predicted.
        measurement: (n, n) rad², Σ, of one measured pose.
    """
    mean, spread = takes_moments(training)
    off = poses - mean
    roots, _ = spreads(training, measurement)
    each = roots @ roots
    across = memory(training, measurement)[1] * (roots[1:] @ roots[:-1])
    gain = np.swapaxes(np.linalg.solve(each[:-1] + measurement, np.swapaxes(across, 1, 2)), 1, 2)
    left = each[1:] + measurement - gain @ np.swapaxes(across, 1, 2)
    return {
        NONE: (off[..., 1:, :], spread[1:]),
        MEMORY: (
            off[..., 1:, :] - np.matvec(gain, off[..., :-1, :]),
            (left + np.swapaxes(left, 1, 2)) / 2,
        ),
    }
