"""The compiled step of every motion model: one draw of q_{k+1} for each pose of a block.

A law is written once over the task rows and the joints of a block (:mod:`pipeline.arm.rows`); the
kinematics, planar or serial, fills the rows of J. The variates of a block are NumPy's own: χ² of
all poses, one after the other, then normals set by set, those of one pose in a row.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.kinematics import (
    add_displacement,
    cholesky,
    mark_singular,
    solve_lower,
    solve_upper,
    task_jacobian,
    tip,
)
from pipeline.arm.numbers import Arm
from pipeline.arm.planar import (
    add_planar_displacement,
    planar_inverse_square,
    planar_jacobian,
    planar_steps,
)
from pipeline.arm.rows import (
    Rows,
    add_combination,
    add_dot,
    add_product,
    copy,
    dot,
    fill,
    rows_of,
)
from pipeline.core.compiled import inner
from pipeline.models.model import GAUSSIAN_LAW, QR_TRANSPOSED_LAW, SCALED_LAW, WISHART, Law
from pipeline.models.wishart.step import act, from_action, to_action
from pipeline.randommatrix.variates import draw_variates


@inner
def move_block(
    law: Law,
    arm: Arm,
    block: np.ndarray,
    command: np.ndarray,
    target: np.ndarray,
    share: float,
    q: np.ndarray,
    moved: np.ndarray,
    start: int,
    count: int,
    rng: np.random.Generator,
) -> int:
    """Fill ``count`` columns of ``moved`` from ``start`` on with draws of the next poses under the
    command v + ``share``·(``target`` − x(q)); return for how many the noise was clipped.

    A pose is NaN after a step from a singular one, where no model is defined.

    Args:
        law: kind of the law, its parameters and variates.
        arm: constants of the chain.
        block: buffer of at least ``count`` poses, with the rows of the arm.
        command: (m,) v, or (m + n,) with the step of the joints commanded in the null space.
        target: pose that the closed loop holds the arm to; not read where ``share`` is 0.
        share: κ, of the deviation that the step corrects; 0 of an open loop.
        q: (n, P) poses in rad, and ``moved`` (n, P) the next ones.
        start: first pose of the block.
        count: poses of the block.
        rng: of the variates.
    """
    n, m, planar = len(arm.sliding), len(arm.rows), len(arm.plane) > 0
    rows = rows_of(n, m)
    draw_variates(law.degrees, law.sets, law.each, block, rows.chi_square, rows.normal, count, rng)
    for r in range(m):
        fill(block, rows.task + r, command[r], count)
    if planar:
        planar_jacobian(arm, q, start, count, block)
        if share > 0.0:
            add_planar_displacement(arm, target, q, start, count, share, block)
    else:
        tip(arm, q, start, count, block)
        if share > 0.0:
            add_displacement(arm, target, block, rows.task, share, count)
        task_jacobian(arm, block, rows.jacobian, count)
        cholesky(block, rows.jacobian, rows.lower, rows.inverse, m, n, 0.0, count)
        mark_singular(block, arm, rows.jacobian, rows.lower, rows.spare, rows.singular, count)
    if law.kind == GAUSSIAN_LAW:
        dot(block, rows.speed, rows.task, 1, rows.task, 1, m, count)
    if law.kind >= WISHART:
        if law.kind == QR_TRANSPOSED_LAW:
            if planar:
                planar_steps(arm, block, count)
                for r in range(m):
                    copy(block, rows.task + r, rows.joints + r, count)
            else:
                solve_lower(block, rows.lower, rows.inverse, m, rows.task, 1, count)
        to_action(law, block, rows, n, m, count)
        act(law.parameters[0], block, rows, m, count)
        from_action(law, block, rows, n, m, count)
    if planar and law.kind == QR_TRANSPOSED_LAW:
        for j in range(n):
            copy(block, rows.joints + j, rows.task + j, count)
    elif planar:
        planar_steps(arm, block, count)
    else:
        _to_joints(law.kind, block, rows, n, m, command, count)
    clipped = _add_normal(law, block, rows, n, m, planar, count)
    for j in range(n):
        here, there = q[j, start : start + count], moved[j, start : start + count]
        step = rows.joints + j
        if planar:
            for i in range(count):
                there[i] = here[i] + block[step, i]
        else:
            for i in range(count):
                singular = block[rows.singular, i] > 0.0
                there[i] = np.nan if singular else here[i] + block[step, i]
    return clipped


@inner
def _to_joints(
    kind: int, block: np.ndarray, rows: Rows, n: int, m: int, command: np.ndarray, count: int
) -> None:
    """Joints' steps of a serial chain: J⁺x + (I − J⁺J)w of the task step x, which is L⁻¹x already
    by QR of Jᵀ, and of the commanded joint step w.
    """
    lower, inverse, task = rows.lower, rows.inverse, rows.task
    if kind != QR_TRANSPOSED_LAW:
        solve_lower(block, lower, inverse, m, task, 1, count)
    commanded = len(command) > m
    for j in range(n):
        fill(block, rows.joints + j, command[m + j] if commanded else 0.0, count)
    if commanded:
        felt = rows.spare
        for r in range(m):
            dot(block, felt + r, rows.jacobian + r * n, 1, rows.joints, 1, n, count)
        solve_lower(block, lower, inverse, m, felt, 1, count)
        for r in range(m):
            for i in range(count):
                block[task + r, i] -= block[felt + r, i]
    solve_upper(block, lower, inverse, m, task, 1, count)
    for j in range(n):
        add_dot(block, rows.joints + j, 1.0, rows.jacobian + j, n, task, 1, m, count)


@inner
def _add_normal(
    law: Law, block: np.ndarray, rows: Rows, n: int, m: int, planar: bool, count: int
) -> int:
    """Add the noise of the normal models to the joints' steps; return for how many the Gaussian
    model's covariance was clipped at zero.
    """
    joints, normal, spare = rows.joints, rows.normal, rows.spare
    if law.kind == SCALED_LAW:
        # η + D(q̇)ε; the additive model has no ε
        for j in range(n):
            if law.sets > 1:
                fill(block, spare, 0.0, count)
                add_combination(block, spare, law.parameters, n * n + j * n, normal + n, n, count)
                add_product(block, joints + j, joints + j, spare, count)
            add_combination(block, joints + j, law.parameters, j * n, normal, n, count)
        return 0
    if law.kind != GAUSSIAN_LAW:
        return 0
    clipped, alpha, u = 0, law.parameters[0], law.parameters[1]
    if planar:
        planar_inverse_square(block, count)
    else:
        _inverse_square(block, rows, m, count)
    for i in range(count):
        norm = np.sqrt(block[spare, i])
        clipped += norm > u
        bounded = norm if norm < u else u
        scale = alpha * alpha * (u * u - bounded * bounded) / (n * m)
        block[spare, i] = np.sqrt(scale * block[rows.speed, i])
    for j in range(n):
        add_product(block, joints + j, spare, normal + j, count)
    return clipped


@inner
def _inverse_square(block: np.ndarray, rows: Rows, m: int, count: int) -> None:
    """Row ``spare`` = ‖J⁺‖_F² = ‖L⁻¹‖_F² of a serial chain, one column after the other."""
    column = rows.spare + 1
    fill(block, rows.spare, 0.0, count)
    for r in range(m):
        for s in range(m):
            fill(block, column + s, 1.0 if s == r else 0.0, count)
        solve_lower(block, rows.lower, rows.inverse, m, column, 1, count)
        add_dot(block, rows.spare, 1.0, column, 1, column, 1, m, count)
