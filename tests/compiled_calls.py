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
    """(P,) indices that a resampling ``scheme`` chooses under ``weights`` (P,)."""
    chosen, scratch = np.full(len(weights), -1), np.full((2, len(weights)), np.nan)
    from_python(resample)(SCHEMES.index(scheme), weights, chosen, scratch, rng)
    return chosen
