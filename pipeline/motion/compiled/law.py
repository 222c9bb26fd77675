"""What a compiled law of one step is: the function that the particle filter calls for a block of particles.

A law ``step(rng, parameters, arm, v, q, moved) -> clipped`` draws q_{k+1} for each of the n particles of a block. ``parameters`` (K,) are
the model's, ``arm`` the chain's, ``v`` the commanded step (m, m, rad); ``q`` are three arrays (n,), one a joint, in rad, and ``moved``
three more, to be filled; ``clipped`` is for how many of them the noise was clipped at zero.

A block is drawn from the generator just as the model's ``sample`` draws for n poses, so that one can be held against the other; the
Wishart model's law alone needs fewer numbers than its ``sample`` (:mod:`pipeline.motion.compiled.wishart`). A law first draws the numbers
of the whole block and then computes with them: a loop without a call to the generator is one that the compiler turns into instructions for
four particles at once. That is also why a joint has an array of its own.
"""

from __future__ import annotations

from numba import float64, int64, types

from pipeline.motion.compiled.chain import Arm

GENERATOR = types.npy_rng
VECTOR = types.Array(float64, 1, "C")
JOINTS = types.UniTuple(VECTOR, 3)
TASK = types.UniTuple(float64, 3)
ARM = types.NamedUniTuple(float64, len(Arm._fields), Arm)
STEP = int64(GENERATOR, VECTOR, ARM, TASK, JOINTS, JOINTS)
