"""What a compiled law of one step is: the function that the particle filter calls for a block of particles.

A law ``step(numbers, parameters, arm, v, q, moved) -> clipped`` makes q_{k+1} of the n particles of a block of their random ``numbers``.
``parameters`` (K,) are the model's, ``arm`` the chain's, ``v`` the commanded step (m, m, rad); ``q`` are three arrays (n,), one a joint,
in rad, and ``moved`` three more, to be filled; ``clipped`` is for how many of them the noise was clipped at zero. Which numbers a step
takes is said by :class:`pipeline.motion.model.Law`.

The numbers of a block are those that the model's ``sample`` draws for n poses, so that one can be held against the other; the Wishart
model's law alone needs fewer (:mod:`pipeline.motion.compiled.wishart`). That they are there before the law begins has two reasons: a loop
without a call to the generator is one that the compiler turns into instructions for four particles at once, and how numbers are drawn is
compiled once and not in every law. A joint has an array of its own for the first reason too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64, int64, types

from pipeline.compiled import MATRIX, VECTOR
from pipeline.motion.compiled.chain import Arm


class Numbers(NamedTuple):
    """Standard random numbers of a block of at most n particles."""

    gamma: tuple[float, float, float]  # law of half a χ² variate (pipeline.randommatrix.variates); shape 0 where a step takes none
    each: int  # normals of a particle in a set
    chi_square: np.ndarray  # (n,)
    normal: np.ndarray  # (sets·each, n)


GENERATOR = types.npy_rng
JOINTS = types.UniTuple(VECTOR, 3)
TRIPLE = types.UniTuple(float64, 3)
NUMBERS = types.NamedTuple((TRIPLE, int64, VECTOR, MATRIX), Numbers)
ARM = types.NamedUniTuple(float64, len(Arm._fields), Arm)
STEP = int64(NUMBERS, VECTOR, ARM, TRIPLE, JOINTS, JOINTS)
