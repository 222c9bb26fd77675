"""How well errors and their stated bounds agree."""

from __future__ import annotations

import numpy as np


def root_mean_square(values: np.ndarray) -> float:
    """Root mean square of all ``values``, in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's correlation of ``a`` and ``b`` (K,); 0 where one of them is constant, and so
    follows nothing.
    """
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def lag_one_correlation(values: np.ndarray) -> float:
    """Correlation of ``values`` (takes, K), about their mean over the takes at each step, with
    those one step later; 0 of white noise.
    """
    centred = values - values.mean(axis=0)
    scale = np.sqrt(np.sum(centred[:, :-1] ** 2) * np.sum(centred[:, 1:] ** 2))
    return float(np.sum(centred[:, :-1] * centred[:, 1:]) / scale) if scale > 0 else 0.0


def coverage(error: np.ndarray, bound: np.ndarray) -> float:
    """Share of ``error`` within ± ``bound``, both of one shape; 0.683 for a calibrated normal error
    and its standard deviation.
    """
    return float(np.mean(np.abs(error) <= bound))


def variation(values: np.ndarray) -> float:
    """Coefficient of variation of ``values`` (K,) over time, standard deviation over mean; 0 where
    they are constant.
    """
    return float(values.std() / values.mean()) if np.ptp(values) else 0.0
