"""How far encoders are off, as the takes show it that a motion capture saw as well: errors that
last over many readings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class EncoderNoise:
    """Errors of n encoders at the K steps of the motion, ``dt`` (s) apart."""

    bias: np.ndarray  # (K, n) rad, mean error
    covariance: np.ndarray  # (K, n, n) rad², of one reading about it
    lasts: float  # s, for which an error is the same error
    dt: float

    def of_readings(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(F, n) rad the bias of readings at the times ``t`` (F,) in s, one after the other, and
        (F, n, n) rad² a covariance by which they may be taken for independent.

        All the readings within :attr:`lasts` know together no more than one of them. So each has
        their number times its own covariance, as in the variance of the mean of a correlated
        sequence (Priestley, Spectral Analysis and Time Series, 1981).
        """
        steps = np.arange(len(self.bias))
        place = np.clip(t / self.dt, 0, steps[-1])
        bias = np.stack([np.interp(place, steps, b) for b in self.bias.T], axis=-1)
        together = max(1.0, self.lasts / float(np.median(np.diff(t)))) if len(t) > 1 else 1.0
        return bias, together * self.covariance[np.round(place).astype(int)]


def encoder_noise(errors: np.ndarray, dt: float) -> EncoderNoise:
    """The noise that ``errors`` (takes, K, n) in rad show, reading minus motion capture at every
    step of ``dt`` (s).

    Each deviation is from the mean of its step, of which the takes have one degree of freedom less.
    An error lasts for the sum of its correlations over all lags, of either sign, one value for all
    joints: the sum over takes and joints of squared sums over time, by that of squares. The
    covariance of a step is pooled over as long on either side.
    """
    takes, steps, n = errors.shape
    bias = errors.mean(axis=0)
    off = errors - bias
    squares = np.sum(off**2)
    lasting = np.sum(off.sum(axis=1) ** 2) / squares if squares > 0 else 1.0
    window = round(lasting)
    total = np.zeros((steps + 1, n, n))
    total[1:] = np.cumsum(np.einsum("tki,tkj->kij", off, off), axis=0)
    first = np.maximum(np.arange(steps) - window, 0)
    last = np.minimum(np.arange(steps) + window + 1, steps)
    freedom = (takes - 1) * (last - first)
    covariance = (total[last] - total[first]) / freedom[:, None, None]
    return EncoderNoise(bias, covariance, lasting * dt, dt)
