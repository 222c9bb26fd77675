"""Kinematics of a serial chain for whole batches: the compiled functions that Python calls."""

from __future__ import annotations

import numpy as np

from pipeline.arm.kinematics import (
    WIDTH,
    add_displacement,
    cholesky,
    mark_singular,
    solve_lower,
    solve_upper,
    task_jacobian,
    tip,
)
from pipeline.arm.numbers import INVERSE, POSE, SINGULAR, Arm
from pipeline.arm.rows import POSITION, copy, rows_of
from pipeline.core.compiled import compiled


@compiled
def kinematics(arm: Arm, q: np.ndarray, part: int, out: np.ndarray) -> None:
    """Fill ``out`` (rows, P) for the poses ``q`` (n, P) in rad, m of prismatic joints.

    Its rows are the tip's pose (12) for POSE, the Jacobian (m·n, row by row) for JACOBIAN, the
    transpose of J⁺ (m·n, likewise) for INVERSE; for SINGULAR the one is 1 where the least singular
    value is below the arm's.
    """
    n, m = len(arm.sliding), len(arm.rows)
    rows = rows_of(n, m)
    block = np.empty((rows.size, WIDTH))
    for start in range(0, q.shape[1], WIDTH):
        count = min(WIDTH, q.shape[1] - start)
        tip(arm, q, start, count, block)
        first = POSITION if part == POSE else rows.jacobian
        if part != POSE:
            task_jacobian(arm, block, rows.jacobian, count)
        if part == SINGULAR or part == INVERSE:
            cholesky(block, rows.jacobian, rows.lower, rows.inverse, m, n, 0.0, count)
        if part == SINGULAR:
            first = rows.singular
            mark_singular(block, arm, rows.jacobian, rows.lower, rows.spare, first, count)
        if part == INVERSE:
            for j in range(n):
                for r in range(m):
                    copy(block, rows.task + r, first + r * n + j, count)
                solve_lower(block, rows.lower, rows.inverse, m, rows.task, count)
                solve_upper(block, rows.lower, rows.inverse, m, rows.task, count)
                for r in range(m):
                    copy(block, first + r * n + j, rows.task + r, count)
        for k in range(len(out)):
            for i in range(count):
                out[k, start + i] = block[first + k, i]


@compiled
def displacements(arm: Arm, start: np.ndarray, end: np.ndarray, out: np.ndarray) -> None:
    """Fill ``out`` (P, m) with the task's rows of the displacements from the poses ``start`` (P,
    12) to ``end`` (P, 12).
    """
    m = len(arm.rows)
    block = np.empty((rows_of(len(arm.sliding), m).size, WIDTH))
    first = rows_of(len(arm.sliding), m).task
    for p in range(len(start)):
        for k in range(12):
            block[k, 0] = start[p, k]
        for r in range(m):
            block[first + r, 0] = 0.0
        add_displacement(arm, end[p], block, first, 1.0, 1)
        for r in range(m):
            out[p, r] = block[first + r, 0]
