"""Compiled laws of the Wishart model (:mod:`.law`) for any arm of n joints and m ≤ n task rows.

With a = J₁⁻¹v a step is J₂⁺B⁻¹a, and as J₂⁺ = J⁺J₁ it is QᵀL⁻¹·J₁B⁻¹J₁⁻¹v with J = LQ: what the
decompositions differ in is what is done to the task's step before and after B⁻¹. The law of B⁻¹
does not change with the order of the rows, so that they stay where they are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arm.numbers import Arm
from pipeline.core.compiled import inlined, passed
from pipeline.models.law import Numbers, Poses, row_by_row
from pipeline.models.serial import (
    add_to_joints,
    factorise,
    factorise_a_copy,
    finish,
    scratch_at,
    solve_lower,
    task_at,
)
from pipeline.models.wishart.action import act, multiply
from pipeline.models.wishart.decomposition import Decomposition


def law_of(decomposition: Decomposition, m: int) -> tuple[Callable, list[float]]:
    """The law of a ``decomposition`` of ``m`` task rows; its parameters after d. The law by QR of
    Jᵀ is for :mod:`.whole_pose_step` to choose.
    """
    match decomposition:
        case Decomposition("pivoted_lu"):
            return pivoted_lu, []
        case Decomposition(left=given):
            left = np.eye(m) if given is None else np.array(given)
            return given_factor, [*row_by_row(left, m), *row_by_row(np.linalg.inv(left), m)]


@inlined
def to_joints(arm: Arm, poses: Poses, room: np.ndarray) -> None:
    """The next poses, of the task's steps J₁B⁻¹a."""
    m, n = len(arm.rows), len(arm.sliding)
    solve_lower(room, task_at(n, m), n, m, poses.count)
    add_to_joints(room, n, m, poses.count)
    finish(arm, poses, room)


@passed
def given_factor(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for a constant J₁; ``parameters`` (1 + 2·m·m,) d and, row by row, J₁ and J₁⁻¹. Both
    are I for the decomposition by QR.
    """
    m, n, room, count = len(arm.rows), len(arm.sliding), numbers.room, poses.count
    task, spare = task_at(n, m), scratch_at(n, m)
    factorise(arm, poses, room)
    multiply(room, parameters[1 + m * m :], task, m, spare, count)
    act(numbers, parameters[0], task, m, spare, count)
    multiply(room, parameters[1 : 1 + m * m], task, m, spare, count)
    to_joints(arm, poses, room)
    return 0


@passed
def qr_transposed(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = L and J₂ = Q of J = LQ, QᵀB⁻¹L⁻¹v; ``parameters`` (1,) d."""
    m, n, room, count = len(arm.rows), len(arm.sliding), numbers.room, poses.count
    task = task_at(n, m)
    factorise(arm, poses, room)
    solve_lower(room, task, n, m, count)
    act(numbers, parameters[0], task, m, scratch_at(n, m), count)
    add_to_joints(room, n, m, count)
    finish(arm, poses, room)
    return 0


@inlined
def _exchange(x: np.ndarray, y: np.ndarray, one: np.ndarray, other: np.ndarray, count: int) -> None:
    """Exchange ``x`` and ``y`` of the poses where ``other`` is greater in size than ``one``."""
    for i in range(count):
        greater = abs(other[i]) > abs(one[i])
        x[i], y[i] = (y[i], x[i]) if greater else (x[i], y[i])


@passed
def pivoted_lu(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = PᵀL of PJ = LU with partial pivoting; ``parameters`` (1,) d.

    Rows are exchanged by selection, not by branches, and where each came from is kept.
    """
    m, n, room, count = len(arm.rows), len(arm.sliding), numbers.room, poses.count
    task, copy = task_at(n, m), scratch_at(n, m)
    origin = copy + m * n
    factorise_a_copy(arm, poses, room)
    for r in range(m):
        for i in range(count):
            room[origin + r, i] = float(r)
    for k in range(m):
        for below in range(k + 1, m):
            one, other = room[copy + k * n + k], room[copy + below * n + k]
            for j in range(n):
                if j != k:
                    _exchange(room[copy + k * n + j], room[copy + below * n + j], one, other, count)
            _exchange(room[task + k], room[task + below], one, other, count)
            _exchange(room[origin + k], room[origin + below], one, other, count)
            _exchange(one, other, one, other, count)
        pivot, x = room[copy + k * n + k], room[task + k]
        for below in range(k + 1, m):
            multiple, y = room[copy + below * n + k], room[task + below]
            for i in range(count):
                multiple[i] /= pivot[i]
                y[i] -= multiple[i] * x[i]
            for j in range(k + 1, n):
                entry, under = room[copy + k * n + j], room[copy + below * n + j]
                for i in range(count):
                    under[i] -= multiple[i] * entry[i]
    act(numbers, parameters[0], task, m, origin + m, count)
    for k in range(m - 1, 0, -1):
        x = room[task + k]
        for s in range(k):
            multiple, above = room[copy + k * n + s], room[task + s]
            for i in range(count):
                x[i] += multiple[i] * above[i]
    # back in the rows that they came from
    for r in range(m):
        for k in range(m):
            source, x, back = room[origin + k], room[task + k], room[origin + m + r]
            for i in range(count):
                before = back[i] if k > 0 else 0.0
                back[i] = x[i] if source[i] == float(r) else before
    for r in range(m):
        x, back = room[task + r], room[origin + m + r]
        for i in range(count):
            x[i] = back[i]
    to_joints(arm, poses, room)
    return 0
