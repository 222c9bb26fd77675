"""Kinematics of a serial chain for whole batches: the compiled ways in from Python."""

from __future__ import annotations

import numpy as np
from numba import int64, void

from pipeline.arm.compiled import ARM
from pipeline.arm.lq import invert, orthonormalise, too_singular
from pipeline.arm.numbers import INVERSE, POSE, SINGULAR, Arm
from pipeline.arm.serial_compiled import (
    JOINTS,
    POSITION,
    SINE,
    WIDTH,
    displacement_rows,
    jacobian_at,
    lower_at,
    spare_at,
    task_jacobian,
    tip,
)
from pipeline.core.compiled import MATRIX, compiled


@compiled(void(ARM, MATRIX, int64, MATRIX))
def kinematics(arm: Arm, q: np.ndarray, part: int, out: np.ndarray) -> None:
    """Fill ``out`` (rows, P) for the poses ``q`` (n, P) in rad, m of prismatic joints.

    Its rows are the tip's pose (12) for POSE, the Jacobian (m·n, row by row) for JACOBIAN, the
    transpose of J⁺ (m·n, likewise) for INVERSE; for SINGULAR the one is 1 where the least singular
    value is below the arm's.
    """
    n, m = len(arm.sliding), len(arm.rows)
    jacobian, lower, spare = jacobian_at(n), lower_at(n, m), spare_at(n, m)
    room = np.empty((spare + m * m, WIDTH))
    for start in range(0, q.shape[1], WIDTH):
        count, first = min(WIDTH, q.shape[1] - start), POSITION
        tip(arm, q, start, count, room)
        if part != POSE:
            first = jacobian
            task_jacobian(arm, room, count)
        if part == SINGULAR or part == INVERSE:
            orthonormalise(room, jacobian, lower, spare, m, n, count)
        if part == SINGULAR:
            first = SINE  # which the Jacobian no longer needs
            too_singular(room, lower, spare, m, arm.least, first, count)
        if part == INVERSE:
            invert(room, jacobian, lower, m, n, count)
        for k in range(len(out)):
            for i in range(count):
                out[k, start + i] = room[first + k, i]


@compiled(void(ARM, MATRIX, MATRIX, MATRIX))
def displacements(arm: Arm, start: np.ndarray, end: np.ndarray, out: np.ndarray) -> None:
    """Add to ``out`` (P, m) the task's rows of the displacements from the poses ``start`` (P,
    12) to ``end`` (P, 12).
    """
    room = np.empty((JOINTS, WIDTH))
    for p in range(len(start)):
        for k in range(12):
            room[k, 0] = start[p, k]
        displacement_rows(arm, end[p], room, 1, out[p].reshape(-1, 1), 1.0)
