"""Bartlett's decomposition, compiled: Wishart matrices one after the other, at hardly more than the cost of their random numbers."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import compiled


def fill(draws: np.ndarray, d: float, root: np.ndarray, rng: np.random.Generator) -> None:
    """Fill ``draws`` (N, n, n) with (LT)(LT)ᵀ, L = ``root`` (n, n), T as in :func:`pipeline.randommatrix.wishart.sample`."""
    _bartlett(draws, root, tuple(_gamma_law((d - i) / 2) for i in range(len(root))), rng)


def _gamma_law(shape: float) -> tuple[float, float, float]:
    """Shape of a gamma law and the two constants of its draws, so that these take no root of them each time."""
    if shape <= 1:
        return shape, 0.0, 0.0
    return shape, shape - 1 / 3, 1 / np.sqrt(9 * (shape - 1 / 3))


@compiled()
def _bartlett(draws: np.ndarray, root: np.ndarray, laws: tuple, rng: np.random.Generator) -> None:
    """Fill ``draws`` (N, n, n) for L = ``root`` (n, n) and the ``laws`` of T_ii²/2, one for each of the n rows."""
    # of a tuple the compiler knows the length, and leaves no loop over n
    n = len(laws)
    triangle, factor = np.zeros((n, n)), np.zeros((n, n))
    for number in range(len(draws)):
        for i in range(n):
            for j in range(i):
                triangle[i, j] = rng.standard_normal()
            shape, scale, slope = laws[i]
            triangle[i, i] = np.sqrt(2 * _standard_gamma(shape, scale, slope, rng))
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


@compiled()
def _standard_gamma(shape: float, scale: float, slope: float, rng: np.random.Generator) -> float:
    """A gamma variate by the squeeze of Marsaglia and Tsang (ACM Trans. Math. Software 26, 2000), the very one that NumPy draws."""
    if shape <= 1.0:
        return rng.standard_gamma(shape)
    while True:
        x = rng.standard_normal()
        cube = (1.0 + slope * x) ** 3
        if cube <= 0.0:
            continue
        u, square = rng.random(), x * x
        if u < 1.0 - 0.0331 * square * square or np.log(u) < 0.5 * square + scale * (1.0 - cube + np.log(cube)):
            return scale * cube
