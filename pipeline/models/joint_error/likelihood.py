"""Composite likelihood of a joint's residuals at several horizons, compiled: its search needs some
hundred values for a joint. The predictions are those of :class:`JointErrorModel`.
"""

import math

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled

RADIUS = 0.9995  # greatest spectral radius of the memory
# weight of the squared log ratio of predicted and measured variance, nats a sample: a likelihood
# with heavy tails does not determine a variance
CALIBRATION = 0.25


@compiled
def damped_memory(memory: ndarray, factor: float, keep: float) -> ndarray:
    """(3,) ``memory`` φ, ψ, χ whose modes decay by ``factor`` more a sample, and by more if they
    would not fade; ``keep`` is the weight of the last exponential mean.
    """
    powers = np.array([1.0, 2.0, 1.0])
    while True:
        damped = memory * factor**powers
        radius = 0.0
        for mode in np.linalg.eigvals(companion_of(damped, keep).astype(np.complex128)):
            radius = max(radius, abs(mode))
        if radius <= RADIUS:
            return damped
        factor *= min(RADIUS / radius, 0.99999)


@compiled
def companion_of(memory: ndarray, keep: float) -> ndarray:
    """(3, 3) matrix that maps r, previous r and z of one joint to their mean a sample later."""
    matrix = np.zeros((3, 3))
    matrix[1, 0] = 1.0
    for i in range(3):  # loops compile in a third of the time of array expressions
        matrix[0, i] = memory[i]
        matrix[2, i] = (1 - keep) * memory[i]
    matrix[2, 2] += keep
    return matrix


@compiled
def composite_loss(
    memory,
    scale,
    drift,
    degrees,
    keep,
    persistence,
    r,
    past,
    growth,
    horizons,
    ends,
    counts,
    least,
) -> float:
    """Mean negative log density of the residuals ``r`` (N,) at samples ``ends``, summed over the
    ``horizons``, plus the penalty CALIBRATION. ``counts`` ends belong to each horizon.

    The law has ``memory`` (3,), ``scale`` (4,), ``drift`` κ and ``degrees`` ν; ``past`` (N, 3) are
    r, previous r and z, ``growth`` (N, 4) the factors of the scale, ``least`` a variance that
    every prediction has in addition. r, √scale and √least have one unit.
    """
    std = np.sqrt(growth @ scale)
    companion, longest = companion_of(memory, keep), 0
    for horizon in horizons:
        longest = max(longest, horizon)
    impulse, rows = np.empty(longest), np.zeros((longest + 1, 3))
    rows[0, 0] = 1.0
    for i in range(longest):
        impulse[i] = rows[i, 0] + (1 - keep) * rows[i, 2]
        row = rows[i] @ companion
        for j in range(3):  # an assigned row compiles for two seconds
            rows[i + 1, j] = row[j]
    normal = math.isinf(degrees)
    unit = 1.0 if normal else (degrees - 2) / degrees
    constant = -0.5 * math.log(2 * math.pi)
    if not normal:
        constant = math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)
        constant -= 0.5 * math.log(degrees * math.pi)
    loss, first = 0.0, 0
    for number in range(len(horizons)):
        horizon, count = horizons[number], counts[number]
        own_ends = ends[first : first + count]
        first += count
        white, own, drifted = np.zeros(count), np.zeros(count), np.zeros(count)
        for i in range(horizon):
            for k in range(count):
                each = impulse[i] * std[own_ends[k] - i]
                white[k] += each**2
                own[k] = (
                    each + persistence * own[k]
                )  # response to the drift i samples ago
                drifted[k] += own[k] ** 2
        density, predicted, measured = 0.0, 0.0, 0.0
        for k in range(count):
            off = r[own_ends[k]]
            for i in range(3):
                off -= rows[horizon, i] * past[own_ends[k] - horizon, i]
            of_drift = (1 - persistence**2) * drifted[k] + persistence**2 * own[k] ** 2
            variance = (1 - drift) * white[k] + drift * of_drift
            square = variance * unit + least
            z2 = off**2 / square
            tail = z2 / 2 if normal else (degrees + 1) / 2 * math.log1p(z2 / degrees)
            density += constant - tail - math.log(square) / 2
            predicted += variance
            measured += off**2
        if count:  # else no part is as long as the horizon
            loss -= density / count
            excess = math.log((predicted / count + least) / (measured / count + least))
            loss += CALIBRATION * excess**2
    return loss
