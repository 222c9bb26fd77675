"""Weights of particles, compiled: by a measurement, normalised, all equal, and the moments under
them.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import ArmConstants
from pipeline.arm.kinematics import WIDTH, add_displacement, tip
from pipeline.arm.rows import JOINTS
from pipeline.core.compiled import inlined, inner
from pipeline.core.elementary import exponential, greatest, inner_product, total

NEAR = 256  # particles whose scratch stays in the processor's nearest cache
ROWS = 6  # of a displacement of the tip


@inner
def weigh(arm, space, frames, frame, before, q, log_weights, scratch):
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame`` at its share of the way from
    ``before`` to ``q`` (n, P); ``scratch`` has (n + ROWS + 2, WIDTH) floats or more.

    Poses of the tip need an arm in space, ``space`` not None.
    """
    n, share, log_norm = len(q), frames.share[frame], frames.log_norm[frame]
    white, measured = frames.whitening[frame], frames.unbiased[frame]
    whitened, square = scratch[n + ROWS], scratch[n + ROWS + 1]
    rest = scratch[n : n + ROWS] if frames.tip else scratch[:n]
    for start in range(0, len(log_weights), WIDTH):
        count = min(WIDTH, len(log_weights) - start)
        # slices: the compiler knows that none of their indices is negative
        stop = start + count
        for j in range(n):
            here, there, pose = before[j, start:stop], q[j, start:stop], scratch[j]
            for i in range(count):
                pose[i] = here[i] + share * (there[i] - here[i])
        if not frames.tip:
            for j in range(n):
                y, pose = measured[j], scratch[j]
                for i in range(count):
                    pose[i] = y - pose[i]
        if space is not None:  # else its kinematics are not compiled
            if frames.tip:
                displacement(arm, measured, scratch, rest, count)
        square[:count] = 0.0
        for j in range(len(white)):
            add_square(white, j, rest, whitened, square, count)
        own = log_weights[start:stop]
        for i in range(count):
            own[i] += log_norm - 0.5 * square[i]


@inner
def displacement(arm, measured, poses, rest, count):
    """Fill ``rest`` (6, count) with the displacements of the ``measured`` tip of ``arm`` from its
    pose at ``poses`` (n, count).
    """
    # the whole pose, in metres and radians, whatever the task
    whole = ArmConstants(
        arm.plane, arm.frames, arm.sliding, np.arange(ROWS), np.ones(ROWS), arm.least
    )
    first = JOINTS + 6 * len(arm.sliding)
    block = np.empty((first + ROWS, WIDTH))
    tip(whole, poses, 0, count, block)
    block[first:] = 0.0
    add_displacement(whole, measured, block, first, 1.0, count)
    rest[:, :count] = block[first:, :count]


@inlined
def add_square(white, j, rest, whitened, square, count):
    """Add to ``square`` the square of row ``j`` of the lower triangular ``white`` times ``rest``
    (j + 1 or more, count), by way of ``whitened``.
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
def normalise(log_weights, weights):
    """Normalise ``log_weights`` (P,) and fill ``weights``; return the effective sample size 1/Σw²
    (Kong, Liu & Wong 1994) and the log of the former sum, not finite where all have vanished.
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
def weighted_moments(weights, q, mean, covariance, scratch):
    """Fill ``mean`` (n,) and, about that mean, ``covariance`` (n, n) of particles ``q`` (n, P)
    under normalised ``weights`` (P,); ``scratch`` has (n + 1, NEAR) floats or more.
    """
    n = len(q)
    for j in range(n):
        mean[j] = inner_product(weights, q[j])
        for k in range(n):
            covariance[j, k] = 0.0
    for start in range(0, len(weights), NEAR):
        count = min(NEAR, len(weights) - start)
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
