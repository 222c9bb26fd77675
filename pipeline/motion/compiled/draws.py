"""Random numbers for a block of particles, from the generator's own primitives and bit for bit as NumPy draws them."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import compiled


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
    """(count,) the numbers of ``rng.chisquare(degrees, count)``, in less than half the time.

    The method is the library's own (Marsaglia and Tsang, ACM Trans. Math. Softw. 26, 2000), of a gamma of shape ``degrees``/2; but the
    library takes a root and a quotient anew for every number, which depend on the shape alone.
    """
    drawn = np.empty(count)
    shape = degrees / 2.0
    if shape <= 1.0:  # another method, for fewer degrees than the fits find
        for i in range(count):
            drawn[i] = 2.0 * rng.standard_gamma(shape)
        return drawn
    b = shape - 1.0 / 3.0
    c = 1.0 / np.sqrt(9 * b)
    for i in range(count):
        while True:
            x = rng.standard_normal()
            v = 1.0 + c * x
            if v <= 0.0:
                continue
            v = v * v * v
            u = rng.random()
            # the first test is a bound of the second, without its logarithms
            if u < 1.0 - 0.0331 * (x * x) * (x * x) or np.log(u) < 0.5 * x * x + b * (1.0 - v + np.log(v)):
                break
        drawn[i] = 2.0 * (b * v)
    return drawn
