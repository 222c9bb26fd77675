"""Moments over takes and the ends of 95 % intervals."""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ModelDomainError

TAILS = (0.025, 0.975)
NORMAL_QUANTILE = 1.959964  # standard errors from a normal estimate to the end of its interval


def takes_moments(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (M, n) and sample covariance (M, n, n) over the takes of ``samples`` (takes, M, n).

    The covariance is about the mean at its own step and divides by takes − 1. Raises
    ModelDomainError for a single take.
    """
    takes = len(samples)
    if takes < 2:
        raise ModelDomainError("a sample covariance needs at least two takes", takes=takes)
    mean = samples.mean(axis=0)
    centred = samples - mean
    return mean, np.einsum("tki,tkj->kij", centred, centred) / (takes - 1)


def percentile_interval(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the interval of ``values`` (N, ...) over the first axis that one further value would
    lie in with a probability of 95 %; least and greatest of them for N < 40.
    """
    low, high = np.quantile(values, TAILS, axis=0, method="weibull")
    return low, high


def student_quantile(degrees: int) -> float:
    """0.975 quantile of Student's law of ``degrees`` degrees of freedom."""
    from scipy.special import stdtrit  # here, as what loads a model does without SciPy

    return float(stdtrit(degrees, TAILS[1]))
