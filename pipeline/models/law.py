"""What a compiled law of one step is: the function that moves a block of poses.

A law ``step(numbers, parameters, arm, v, q, moved) -> clipped`` makes q_{k+1} of the poses of a
block of their random ``numbers``. ``parameters`` (K,) are the model's, ``arm`` the chain's; ``v``
has an array (N,) for each task row, the poses' commanded steps (m, m, rad), ``q`` one for each
joint, in rad, and ``moved`` as many, to be filled; ``clipped`` is for how many of them the noise
was clipped at zero. Which numbers a step takes is said by :class:`pipeline.models.model.Law`.

That the numbers of a block are there before the law begins has two reasons: a loop without a call
to the generator is one that the compiler turns into instructions for four poses at once, and how
numbers are drawn is compiled once and not in every law. A joint has an array of its own for the
first reason too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64, int64, types

from pipeline.arm.chain import JOINTS
from pipeline.arm.compiled import ARM, Arm, joint_step, segments
from pipeline.core.compiled import MATRIX, VECTOR, inlined
from pipeline.core.errors import ModelDomainError


class Numbers(NamedTuple):
    """Standard random numbers of a block of at most N poses."""

    # law of half a χ² variate (pipeline.randommatrix.variates); shape 0 where a step takes none
    gamma: tuple[float, float, float]
    each: int  # normals of a pose in a set
    chi_square: np.ndarray  # (N,)
    normal: np.ndarray  # (sets·each, N)
    command: np.ndarray  # (m, N) room for the commanded step of each pose


GENERATOR = types.npy_rng
ROW = types.UniTuple(float64, JOINTS)  # a number for each joint or task row
NUMBERS = types.NamedTuple((types.UniTuple(float64, 3), int64, VECTOR, MATRIX, MATRIX), Numbers)
BLOCKS = types.UniTuple(VECTOR, JOINTS)
CUBE = types.Array(float64, 3, "C")
STEP = int64(NUMBERS, VECTOR, ARM, BLOCKS, BLOCKS, BLOCKS)


def row_by_row(matrix: np.ndarray) -> np.ndarray:
    """(n·n,) ``matrix`` (n, n) as the parameters of a law hold it.

    Raises ModelDomainError where n is not the number of joints that laws are compiled for.
    """
    if matrix.shape != (JOINTS, JOINTS):
        raise ModelDomainError(
            f"a step is compiled for {JOINTS} joints, not for a matrix of another size",
            shape=matrix.shape,
        )
    return matrix.ravel()


@inlined
def block(q: np.ndarray, start: int, stop: int) -> tuple[np.ndarray, ...]:
    """Poses ``start`` to ``stop`` of ``q`` (n, N), an array for each joint."""
    return q[0, start:stop], q[1, start:stop], q[2, start:stop]


@inlined
def at(q: tuple, i: int) -> tuple[float, ...]:
    """The joint angles, or the commanded step, of pose ``i`` of a block ``q``."""
    return q[0][i], q[1][i], q[2][i]


@inlined
def nominal_step(arm: Arm, q: tuple, i: int, v: tuple) -> tuple[float, ...]:
    """J(q)⁻¹v in rad of pose ``i`` of a block ``q`` for its own step ``v``, a number a task row."""
    return joint_step(arm, segments(arm, at(q, i)), v)


@inlined
def transformed(matrix: np.ndarray, x: tuple) -> tuple[float, ...]:
    """``matrix`` (n·n,), row by row, times ``x``."""
    return (
        matrix[0] * x[0] + matrix[1] * x[1] + matrix[2] * x[2],
        matrix[3] * x[0] + matrix[4] * x[1] + matrix[5] * x[2],
        matrix[6] * x[0] + matrix[7] * x[1] + matrix[8] * x[2],
    )
