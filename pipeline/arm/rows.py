"""Rows of a block in compiled code: a C matrix (rows, poses), so that neighbours in memory are the
same quantity of neighbouring poses, over which LLVM vectorises loops without branches or calls.
"""

from typing import NamedTuple

import numpy as np

from pipeline.core.compiled import inner

WIDTH = 256  # poses of a block: fewer cost calls, more leave the processor's nearest cache
# rows of the kinematics of one pose: position (3, m) and rotation (9, row by row) of the tip, sine
# and cosine of the turn of one frame, or the rotation vector (3) of a displacement, and from JOINTS
# on axis (3) and a point of it (3, m) of each joint
POSITION, ROTATION, SINE, COSINE, TURN, JOINTS = 0, 3, 12, 13, 12, 15


class Rows(NamedTuple):
    """First rows of the quantities of n joints and m task rows, and the number of all rows."""

    jacobian: int  # (m·n) J, row by row
    lower: int  # (m·m) L of JJᵀ = LLᵀ, row by row
    inverse: int  # (m) 1/L_rr
    task: int  # (m) step of the task, on its way to the joints
    joints: int  # (n) step of the joints
    singular: int  # 1 at a singular pose, else 0
    speed: int  # ‖v‖²
    normal: int  # (2n or more) normal variates
    chi_square: int  # (2) χ² variates
    spare: int  # (m·n + m·m + 2m + 4) scratch
    size: int


def block_rows(n: int, m: int) -> Rows:
    """The rows of a block for ``n`` joints and ``m`` task rows."""
    jacobian = JOINTS + 6 * n
    lower = jacobian + m * n
    inverse = lower + m * m
    task = inverse + m
    joints = task + m
    normal = joints + n + 2
    chi_square = normal + 2 * n + m
    spare = chi_square + 2
    singular, speed = joints + n, joints + n + 1
    places = jacobian, lower, inverse, task, joints, singular, speed, normal, chi_square, spare
    return Rows(*places, spare + m * n + m * m + 2 * m + 4)


rows_of = inner(block_rows)


@inner
def fill(block: np.ndarray, out: int, value: float, count: int) -> None:
    """Row ``out`` = ``value``."""
    for i in range(count):
        block[out, i] = value


@inner
def copy(block: np.ndarray, out: int, x: int, count: int) -> None:
    """Row ``out`` = row ``x``."""
    for i in range(count):
        block[out, i] = block[x, i]


@inner
def scale(block: np.ndarray, out: int, x: int, count: int) -> None:
    """Row ``out`` times row ``x``."""
    for i in range(count):
        block[out, i] *= block[x, i]


@inner
def add_product(block: np.ndarray, out: int, sign: float, x: int, y: int, count: int) -> None:
    """Row ``out`` + ``sign``·row ``x``·row ``y``."""
    for i in range(count):
        block[out, i] += sign * (block[x, i] * block[y, i])


@inner
def add_dot(
    block: np.ndarray, out: int, sign: float, x: int, y: int, n: int, count: int, by: int = 1
) -> None:
    """Row ``out`` + ``sign``·Σ_j row (``x`` + ``by``·j)·row (``y`` + j), three at a time."""
    for j in range(0, n - 2, 3):
        x0, y0 = x + by * j, y + j
        x1, x2, y1, y2 = x0 + by, x0 + 2 * by, y0 + 1, y0 + 2
        for i in range(count):
            block[out, i] += sign * (
                block[x0, i] * block[y0, i]
                + block[x1, i] * block[y1, i]
                + block[x2, i] * block[y2, i]
            )
    for j in range(n - n % 3, n):
        add_product(block, out, sign, x + by * j, y + j, count)


@inner
def dot(block: np.ndarray, out: int, x: int, y: int, n: int, count: int) -> None:
    """Row ``out`` = Σ_j row (``x`` + j)·row (``y`` + j) over ``n`` rows."""
    fill(block, out, 0.0, count)
    add_dot(block, out, 1.0, x, y, n, count)


@inner
def add_combination(
    block: np.ndarray, out: int, factors: np.ndarray, at: int, x: int, n: int, count: int
) -> None:
    """Row ``out`` + Σ_j ``factors``[``at`` + j]·row (``x`` + j) over ``n`` rows."""
    for j in range(n):
        factor, row = factors[at + j], x + j
        for i in range(count):
            block[out, i] += factor * block[row, i]
