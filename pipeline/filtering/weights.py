"""Weights of particles, compiled: by a measurement, normalised, all equal, and the moments under
them.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inlined, inner
from pipeline.core.elementary import exponential, greatest, inner_product, total
from pipeline.filtering.state import Frames

NEAR = 256  # particles whose scratch stays in the processor's nearest cache


@inner
def weigh(
    frames: Frames,
    frame: int,
    before: np.ndarray,
    q: np.ndarray,
    log_weights: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame`` at its share of the way from
    ``before`` to ``q`` (n, P); ``scratch`` has (n + 2, NEAR) floats.
    """
    n, share, log_norm = len(q), frames.share[frame], frames.log_norm[frame]
    white, square, whitened = frames.whitening[frame], scratch[n], scratch[n + 1]
    for start in range(0, len(log_weights), NEAR):
        count = NEAR if start + NEAR < len(log_weights) else len(log_weights) - start
        # slices: the compiler knows of their indices that none is negative
        stop = start + count
        for i in range(count):
            square[i] = 0.0
        for j in range(n):
            y, rest = frames.unbiased[frame, j], scratch[j]
            here, there = before[j, start:stop], q[j, start:stop]
            for i in range(count):
                rest[i] = y - (here[i] + share * (there[i] - here[i]))
            add_square(white, j, scratch, whitened, square, count)
        total = log_weights[start:stop]
        for i in range(count):
            total[i] += log_norm - 0.5 * square[i]


@inlined
def add_square(
    white: np.ndarray,
    j: int,
    rest: np.ndarray,
    whitened: np.ndarray,
    square: np.ndarray,
    count: int,
) -> None:
    """Add to ``square`` that of row ``j`` of the lower triangular ``white`` times ``rest`` (j + 1
    or more, count), ``whitened``.
    """
    for i in range(count):
        whitened[i] = 0.0
    for k in range(j + 1):
        w, other = white[j, k], rest[k]
        for i in range(count):
            whitened[i] += w * other[i]
    for i in range(count):
        square[i] += whitened[i] * whitened[i]


@inner
def normalise(log_weights: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Normalise ``log_weights`` (P,) and fill ``weights``; the effective sample size 1/Σw² (Kong,
    Liu & Wong 1994), from 1, one particle carrying all, to P, all alike, and the logarithm of the
    sum of the weights as they were, which is not finite where all have vanished.
    """
    peak = greatest(log_weights)
    if not np.isfinite(peak):
        return 0.0, peak
    for i in range(len(weights)):
        weights[i] = exponential(log_weights[i] - peak)
    scale, squares = total(weights), inner_product(weights, weights)
    log_total, share = peak + np.log(scale), 1 / scale
    for i in range(len(weights)):
        weights[i] *= share
        log_weights[i] -= log_total
    return scale * scale / squares, log_total


@inner
def make_equal(weights: np.ndarray, log_weights: np.ndarray) -> float:
    """Give all P particles the weight 1/P; the effective sample size, P."""
    count = float(len(weights))
    each, log_each = 1.0 / count, -np.log(count)
    for i in range(len(weights)):
        weights[i], log_weights[i] = each, log_each
    return count


@inner
def weighted_moments(
    weights: np.ndarray,
    q: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """Fill ``mean`` (n,) and, about that mean, ``covariance`` (n, n) of particles ``q`` (n, P)
    under normalised ``weights`` (P,); ``scratch`` has (n + 2, NEAR) floats.
    """
    n = len(q)
    for j in range(n):
        mean[j] = inner_product(weights, q[j])
        for k in range(n):
            covariance[j, k] = 0.0
    for start in range(0, len(weights), NEAR):
        count = NEAR if start + NEAR < len(weights) else len(weights) - start
        weight, weighted = weights[start : start + count], scratch[n, :count]
        for j in range(n):
            angle, middle, deviation = q[j, start : start + count], mean[j], scratch[j, :count]
            for i in range(count):
                deviation[i] = angle[i] - middle
                weighted[i] = weight[i] * deviation[i]
            for k in range(j + 1):
                covariance[j, k] += inner_product(weighted, scratch[k, :count])
    for j in range(n):
        for k in range(j):
            covariance[k, j] = covariance[j, k]
