"""Random numbers for a block of particles, from the generator's own primitives and bit for bit as NumPy draws them."""

from __future__ import annotations

import numpy as np

from pipeline.compiled import inner
from pipeline.motion.compiled.law import Numbers
from pipeline.motion.model import Law
from pipeline.randommatrix.variates import gamma_law, standard_gamma, standard_normal


def room_for(law: Law, particles: int) -> Numbers:
    """Room for the random numbers that a block of at most so many ``particles`` takes under ``law``."""
    sets, each = law.normals
    return Numbers(gamma_law(law.degrees / 2.0), each, np.empty(particles), np.empty((sets * each, particles)))


@inner
def draw(numbers: Numbers, count: int, rng: np.random.Generator) -> None:
    """Fill ``numbers`` for the first ``count`` particles of a block: the χ² variates of all of them, if there are any, then set by set the
    normals, those of one particle in a row."""
    if numbers.gamma[0] > 0.0:
        for i in range(count):
            numbers.chi_square[i] = 2.0 * standard_gamma(numbers.gamma, rng)
    for first in range(0, len(numbers.normal), numbers.each):
        for i in range(count):
            for row in range(first, first + numbers.each):
                numbers.normal[row, i] = standard_normal(rng)
