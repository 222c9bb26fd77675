"""Sums over particles in compiled code, vectorised and of the same bits on every processor.

A sum in the order of its terms waits for each addition, and a compiler that reorders it gives other
bits on wider processors. So term i is added to partial sum i modulo 8, and the eight are added at
the end.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.compiled import inner

LANES = 8


@inner
def inner_product(x: np.ndarray, y: np.ndarray) -> float:
    """Σ x_i y_i."""
    a = b = c = d = e = f = g = h = 0.0
    whole = len(x) // LANES * LANES
    for i in range(0, whole, LANES):
        a += x[i] * y[i]
        b += x[i + 1] * y[i + 1]
        c += x[i + 2] * y[i + 2]
        d += x[i + 3] * y[i + 3]
        e += x[i + 4] * y[i + 4]
        f += x[i + 5] * y[i + 5]
        g += x[i + 6] * y[i + 6]
        h += x[i + 7] * y[i + 7]
    for i in range(whole, len(x)):
        a += x[i] * y[i]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@inner
def total(x: np.ndarray) -> float:
    """Σ x_i."""
    a = b = c = d = e = f = g = h = 0.0
    whole = len(x) // LANES * LANES
    for i in range(0, whole, LANES):
        a += x[i]
        b += x[i + 1]
        c += x[i + 2]
        d += x[i + 3]
        e += x[i + 4]
        f += x[i + 5]
        g += x[i + 6]
        h += x[i + 7]
    for i in range(whole, len(x)):
        a += x[i]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@inner
def greatest(x: np.ndarray) -> float:
    """The greatest of ``x``, which may be −∞; NaN is ignored."""
    a = b = c = d = -np.inf
    whole = len(x) // 4 * 4
    for i in range(0, whole, 4):
        a = x[i] if x[i] > a else a
        b = x[i + 1] if x[i + 1] > b else b
        c = x[i + 2] if x[i + 2] > c else c
        d = x[i + 3] if x[i + 3] > d else d
    for i in range(whole, len(x)):
        a = x[i] if x[i] > a else a
    a, b = (a if a > b else b), (c if c > d else d)
    return a if a > b else b
