"""Random variates one at a time, compiled: the very ones that NumPy draws, gamma variates in less
than half the time.

How NumPy's primitives are drawn is compiled here, once, and kept: whoever draws calls these. They
are whole functions: as parts of their callers they would take half as long again.

The methods for gamma variates are the library's own: of Marsaglia and Tsang (ACM Trans. Math.
Software 26, 2000) for shapes above 1, GS of Ahrens and Dieter (Computing 12, 1974) for those below.
But the library takes a root and a quotient anew for every number, which depend on the shape alone.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.core.compiled import inlined, passed

NEAR_ONE = 1.0 - 1e-9  # less than 1 by more than the rounding of the last test of a gamma variate


@passed
def standard_normal(rng: np.random.Generator) -> float:
    """One number of ``rng.standard_normal()``."""
    return rng.standard_normal()


@passed
def uniform(rng: np.random.Generator) -> float:
    """One number of ``rng.random()``."""
    return rng.random()


@passed
def standard_exponential(rng: np.random.Generator) -> float:
    """One number of ``rng.standard_exponential()``."""
    return rng.standard_exponential()


def gamma_law(shape: float) -> tuple[float, float, float]:
    """``shape`` of a gamma law of scale 1, and the two constants of its draws."""
    if shape <= 1.0:  # drawn by the other method
        return shape, 0.0, 0.0
    return shape, shape - 1.0 / 3.0, 1.0 / math.sqrt(9.0 * (shape - 1.0 / 3.0))


@inlined
def standard_gamma(law: tuple[float, float, float], rng: np.random.Generator) -> float:
    """One number of ``rng.standard_gamma(shape)``, its ``law`` from :func:`gamma_law`."""
    shape, scale, slope = law
    if shape <= 1.0:
        return _up_to_one(shape, rng)
    while True:
        x = standard_normal(rng)
        t = slope * x
        v = 1.0 + t
        if v <= 0.0:
            continue
        v, u, square = v * v * v, uniform(rng), x * x
        # the last test alone takes logarithms; two bounds of it settle most numbers, one of this
        # shape, by the series of ln v, and the library's
        if abs(t) < 0.5 and u < NEAR_ONE - t * t * square / 6.0:
            return scale * v
        if u < 1.0 - 0.0331 * square * square or np.log(u) < 0.5 * square + scale * (
            1.0 - v + np.log(v)
        ):
            return scale * v


@passed
def _up_to_one(shape: float, rng: np.random.Generator) -> float:
    """Of a ``shape`` of 1 or less. Not inlined: it would be compiled with all that draws, and few
    draw from it.
    """
    while shape < 1.0:
        u, bound = uniform(rng), standard_exponential(rng)
        if u <= 1.0 - shape:
            x = u ** (1.0 / shape)
        else:
            beyond = -np.log((1.0 - u) / shape)
            x, bound = (1.0 - shape + shape * beyond) ** (1.0 / shape), bound + beyond
        if x <= bound:
            return x
    return standard_exponential(rng)
