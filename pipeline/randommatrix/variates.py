"""χ² and normal variates in compiled code, bit for bit the draws of NumPy's Generator."""

import numpy as np

from pipeline.core.compiled import inner


@inner
def draw_variates(degrees, normals, block, chi_square, normal, start, stop, rng):
    """Draw variates of the poses from ``start`` to ``stop`` of the ``block`` (rows, poses): χ² of
    the ``degrees`` of freedom from row ``chi_square`` on, and ``normals`` a pose from row
    ``normal`` on. The normals of one pose are drawn consecutively.
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
    for i in range(start, stop):
        for j in range(normals):
            block[normal + j, i] = rng.standard_normal()


@inner
def _gamma(rng, scale, slope):
    """Gamma variate of shape above 1 as NumPy draws it (Marsaglia & Tsang 2000)."""
    while True:
        x = rng.standard_normal()
        v = 1.0 + slope * x
        if v <= 0.0:
            continue
        v = v * v * v
        square = x * x
        u = rng.random()
        if u < 1.0 - 0.0331 * square * square or np.log(u) < 0.5 * square + scale * (
            1.0 - v + np.log(v)
        ):
            return scale * v
