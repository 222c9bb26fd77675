"""Gamma variates one at a time, compiled: the very ones that NumPy draws.

The methods are the library's own: of Marsaglia and Tsang (ACM Trans. Math. Software 26, 2000) for
shapes above 1, GS of Ahrens and Dieter (Computing 12, 1974) for those below. But the library takes
a root and a quotient anew for every number, which depend on the shape alone.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.core.compiled import inlined, passed
from pipeline.randommatrix.words import uniform
from pipeline.randommatrix.ziggurat import standard_exponential, standard_normal

NEAR_ONE = 1.0 - 1e-9  # less than 1 by more than the rounding of the last test of a gamma variate


def gamma_law(shape: float) -> tuple[float, float, float]:
    """``shape`` of a gamma law of scale 1, and the two constants of its draws."""
    if shape <= 1.0:  # drawn by the other method
        return shape, 0.0, 0.0
    return shape, shape - 1.0 / 3.0, 1.0 / math.sqrt(9.0 * (shape - 1.0 / 3.0))


@inlined
def standard_gamma(law: tuple[float, float, float], state: tuple) -> tuple[float, tuple]:
    """One number of ``rng.standard_gamma(shape)``, its ``law`` from :func:`gamma_law`, and the
    state of its words after it.
    """
    shape, scale, slope = law
    if shape <= 1.0:
        return _up_to_one(shape, state)
    while True:
        x, state = standard_normal(state)
        t = slope * x
        v = 1.0 + t
        if v <= 0.0:
            continue
        u, state = uniform(state)
        v, square = v * v * v, x * x
        # the last test alone takes logarithms; two bounds of it settle most numbers, one of this
        # shape, by the series of ln v, and the library's
        if abs(t) < 0.5 and u < NEAR_ONE - t * t * square / 6.0:
            return scale * v, state
        if u < 1.0 - 0.0331 * square * square or np.log(u) < 0.5 * square + scale * (
            1.0 - v + np.log(v)
        ):
            return scale * v, state


@passed
def _up_to_one(shape: float, state: tuple) -> tuple[float, tuple]:
    """Of a ``shape`` of 1 or less. Not inlined: it would be compiled with all that draws, and few
    draw from it.
    """
    while shape < 1.0:
        u, state = uniform(state)
        bound, state = standard_exponential(state)
        if u <= 1.0 - shape:
            x = u ** (1.0 / shape)
        else:
            beyond = -np.log((1.0 - u) / shape)
            x, bound = (1.0 - shape + shape * beyond) ** (1.0 / shape), bound + beyond
        if x <= bound:
            return x, state
    return standard_exponential(state)
