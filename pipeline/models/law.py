"""What a compiled law of one step is: the function that moves a block of poses.

A law ``step(numbers, parameters, arm, poses) -> clipped`` makes q_{k+1} of a block of ``poses`` of
their random ``numbers``. ``parameters`` (K,) are the model's, ``arm`` the chain's; ``clipped`` is
for how many of the poses the noise was clipped at zero. Which numbers a step takes is said by
:class:`pipeline.models.model.Law`. An arm whose joints form a planar chain of three has laws of its
own, in closed form: by those of any arm its steps take several times as long.

That the numbers of a block are there before the law begins has two reasons: a loop without a call
to the generator is one that the compiler turns into instructions for four poses at once, and how
numbers are drawn is compiled once and not in every law. The poses come last in every array for the
first reason too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float64, int64, types

from pipeline.arm.compiled import ARM, Plane, joint_step, turned
from pipeline.core.compiled import MATRIX, VECTOR, inlined
from pipeline.core.errors import ModelDomainError


class Numbers(NamedTuple):
    """Standard random numbers of a block of at most N poses, and room for what else it takes."""

    # of each χ² variate of a step the law of its half (pipeline.randommatrix.variates)
    gamma: np.ndarray  # (G, 3)
    each: int  # normals of a pose in a set
    chi_square: np.ndarray  # (G, N)
    normal: np.ndarray  # (sets·each, N)
    command: np.ndarray  # (m or m + n, N) the commanded step of each pose
    room: np.ndarray  # (R, N) scratch of the arm's kinematics


class Poses(NamedTuple):
    """A block: ``count`` poses from number ``start`` on."""

    # (m, N) the commanded step of each pose of the block; (m + n, N) of an arm with more joints
    # than task rows (:class:`pipeline.models.commands.Commands`)
    command: np.ndarray
    q: np.ndarray  # (n, P) all poses, rad
    moved: np.ndarray  # (n, P), to be filled
    start: int
    count: int


NUMBERS = types.NamedTuple((MATRIX, int64, MATRIX, MATRIX, MATRIX, MATRIX), Numbers)
CUBE = types.Array(float64, 3, "C")
POSES = types.NamedTuple((MATRIX, MATRIX, MATRIX, int64, int64), Poses)
ROWS = 14  # of the room that a law of a planar chain needs
STEP = types.FunctionType(int64(NUMBERS, VECTOR, ARM, POSES))
# (arm, target, share, poses, room): adds share·(target − x(q)) to the commands
CORRECTION = types.FunctionType(types.void(ARM, VECTOR, float64, POSES, MATRIX))


def row_by_row(matrix: np.ndarray, size: int) -> np.ndarray:
    """(size·size,) ``matrix`` (size, size) as the parameters of a law hold it.

    Raises ModelDomainError for a matrix of another size than the arm's joints or task rows.
    """
    if matrix.shape != (size, size):
        raise ModelDomainError(
            f"the model's matrix is not one of the {size} joints or task rows of this arm; run "
            "the stage fit for it",
            shape=matrix.shape,
        )
    return matrix.ravel()


@inlined
def planar(poses: Poses) -> tuple[tuple[np.ndarray, ...], ...]:
    """The commands, the poses and room for the next ones of a block of three joints and task rows,
    an array for each of these.
    """
    start, count = poses.start, poses.count
    v, q, moved, stop = poses.command, poses.q, poses.moved, start + count
    return (
        (v[0, :count], v[1, :count], v[2, :count]),
        (q[0, start:stop], q[1, start:stop], q[2, start:stop]),
        (moved[0, start:stop], moved[1, start:stop], moved[2, start:stop]),
    )


@inlined
def at(q: tuple, i: int) -> tuple[float, ...]:
    """The joint angles, or the commanded step, of pose ``i`` of a block ``q``."""
    return q[0][i], q[1][i], q[2][i]


@inlined
def jacobians(plane: Plane, q: tuple, room: np.ndarray) -> tuple:
    """The entries of J, row by row an array for each joint, of the poses of a block ``q``, but for
    the signs of the joints; they fill ``room`` from its start on. A loop a joint, from the last on:
    in one for all of them the processor has too few registers.
    """
    x, z, phi = (room[0], room[1], room[2]), (room[3], room[4], room[5]), room[6]
    s1, s2, s3 = plane.signs
    for i in range(len(q[0])):
        tx, tz = turned(plane.links[2], s1 * q[0][i] + s2 * q[1][i] + s3 * q[2][i])
        x[2][i], z[2][i], phi[i] = tz, -tx, 1.0
    for i in range(len(q[0])):
        bx, bz = turned(plane.links[1], s1 * q[0][i] + s2 * q[1][i])
        x[1][i], z[1][i] = x[2][i] + bz, z[2][i] - bx
    for i in range(len(q[0])):
        ax, az = turned(plane.links[0], s1 * q[0][i])
        x[0][i], z[0][i] = x[1][i] + az, z[1][i] - ax
    return x, z, (phi, phi, phi)


@inlined
def nominal_step(plane: Plane, jacobian: tuple, i: int, v: tuple) -> tuple[float, ...]:
    """J⁻¹v in rad of pose ``i`` of a block, of its :func:`jacobians`, for its own step ``v``, a
    number a task row.
    """
    return joint_step(plane, at(jacobian[0], i), at(jacobian[1], i), v)


@inlined
def transformed(matrix: np.ndarray, x: tuple) -> tuple[float, ...]:
    """``matrix`` (n·n,), row by row, times ``x``."""
    return (
        matrix[0] * x[0] + matrix[1] * x[1] + matrix[2] * x[2],
        matrix[3] * x[0] + matrix[4] * x[1] + matrix[5] * x[2],
        matrix[6] * x[0] + matrix[7] * x[1] + matrix[8] * x[2],
    )
