"""χ² and normal variates in compiled code, those that NumPy's Generator draws bit for bit."""

import numpy as np

from pipeline.core.compiled import inner


@inner
def draw_variates(
    degrees: np.ndarray,
    sets: int,
    each: int,
    block: np.ndarray,
    chi_square: int,
    normal: int,
    start: int,
    stop: int,
    rng: np.random.Generator,
) -> None:
    """Fill rows of the poses from ``start`` to ``stop`` of the ``block``: from ``chi_square`` on a
    row for each of the ``degrees`` of freedom, from ``normal`` on ``sets``·``each`` rows, those of
    one pose and set drawn one after the other.
    """
    for k in range(len(degrees)):
        shape = 0.5 * degrees[k]
        if shape > 1.0:
            scale = shape - 1.0 / 3.0
            slope = 1.0 / np.sqrt(9.0 * scale)
            for i in range(start, stop):
                block[chi_square + k, i] = 2.0 * _gamma(rng, scale, slope)
        else:
            for i in range(start, stop):
                block[chi_square + k, i] = 2.0 * rng.standard_gamma(shape)
    for first in range(0, sets * each, max(each, 1)):
        for i in range(start, stop):
            for j in range(first, first + each):
                block[normal + j, i] = rng.standard_normal()


@inner
def _gamma(rng: np.random.Generator, scale: float, slope: float) -> float:
    """A gamma variate of shape above 1 as NumPy draws it (Marsaglia & Tsang 2000)."""
    while True:
        x = rng.standard_normal()
        v = 1.0 + slope * x
        if v <= 0.0:
            continue
        v, square, u = v * v * v, x * x, rng.random()
        if u < 1.0 - 0.0331 * square * square or np.log(u) < 0.5 * square + scale * (
            1.0 - v + np.log(v)
        ):
            return scale * v
