"""What the compiled laws of any arm share: J = LQ at each pose of a block, steps through
J⁺ = QᵀL⁻¹, and what the commanded joint step adds in the null space of J.

Rows of a room after those of :mod:`pipeline.arm.serial_compiled`; every function fills or changes
the rows that its name and docstring say.
"""

from __future__ import annotations

import numpy as np
from numba import int64

from pipeline.arm.lq import orthonormalise, too_singular
from pipeline.arm.numbers import Arm
from pipeline.arm.serial_compiled import jacobian_at, lower_at, spare_at, task_jacobian, tip
from pipeline.core.compiled import compiled, inlined, inner
from pipeline.models.law import Poses


@inlined
def task_at(n: int, m: int) -> int:
    """The first of m rows: a step of the task, as it is made ready for the joints."""
    return spare_at(n, m) + m * m


@inlined
def joints_at(n: int, m: int) -> int:
    """The first of n rows: the joints' step."""
    return task_at(n, m) + m


@inlined
def felt_at(n: int, m: int) -> int:
    """The first of m rows: Qw, what the task feels of the commanded joint step; the row before them
    says whether a pose is singular.
    """
    return joints_at(n, m) + n + 1


@inlined
def scratch_at(n: int, m: int) -> int:
    """The first of m·n + 3m + 2 rows that the functions use on their way."""
    return felt_at(n, m) + m


@compiled(int64(int64, int64))
def rows_of_room(n: int, m: int) -> int:
    """How many rows a room has for n joints and m task rows."""
    return scratch_at(n, m) + m * n + 3 * m + 2


@inner
def factorise(arm: Arm, poses: Poses, room: np.ndarray) -> None:
    """J = LQ of every pose, and whether J is singular; v at :func:`task_at`, the commanded joint
    step w at :func:`joints_at`, zero where none is commanded, and Qw at :func:`felt_at`.
    """
    tip(arm, poses.q, poses.start, poses.count, room)
    task_jacobian(arm, room, poses.count)
    decompose(arm, poses, room)


@inner
def factorise_a_copy(arm: Arm, poses: Poses, room: np.ndarray) -> None:
    """The same, and J itself at :func:`scratch_at`."""
    m, n = len(arm.rows), len(arm.sliding)
    tip(arm, poses.q, poses.start, poses.count, room)
    task_jacobian(arm, room, poses.count)
    for k in range(m * n):
        copy, entry = room[scratch_at(n, m) + k], room[jacobian_at(n) + k]
        for i in range(poses.count):
            copy[i] = entry[i]
    decompose(arm, poses, room)


@inner
def decompose(arm: Arm, poses: Poses, room: np.ndarray) -> None:
    """What :func:`factorise` does of J at :func:`jacobian_at`, whose place Q takes."""
    m, n, count = len(arm.rows), len(arm.sliding), poses.count
    first, lower, joints = jacobian_at(n), lower_at(n, m), joints_at(n, m)
    orthonormalise(room, first, lower, spare_at(n, m), m, n, count)
    too_singular(room, lower, spare_at(n, m), m, arm.least, joints + n, count)
    commanded = len(poses.command) > m
    for j in range(n):
        row, w = room[joints + j], poses.command[m + j if commanded else 0]
        for i in range(count):
            row[i] = w[i] if commanded else 0.0
    for r in range(m):
        row, v, felt = room[task_at(n, m) + r], poses.command[r], room[felt_at(n, m) + r]
        for i in range(count):
            row[i] = v[i]
            felt[i] = 0.0
        for j in range(n if commanded else 0):
            q, w = room[first + r * n + j], room[joints + j]
            for i in range(count):
                felt[i] += q[i] * w[i]


@inner
def solve_lower(room: np.ndarray, first: int, n: int, m: int, count: int) -> None:
    """Make of x, m rows of ``room`` from ``first`` on, L⁻¹x."""
    lower = lower_at(n, m)
    for r in range(m):
        row, diagonal = room[first + r], room[lower + r * m + r]
        for s in range(r):
            entry, before = room[lower + r * m + s], room[first + s]
            for i in range(count):
                row[i] -= entry[i] * before[i]
        for i in range(count):
            row[i] /= diagonal[i]


@inner
def add_to_joints(room: np.ndarray, n: int, m: int, count: int) -> None:
    """Add to the commanded joint step w, which becomes the joints' step, Qᵀ(x − Qw) of the task's
    x, which :func:`solve_lower` has made L⁻¹x: what the task feels of w is taken back.
    """
    first, task, joints = jacobian_at(n), task_at(n, m), joints_at(n, m)
    for r in range(m):
        x, felt = room[task + r], room[felt_at(n, m) + r]
        for i in range(count):
            x[i] -= felt[i]
        for j in range(n):
            q, dq = room[first + r * n + j], room[joints + j]
            for i in range(count):
                dq[i] += q[i] * x[i]


@inner
def nominal_steps(arm: Arm, poses: Poses, room: np.ndarray) -> None:
    """The joints' steps J⁺v + (I − J⁺J)w, at :func:`joints_at`."""
    m, n = len(arm.rows), len(arm.sliding)
    factorise(arm, poses, room)
    solve_lower(room, task_at(n, m), n, m, poses.count)
    add_to_joints(room, n, m, poses.count)


@inner
def finish(arm: Arm, poses: Poses, room: np.ndarray) -> None:
    """The next poses by the joints' steps; NaN where a pose is singular, from which there is no
    step.
    """
    m, n, count, start = len(arm.rows), len(arm.sliding), poses.count, poses.start
    joints = joints_at(n, m)
    singular = room[joints + n]
    for j in range(n):
        dq, stop = room[joints + j], start + count
        here, there = poses.q[j, start:stop], poses.moved[j, start:stop]
        for i in range(count):
            there[i] = np.nan if singular[i] > 0.0 else here[i] + dq[i]
