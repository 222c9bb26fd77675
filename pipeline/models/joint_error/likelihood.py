"""Composite likelihood of a joint's residuals at several horizons, compiled: its search needs some
hundred values for a joint. The predictions are those of :class:`JointErrorModel`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled

RADIUS = 0.9995  # greatest spectral radius of the memory
# weight of the squared log ratio of predicted and measured variance, nats a sample: a likelihood
# with heavy tails does not determine a variance
CALIBRATION = 0.25


class NoiseLaw(NamedTuple):
    """Parameters of one joint's law, the residuals being in units of its typical error."""

    memory: ndarray  # (3,) φ, ψ, χ
    scale: ndarray  # (len(GROWTH),) squared units per unit of the growth
    drift: float  # κ
    degrees: float  # ν


class Residuals(NamedTuple):
    """Residuals of one joint and the samples at which their predictions count."""

    r: ndarray  # (N,) residuals
    past: ndarray  # (N, 3) r, previous r and z
    growth: ndarray  # (N, len(GROWTH)) factors of the scale
    horizons: ndarray  # (H,) samples ahead
    ends: ndarray  # predicted samples of the first horizon, of the second, …
    counts: ndarray  # (H,) number of ``ends`` of each horizon
    least: float  # variance that every prediction has in addition


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
    law: NoiseLaw,
    keep: float,
    persistence: float,
    residuals: Residuals,
) -> float:
    """Mean negative log density of the residuals at their ends, summed over the horizons, plus the
    penalty CALIBRATION. ``keep`` is the weight of the last exponential mean in z, ``persistence``
    the autocorrelation of the drift at one sample.
    """
    std = np.sqrt(residuals.growth @ law.scale)
    longest = 0
    for horizon in residuals.horizons:
        longest = max(longest, horizon)
    weights = weights_ahead(law.memory, keep, longest)
    impulse = weights[:, 0] + (1 - keep) * weights[:, 2]
    least = residuals.least
    loss = 0.0
    first = 0
    for number in range(len(residuals.horizons)):
        horizon = residuals.horizons[number]
        count = residuals.counts[number]
        if count == 0:  # no part is as long as the horizon
            continue
        ends = residuals.ends[first : first + count]
        first += count
        variance = variances(impulse[:horizon], std, ends, law.drift, persistence)
        square = squared_errors(weights[horizon], residuals, ends, horizon)
        loss -= mean_log_density(square, variance, law.degrees, least)
        predicted = variance.sum() / count
        measured = square.sum() / count
        excess = math.log((predicted + least) / (measured + least))
        loss += CALIBRATION * excess**2
    return loss


@compiled
def weights_ahead(memory: ndarray, keep: float, longest: int) -> ndarray:
    """(longest + 1, 3) weights of r, previous r and z in the mean 0 … ``longest`` samples ahead."""
    companion = companion_of(memory, keep)
    weights = np.zeros((longest + 1, 3))
    weights[0, 0] = 1.0
    for i in range(longest):
        row = weights[i] @ companion
        for j in range(3):  # an assigned row compiles for two seconds
            weights[i + 1, j] = row[j]
    return weights


@compiled
def variances(
    impulse: ndarray,
    std: ndarray,
    ends: ndarray,
    drift: float,
    persistence: float,
) -> ndarray:
    """(len(ends),) variances of the residuals at ``ends``, one horizon after the last known one.

    ``impulse`` (horizon,) is the response to an innovation, ``std`` (N,) their standard deviation.
    """
    count = len(ends)
    white = np.zeros(count)
    drifted = np.zeros(count)
    response = np.zeros(count)
    for i in range(len(impulse)):
        for k in range(count):
            innovation = impulse[i] * std[ends[k] - i]
            white[k] += innovation**2
            # response to the drift i samples ago
            response[k] = innovation + persistence * response[k]
            drifted[k] += response[k] ** 2
    result = np.empty(count)
    for k in range(count):
        first = persistence**2 * response[k] ** 2  # the drift at the last known sample
        of_drift = (1 - persistence**2) * drifted[k] + first
        result[k] = (1 - drift) * white[k] + drift * of_drift
    return result


@compiled
def squared_errors(
    weights: ndarray,
    residuals: Residuals,
    ends: ndarray,
    horizon: int,
) -> ndarray:
    """(len(ends),) squared errors of the mean ``horizon`` samples ahead with ``weights`` (3,)."""
    result = np.empty(len(ends))
    for k in range(len(ends)):
        error = residuals.r[ends[k]]
        for i in range(3):
            error -= weights[i] * residuals.past[ends[k] - horizon, i]
        result[k] = error**2
    return result


@compiled
def mean_log_density(
    square: ndarray,
    variance: ndarray,
    degrees: float,
    least: float,
) -> float:
    """Mean log density of errors of these squares under Student's t, normal for infinite degrees,
    of ``variance`` plus the squared scale ``least``.
    """
    normal = math.isinf(degrees)
    unit = 1.0
    constant = -0.5 * math.log(2 * math.pi)
    if not normal:
        unit = (degrees - 2) / degrees
        constant = math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)
        constant -= 0.5 * math.log(degrees * math.pi)
    density = 0.0
    for k in range(len(square)):
        scale = variance[k] * unit + least
        z2 = square[k] / scale
        tail = z2 / 2
        if not normal:
            tail = (degrees + 1) / 2 * math.log1p(z2 / degrees)
        density += constant - tail - math.log(scale) / 2
    return density / len(square)
