"""Compiled functions that compiled functions alone call, called from tests."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit

from pipeline.filtering.resampling import SCHEMES, resample


@cache
def from_python(function: Callable) -> Callable:
    """``function`` within a compiled one of the same arguments, which numba does not cache."""

    @njit(error_model="numpy")
    def call(*arguments):
        return function(*arguments)

    return call


def chosen_by(
    scheme: str, weights: np.ndarray, rng: np.random.Generator, beyond: int = 0
) -> np.ndarray:
    """(P,) indices that a resampling ``scheme`` chooses under ``weights`` (P,), with a buffer of
    ``beyond`` floats more than it needs; what it writes behind the indices is an error.
    """
    count = len(weights)
    chosen = np.full(count + beyond, -1)
    scratch = np.full((2, count + beyond), np.nan)
    scratch[:, count:] = 1.0  # left by an earlier use
    from_python(resample)(SCHEMES.index(scheme), weights, chosen[:count], scratch, rng)
    assert np.all(chosen[count:] == -1)
    return chosen[:count]
