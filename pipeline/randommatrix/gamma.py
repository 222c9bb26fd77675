"""Gamma variates one at a time, compiled: the very ones that NumPy draws, in less than half the time.

The method is the library's own, of Marsaglia and Tsang (ACM Trans. Math. Software 26, 2000); but the library takes a root and a quotient
anew for every number, which depend on the shape alone.
"""

from __future__ import annotations

import numpy as np

from pipeline.compiled import compiled, inlined


@compiled()
def gamma_law(shape: float) -> tuple[float, float, float]:
    """``shape`` of a gamma law of scale 1, and the two constants of its draws."""
    if shape <= 1.0:  # drawn by another method
        return shape, 0.0, 0.0
    return shape, shape - 1.0 / 3.0, 1.0 / np.sqrt(9.0 * (shape - 1.0 / 3.0))


@inlined
def standard_gamma(law: tuple[float, float, float], rng: np.random.Generator) -> float:
    """One number of ``rng.standard_gamma(shape)``, its ``law`` from :func:`gamma_law`."""
    shape, scale, slope = law
    if shape <= 1.0:
        return rng.standard_gamma(shape)
    while True:
        x = rng.standard_normal()
        v = 1.0 + slope * x
        if v <= 0.0:
            continue
        v, u, square = v * v * v, rng.random(), x * x
        # the first test is a bound of the second, without its logarithms
        if u < 1.0 - 0.0331 * square * square or np.log(u) < 0.5 * square + scale * (1.0 - v + np.log(v)):
            return scale * v
