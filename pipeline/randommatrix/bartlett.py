"""Bartlett's decomposition, compiled: Wishart matrices one after the other, at hardly more than the
cost of their random numbers.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled
from pipeline.randommatrix.variates import gamma_law, standard_gamma
from pipeline.randommatrix.words import close, opened, words_of
from pipeline.randommatrix.ziggurat import standard_normal


def fill(draws: np.ndarray, d: float, root: np.ndarray, rng: np.random.Generator) -> None:
    """Fill ``draws`` (N, n, n) with (LT)(LT)ᵀ, L = ``root`` (n, n), T as in
    :func:`pipeline.randommatrix.wishart.sample`.
    """
    _bartlett(draws, root, tuple(gamma_law((d - i) / 2) for i in range(len(root))), words_of(rng))


@compiled()
def _bartlett(draws: np.ndarray, root: np.ndarray, laws: tuple, words: np.ndarray) -> None:
    """Fill ``draws`` (N, n, n) for L = ``root`` (n, n) and the ``laws`` of T_ii²/2, one for each of
    the n rows, from ``words`` (4,).
    """
    # of a tuple the compiler knows the length, and leaves no loop over n
    n = len(laws)
    triangle, factor = np.zeros((n, n)), np.zeros((n, n))
    state = opened(words)
    for number in range(len(draws)):
        for i in range(n):
            for j in range(i):
                triangle[i, j], state = standard_normal(state)
            half, state = standard_gamma(laws[i], state)
            triangle[i, i] = np.sqrt(2 * half)
        for i in range(n):
            for j in range(i + 1):
                entry = 0.0
                for k in range(j, i + 1):
                    entry += root[i, k] * triangle[k, j]
                factor[i, j] = entry
        for i in range(n):
            for j in range(i + 1):
                entry = 0.0
                for k in range(j + 1):
                    entry += factor[i, k] * factor[j, k]
                draws[number, i, j] = draws[number, j, i] = entry
    close(words, state)
