"""Samples spread on the nodes of a grid by the quadratic B-spline, compiled. A sample adds to 3 × 3
nodes, in the order of the samples.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import compiled, inlined


def spread(samples: np.ndarray, low: np.ndarray, step: np.ndarray, masses: np.ndarray) -> None:
    """Add to ``masses`` (rows, columns), one behind the other, those of ``samples`` (N, 2) on nodes
    from ``low`` (2,) on, ``step`` (2,) apart; of those that lie inside, the last column left free.
    """
    _spread(np.ascontiguousarray(samples, dtype=float), low, step, masses)


@compiled
def _spread(samples: np.ndarray, low: np.ndarray, step: np.ndarray, masses: np.ndarray) -> None:
    rows, columns = masses.shape
    flat = masses.reshape(-1)
    start0, start1, per0, per1 = low[0], low[1], 1 / step[0], 1 / step[1]
    for i in range(samples.shape[0]):
        # the nearest node and the one before it, from which the three count
        row, column = (samples[i, 0] - start0) * per0 - 0.5, (samples[i, 1] - start1) * per1 - 0.5
        if (0.0 <= row) & (row < rows - 2) & (0.0 <= column) & (column < columns - 3):
            first_row, first_column = np.int64(row), np.int64(column)
            place = np.uint64(first_row * columns + first_column)
            down, across = _shares(row - first_row), _shares(column - first_column)
            for k in range(3):
                for j in range(3):
                    flat[place + np.uint64(j)] += down[k] * across[j]
                place += np.uint64(columns)


@inlined
def _shares(t: float) -> tuple[float, float, float]:
    """Shares of three nodes, ``t`` in [0, 1) from halfway between the first two to halfway between
    the last two.
    """
    return 0.5 - t + 0.5 * t * t, 0.5 + t - t * t, 0.5 * t * t
