"""Random sequences of a known correlation."""

import numpy as np
from scipy.signal import lfilter


def correlated(draws: np.ndarray, share: float, axis: int = 0) -> np.ndarray:
    """Stationary first-order sequence along ``axis`` of independent ``draws`` of equal variance:
    neighbours have the correlation ``share``, and the variance stays.
    """
    fresh = np.moveaxis(draws, axis, 0).copy()
    fresh[1:] *= np.sqrt(1 - share**2)
    sequence = lfilter([1.0], [1.0, -share], fresh, axis=0)
    return np.moveaxis(sequence, 0, axis)
