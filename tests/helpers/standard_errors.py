"""Deviations of sample means in standard errors."""

import numpy as np


def mean_scores(samples: np.ndarray, expected: np.ndarray | float = 0.0) -> np.ndarray:
    """Deviation of the mean of ``samples`` (N, …) from ``expected``, in standard errors."""
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return (samples.mean(axis=0) - expected) / error


def largest_score(samples: np.ndarray, expected: np.ndarray | float = 0.0) -> float:
    """Greatest absolute deviation of the entries' means from ``expected``, in standard errors."""
    return float(np.abs(mean_scores(samples, expected)).max())
