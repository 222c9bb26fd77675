"""Law of a predicted joint error, Student's t or normal, and the probability of a recorded angle,
which is rounded.
"""

from math import lgamma
from typing import NamedTuple

import numpy as np
from numpy import ndarray


class Outlook(NamedTuple):
    """Law of the errors h samples after the last of the known ones, Student's t or normal."""

    mean: ndarray  # (..., n) rad
    variance: ndarray  # (..., n) rad², before the angles are rounded to their quantum
    degrees: ndarray  # (n,)

    def log_probability(self, error: ndarray, quantum: ndarray) -> ndarray:
        """(..., n) ln of the probability of the cell of width ``quantum`` (n,) in rad around
        ``error``, divided by the width; ln of the density where ``quantum`` is 0. In nats (1/rad).
        """
        factor = unit_variance_factor(self.degrees)
        scale = np.sqrt(self.variance * factor)
        off = np.abs(error - self.mean)
        z = off / scale
        degrees = np.broadcast_to(self.degrees, z.shape)
        log_density = standard_log_density(z, degrees) - np.log(scale)
        if not np.any(quantum > 0):
            return log_density
        half = quantum / scale / 2
        cell = cell_probability(z, half, degrees)
        width = np.where(quantum > 0, quantum, 1.0)
        positive = np.maximum(cell, 1e-300)
        log_cell = np.log(positive / width)
        return np.where(cell > 1e-280, log_cell, log_density)


def cell_probability(z: ndarray, half: ndarray, degrees: ndarray) -> ndarray:
    """(...,) probability of z ± ``half`` under the law of :func:`standard_log_density`."""
    from scipy.special import ndtr, stdtr

    low = -(z + half)
    high = -(z - half)
    normal = np.isinf(degrees)
    finite = np.where(normal, 1.0, degrees)
    student = stdtr(finite, high)
    student -= stdtr(finite, low)
    gaussian = ndtr(high)
    gaussian -= ndtr(low)
    return np.where(normal, gaussian, student)


def unit_variance_factor(degrees: ndarray) -> ndarray:
    """(n,) squared scale of Student's t of variance 1."""
    finite = np.where(np.isinf(degrees), 3.0, degrees)
    return np.where(np.isinf(degrees), 1.0, (finite - 2) / finite)


def standard_log_density(z: ndarray, degrees: ndarray) -> ndarray:
    """(...,) log density of Student's t of scale 1, or of the normal law for infinite degrees."""
    normal = np.isinf(degrees)
    square = z**2
    nu = np.where(normal, 4.0, degrees)
    values, places = np.unique(nu, return_inverse=True)
    gammas = []
    for value in values:
        numerator = lgamma((value + 1) / 2)
        gammas.append(numerator - lgamma(value / 2))
    of_gammas = np.array(gammas)[places]
    of_gammas = of_gammas.reshape(nu.shape)
    constant = of_gammas - 0.5 * np.log(nu * np.pi)
    tail = (nu + 1) / 2 * np.log1p(square / nu)
    student = constant - tail
    gaussian = -0.5 * (np.log(2 * np.pi) + square)
    return np.where(normal, gaussian, student)
