"""Inputs of the law of a joint's error, made of its command: of the mean and the variance."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray

YOUNG = (0.05, 0.2)  # s
TURN = 0.01  # rad/s, speed at which the smoothed sign is tanh 1
SLOW = 0.0125  # rad/s, speed at which a saturating variance has half of its growth
GROWTH = ("rest", "growth", "speed", "late sign", "jumps")  # terms of the variance s²
JUMPS = GROWTH.index("jumps")
INPUTS = (
    "offset",
    "speed",
    "acceleration",
    "sign",
    "fresh sign",
    "late sign",
    "fresh jumps",
    "late jumps",
)
SATURATING = "saturating"


class Drive(NamedTuple):
    """Inputs of the law at N samples of a command of n joints."""

    mean: ndarray  # (N, n, len(INPUTS)) x
    growth: ndarray  # (N, n, len(GROWTH)) factors of a, b, c and d


def smoothed(x: ndarray, keep: float) -> ndarray:
    """Exponential mean of ``x`` (N, ...) over time, from its first value; the weight of a value
    falls by the factor ``keep`` a sample.
    """
    result = (1 - keep) * x
    result[:1] = x[:1]
    lag = 1  # the sum of 2·lag terms is that of lag terms and, lag samples earlier, as many more
    while lag < len(x):
        result[lag:] = result[lag:] + keep**lag * result[:-lag]
        lag *= 2
    return result


def drive_of(
    speed: ndarray,
    acceleration: ndarray,
    sign: ndarray,
    young: Sequence[ndarray],
    power: float | str,
) -> Drive:
    """Return the inputs of speed in rad/s, acceleration without jumps, sign and ``young`` parts:
    two of the sign, then two of the jumps.
    """
    constant = np.ones_like(speed)
    zero = np.zeros_like(speed)
    size = np.abs(speed)
    late = [young[1] ** 2, young[3] ** 2]
    if power == 0:
        growth = [constant, zero, zero, zero, zero]
    elif power == SATURATING:
        saturated = speed**2 / (speed**2 + SLOW**2)
        growth = [constant, saturated, size, *late]
    else:
        growth = [constant, size**power, zero, *late]
    mean = [constant, speed, acceleration, sign, *young]
    return Drive(np.stack(mean, axis=-1), np.stack(growth, axis=-1))
