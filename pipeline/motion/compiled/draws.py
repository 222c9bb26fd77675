"""Random numbers for a block of particles, from the generator's own primitives and bit for bit as NumPy draws them."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import compiled
from pipeline.randommatrix.gamma import gamma_law, standard_gamma


@compiled()
def normals(rng: np.random.Generator, count: int, each: int) -> np.ndarray:
    """(each, count) the numbers of ``rng.standard_normal((count, each))``, those of one column in a row."""
    drawn = np.empty((each, count))
    for i in range(count):
        for j in range(each):
            drawn[j, i] = rng.standard_normal()
    return drawn


@compiled()
def chi_squares(rng: np.random.Generator, degrees: float, count: int) -> np.ndarray:
    """(count,) the numbers of ``rng.chisquare(degrees, count)``."""
    drawn, law = np.empty(count), gamma_law(degrees / 2.0)
    for i in range(count):
        drawn[i] = 2.0 * standard_gamma(law, rng)
    return drawn
