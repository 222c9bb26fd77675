"""Normal and exponential variates one at a time, compiled: the very ones that NumPy draws.

The library's method, the ziggurat of Marsaglia and Tsang (J. Statistical Software 5:8, 2000), lays
256 strips of equal area under the density. A word chooses a strip and a place in it, and that is
the variate but for one word in a hundred, whose place is beside the next strip. NumPy's tables of
strips are taken from numba, which has a copy of them.
"""

from __future__ import annotations

import numpy as np
from numba.np.random import _constants as strips

from pipeline.core.compiled import inlined, passed
from pipeline.core.elementary import bits, of_bits
from pipeline.randommatrix.words import next_word, uniform

LOWEST, FRACTION, SIGN = np.uint64(0xFF), np.uint64(2**52 - 1), np.uint64(1 << 8)
TO_SIGN = np.uint64(63 - 8)
# of each strip of the normal law: the places that are under the next one too, the width of a place,
# and the density
INSIDE, WIDTH, DENSITY = strips.ki_double, strips.wi_double, strips.fi_double
TAIL, INVERSE_TAIL = strips.ziggurat_nor_r, strips.ziggurat_nor_inv_r
# the same of the exponential law
EXPONENTIAL_INSIDE, EXPONENTIAL_WIDTH = strips.ke_double, strips.we_double
EXPONENTIAL_DENSITY, EXPONENTIAL_TAIL = strips.fe_double, strips.ziggurat_exp_r


@inlined
def standard_normal(state: tuple) -> tuple[float, tuple]:
    """One number of ``rng.standard_normal()``, and the state of its words after it."""
    word, state = next_word(state)
    strip, place = word & LOWEST, (word >> np.uint64(9)) & FRACTION
    if place >= INSIDE[strip]:
        return _beside(word, state)
    x = np.int64(place) * WIDTH[strip]
    # the sign without a branch, which would be guessed wrong every other time
    return of_bits(bits(x) ^ np.int64((word & SIGN) << TO_SIGN)), state


@passed
def _beside(word: int, state: tuple) -> tuple[float, tuple]:
    """The same of a ``word`` whose place is beside the next strip."""
    while True:
        strip, place = word & LOWEST, (word >> np.uint64(9)) & FRACTION
        x = np.int64(place) * WIDTH[strip]
        if word & SIGN:
            x = -x
        if place < INSIDE[strip]:
            return x, state
        u, state = uniform(state)
        if strip == 0:
            return _tail(place, u, state)
        if (DENSITY[strip - 1] - DENSITY[strip]) * u + DENSITY[strip] < np.exp(-0.5 * x * x):
            return x, state
        word, state = next_word(state)


@inlined
def _tail(place: int, u: float, state: tuple) -> tuple[float, tuple]:
    """A normal variate beyond the strips, its first uniform number drawn."""
    while True:
        v, state = uniform(state)
        x, y = -INVERSE_TAIL * np.log1p(-u), -np.log1p(-v)
        if y + y > x * x:
            break
        u, state = uniform(state)
    return -(TAIL + x) if place & SIGN else TAIL + x, state


@passed
def standard_exponential(state: tuple) -> tuple[float, tuple]:
    """One number of ``rng.standard_exponential()``, and the state of its words after it."""
    while True:
        word, state = next_word(state)
        strip, place = (word >> np.uint64(3)) & LOWEST, word >> np.uint64(11)
        x = np.int64(place) * EXPONENTIAL_WIDTH[strip]
        if place < EXPONENTIAL_INSIDE[strip]:
            return x, state
        u, state = uniform(state)
        if strip == 0:
            return EXPONENTIAL_TAIL - np.log1p(-u), state
        above, below = EXPONENTIAL_DENSITY[strip - 1], EXPONENTIAL_DENSITY[strip]
        if (above - below) * u + below < np.exp(-x):
            return x, state
