"""Compiled functions that compiled functions alone call, called from tests."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit

from pipeline.filtering.sampling import SCHEMES, resample


@cache
def from_python(function: Callable) -> Callable:
    """``function`` within a compiled one of the same arguments, which numba does not cache."""

    @njit(error_model="numpy")
    def call(*arguments):
        return function(*arguments)

    return call


def chosen_by(scheme: str, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P,) indices that a resampling ``scheme`` chooses under ``weights`` (P,), with a longer
    buffer that an earlier use has filled; nothing is written behind the indices.
    """
    count = len(weights)
    longer = len(weights) + 200
    chosen = np.full(longer, -1)
    scratch = np.ones((2, longer))
    number = SCHEMES.index(scheme)

    from_python(resample)(number, weights, chosen[:count], scratch, rng)

    assert np.all(chosen[count:] == -1)
    return chosen[:count]
