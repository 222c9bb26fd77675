"""Compiled functions that compiled functions alone can call, called from tests: inner ones and
schemes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit

from pipeline.models.draws import draw
from pipeline.randommatrix.words import words_of


@cache
def from_python(function: Callable) -> Callable:
    """``function`` within a compiled one of the same arguments; numba does not keep it, as it would
    be another in every process.
    """

    @njit
    def call(*arguments):
        return function(*arguments)

    return call


def chosen_by(scheme: Callable, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P,) indices that a resampling ``scheme`` chooses under ``weights`` (P,)."""
    chosen = np.full(len(weights), -1)
    from_python(scheme)(weights, chosen, np.full((2, len(weights)), np.nan), words_of(rng))
    return chosen


DRAW = from_python(draw)
