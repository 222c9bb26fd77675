"""Equations of a small symmetric positive matrix, M = LDLᵀ, for compiled code."""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner


@inner
def factorize(matrix: np.ndarray, ridge: float, factor: np.ndarray) -> float:
    """Write L and D of ``matrix`` (m, m) + ``ridge``·I into ``factor`` (m, m): L below the
    diagonal, 1/D on it, (LD)ᵀ above; return the least share that a pivot has of its entry on the
    diagonal.
    """
    share = 1.0
    for i in range(len(matrix)):
        pivot = entire = matrix[i, i] + ridge
        for j in range(i):
            entry = matrix[i, j]
            for k in range(j):
                entry -= factor[k, i] * factor[j, k]
            factor[j, i] = entry
        for j in range(i):
            factor[i, j] = factor[j, i] * factor[j, j]
            pivot -= factor[j, i] * factor[i, j]
        factor[i, i] = 1 / pivot
        share = min(share, pivot / entire)
    return share


@inner
def solve(factor: np.ndarray, side: np.ndarray, solution: np.ndarray) -> float:
    """Write M⁻¹b into ``solution`` (m,) for ``side`` b (m,), and return bᵀM⁻¹b, for the ``factor``
    of M.
    """
    m, square = len(side), 0.0
    for i in range(m):
        entry = side[i]
        for j in range(i):
            entry -= factor[i, j] * solution[j]
        solution[i] = entry
    for i in range(m):
        scaled = solution[i] * factor[i, i]
        square += solution[i] * scaled
        solution[i] = scaled
    for i in range(m - 1, -1, -1):
        entry = solution[i]
        for j in range(i + 1, m):
            entry -= factor[j, i] * solution[j]
        solution[i] = entry
    return square
