"""Weights of particles, compiled: by a measurement, normalised, all equal, and the moments under
them.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner
from pipeline.filtering.state import Frames


@inner
def weigh(
    frames: Frames, frame: int, before: np.ndarray, q: np.ndarray, log_weights: np.ndarray
) -> None:
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame`` at its share of the way from
    ``before`` to ``q`` (3, P).
    """
    share, log_norm = frames.share[frame], frames.log_norm[frame]
    y1, y2, y3 = frames.unbiased[frame, 0], frames.unbiased[frame, 1], frames.unbiased[frame, 2]
    white = frames.whitening[frame]
    w11, w21, w22, w31, w32, w33 = (
        white[0, 0],
        white[1, 0],
        white[1, 1],
        white[2, 0],
        white[2, 1],
        white[2, 2],
    )
    (p1, p2, p3), (q1, q2, q3) = (before[0], before[1], before[2]), (q[0], q[1], q[2])
    for i in range(len(log_weights)):
        d1 = y1 - (p1[i] + share * (q1[i] - p1[i]))
        d2 = y2 - (p2[i] + share * (q2[i] - p2[i]))
        d3 = y3 - (p3[i] + share * (q3[i] - p3[i]))
        e1, e2, e3 = w11 * d1, w21 * d1 + w22 * d2, w31 * d1 + w32 * d2 + w33 * d3
        log_weights[i] += log_norm - 0.5 * (e1 * e1 + e2 * e2 + e3 * e3)


@inner
def normalise(log_weights: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Normalise ``log_weights`` (P,) and fill ``weights``; the effective sample size 1/Σw² (Kong,
    Liu & Wong 1994), from 1, one particle carrying all, to P, all alike, and the logarithm of the
    sum of the weights as they were, which is not finite where all have vanished.
    """
    peak = -np.inf
    for i in range(len(log_weights)):
        if log_weights[i] > peak:
            peak = log_weights[i]
    if not np.isfinite(peak):
        return 0.0, peak
    total = squares = 0.0
    for i in range(len(log_weights)):
        weights[i] = np.exp(log_weights[i] - peak)
        total += weights[i]
        squares += weights[i] * weights[i]
    log_total = peak + np.log(total)
    for i in range(len(log_weights)):
        weights[i] /= total
        log_weights[i] -= log_total
    return total * total / squares, log_total


@inner
def make_equal(weights: np.ndarray, log_weights: np.ndarray) -> float:
    """Give all P particles the weight 1/P; the effective sample size, P."""
    count = len(weights)
    for i in range(count):
        weights[i], log_weights[i] = 1.0 / count, -np.log(count)
    return float(count)


@inner
def weighted_moments(
    weights: np.ndarray, q: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> None:
    """Fill ``mean`` (3,) and, about that mean, ``covariance`` (3, 3) of particles ``q`` (3, P)
    under normalised ``weights`` (P,).
    """
    q1, q2, q3 = q[0], q[1], q[2]
    m1 = m2 = m3 = 0.0
    for i in range(len(weights)):
        m1, m2, m3 = m1 + weights[i] * q1[i], m2 + weights[i] * q2[i], m3 + weights[i] * q3[i]
    c11 = c12 = c13 = c22 = c23 = c33 = 0.0
    for i in range(len(weights)):
        d1, d2, d3 = q1[i] - m1, q2[i] - m2, q3[i] - m3
        w1, w2, w3 = weights[i] * d1, weights[i] * d2, weights[i] * d3
        c11, c12, c13 = c11 + w1 * d1, c12 + w1 * d2, c13 + w1 * d3
        c22, c23, c33 = c22 + w2 * d2, c23 + w2 * d3, c33 + w3 * d3
    mean[0], mean[1], mean[2] = m1, m2, m3
    covariance[0, 0], covariance[0, 1], covariance[0, 2] = c11, c12, c13
    covariance[1, 0], covariance[1, 1], covariance[1, 2] = c12, c22, c23
    covariance[2, 0], covariance[2, 1], covariance[2, 2] = c13, c23, c33
