"""Compiled step of every motion model: one draw of q_{k+1} for each pose of a block.

The laws use the task rows and joint rows of a block (:mod:`pipeline.arm.rows`);
:mod:`pipeline.arm.kinematics` fills the rows of J. NumPy draws the variates of a block: first the
χ² variates pose by pose, then the normals pose by pose.

A Wishart step is J₂⁺B⁻¹a = J⁺J₁B⁻¹a, a = J₁⁻¹v: the decompositions differ in the factor of the task
step before and after B⁻¹ (Eqs. LUDecom, Thetaa). B⁻¹a = r·R·[z, z·T]ᵀ
(:mod:`pipeline.models.wishart.law`) takes two χ² variates and m − 1 normals. For three task rows
P(‖T‖² > s) = (1 + s)^{−(d−1)/2}, so ‖T‖² is exp(2E/(d−1)) − 1 for an exponential E. ‖N‖²/2 is
exponential and independent of N's direction:

    T = N·sqrt((exp(‖N‖²/(d−1)) − 1)/‖N‖²),

which saves the second χ² variate, half of the time of a planar step.
"""

import numpy as np

from pipeline.arm import inverse, kinematics
from pipeline.arm.rows import (
    add_combination,
    add_dot,
    add_product,
    copy,
    dot,
    fill,
    rows_of,
)
from pipeline.core.compiled import compiled, inner
from pipeline.core.elementary import expm1
from pipeline.core.errors import ModelDomainError
from pipeline.models import model as laws
from pipeline.randommatrix.variates import draw_variates

INVERSE_LAWS = tuple(laws.WISHART_LAWS.values())
LAWS = (laws.ADDITIVE_LAW, laws.GAUSSIAN_LAW, *INVERSE_LAWS)
DRAWN = 64  # poses whose variates are drawn at a time


@compiled
def move(law, arm, block, command, target, share, q, moved, rng) -> int:
    """Fill ``moved`` (n, P) with draws of the next poses after ``q`` (n, P) in rad under the
    command v + ``share``·(``target`` − x(q)); NaN after a singular pose. Return the number of draws
    with clipped noise.

    ``law`` is a :class:`pipeline.models.model.Law`, ``arm`` are the chain's
    :class:`pipeline.arm.kinematics.ArmConstants`. ``block`` is a buffer with the rows of the
    ``arm``. ``command`` is v (m,), or (m + n,) with a null-space joint step. ``target`` is the pose
    on the closed loop's path, unused if ``share`` κ is 0.
    """
    if law.kind not in LAWS:
        raise ModelDomainError(
            "the compiled step has no law of this kind; use one of model.py",
        )
    n = len(arm.sliding)
    m = len(arm.rows)
    poses = q.shape[1]
    size = block.shape[1]
    rows = rows_of(n, m)
    clipped = 0
    for start in range(0, poses, size):
        count = min(size, poses - start)
        for first in range(0, count, DRAWN):
            last = min(first + DRAWN, count)
            places = (rows.chi_square, rows.normal)
            draw_variates(law.degrees, law.normals, block, *places, first, last, rng)
        for r in range(m):
            fill(block, rows.task + r, command[r], count)
        kinematics.tip(arm, q, start, count, block)
        kinematics.task_jacobian(arm, block, rows.jacobian, count)
        if share > 0.0:
            kinematics.add_displacement(arm, target, block, rows.task, share, count)
        lower = rows.lower
        inverse.cholesky(block, rows.jacobian, lower, rows.inverse, m, n, 0.0, count)
        singular = inverse.mark_singular(
            block,
            arm,
            rows.jacobian,
            lower,
            rows.spare,
            rows.singular,
            count,
        )
        if law.kind == laws.QR_TRANSPOSED_LAW:
            inverse.solve_lower(block, lower, rows.inverse, m, rows.task, count)
        if law.kind == laws.GAUSSIAN_LAW:
            dot(block, rows.speed, rows.task, rows.task, m, count)
        elif law.kind in INVERSE_LAWS:
            # with QR the rows stay, because the law is invariant under rotations of a
            if law.kind == laws.PIVOTED_LU_LAW:
                _eliminate(block, rows, n, m, count)
            act(law.parameters[0], block, rows, m, count)
            if law.kind == laws.PIVOTED_LU_LAW:
                _multiply_back(block, rows, n, m, count)
        _to_joints(law.kind, block, rows, n, m, command, count)
        if singular:
            _invalidate(block, rows, n, count)
        if law.kind == laws.GAUSSIAN_LAW:
            _inverse_square(block, rows, m, count)
        clipped += _add_normal(law, block, rows, n, m, count)
        for j in range(n):
            before = q[j, start : start + count]
            after = moved[j, start : start + count]
            step = rows.joints + j
            for i in range(count):
                after[i] = before[i] + block[step, i]
    return clipped


@inner
def _to_joints(kind, block, rows, n, m, command, count):
    """Write joint steps J⁺x + (I − J⁺J)w for the task step x and the commanded joint step w. With
    QR of Jᵀ the task rows already contain L⁻¹x.
    """
    lower = rows.lower
    reciprocal = rows.inverse
    task = rows.task
    if kind != laws.QR_TRANSPOSED_LAW:
        inverse.solve_lower(block, lower, reciprocal, m, task, count)
    commanded = len(command) > m
    for j in range(n):
        fill(block, rows.joints + j, command[m + j] if commanded else 0.0, count)
    if commanded:
        image = rows.spare
        for r in range(m):
            dot(block, image + r, rows.jacobian + r * n, rows.joints, n, count)
        inverse.solve_lower(block, lower, reciprocal, m, image, count)
        for r in range(m):
            for i in range(count):
                block[task + r, i] -= block[image + r, i]
    inverse.solve_upper(block, lower, reciprocal, m, task, count)
    for j in range(n):
        step = rows.joints + j
        add_dot(block, step, 1.0, rows.jacobian + j, task, m, count, n)


@inner
def _invalidate(block, rows, n, count):
    """Set the joint steps from singular poses to NaN."""
    for j in range(n):
        step = rows.joints + j
        for i in range(count):
            singular = block[rows.singular, i] > 0.0
            block[step, i] = np.nan if singular else block[step, i]


@inner
def _add_normal(law, block, rows, n, m, count):
    """Add the noise of the normal models to the joint steps; the Gaussian model reads ‖J⁺‖² from
    row ``spare``. Return the number of poses with a covariance clipped at zero.
    """
    joints = rows.joints
    normal = rows.normal
    spare = rows.spare
    if law.kind == laws.ADDITIVE_LAW:
        for j in range(n):
            add_combination(block, joints + j, law.parameters, j * n, normal, n, count)
        return 0
    if law.kind != laws.GAUSSIAN_LAW:
        return 0
    clipped = 0
    alpha = law.parameters[0]
    u = law.parameters[1]
    for i in range(count):
        norm = np.sqrt(block[spare, i])
        clipped += norm > u
        bounded = norm if norm < u else u
        scale = alpha * alpha * (u * u - bounded * bounded) / (n * m)
        block[spare, i] = np.sqrt(scale * block[rows.speed, i])
    for j in range(n):
        add_product(block, joints + j, 1.0, spare, normal + j, count)
    return clipped


@inner
def _inverse_square(block, rows, m, count):
    """Write row ``spare`` = ‖J⁺‖_F² = ‖L⁻¹‖_F², column by column."""
    column = rows.spare + 1
    fill(block, rows.spare, 0.0, count)
    for r in range(m):
        for s in range(m):
            fill(block, column + s, 1.0 if s == r else 0.0, count)
        inverse.solve_lower(block, rows.lower, rows.inverse, m, column, count)
        add_dot(block, rows.spare, 1.0, column, column, m, count)


@inner
def act(d, block, rows, m, count):
    """Replace the task rows a by B⁻¹a = z(a + rR[0, T]ᵀ), zero for a = 0. R is, up to its sign, the
    Householder reflection of the first axis to a/r.
    """
    first = rows.task
    normal = rows.normal
    chi_square = rows.chi_square
    stretch = rows.spare
    r = stretch + 1
    along = stretch + 2
    if m == 3:
        share = 1.0 / (d - 1.0)
        second = normal + 1
        for i in range(count):
            x = block[normal, i]
            y = block[second, i]
            square = x * x + y * y
            block[stretch, i] = np.sqrt(expm1(square * share) / square)
    elif m > 1:
        for i in range(count):
            block[stretch, i] = 1.0 / np.sqrt(block[chi_square + 1, i])
    else:
        fill(block, stretch, 0.0, count)
    dot(block, r, first, first, m, count)
    dot(block, along, first + 1, normal, m - 1, count)
    for i in range(count):
        a = block[first, i]
        t = block[stretch, i]
        length = np.sqrt(block[r, i])
        z = d / block[chi_square, i]
        reach = length + abs(a)
        share = block[along, i] * t / (reach if reach > 0.0 else 1.0)
        block[first, i] = z * (a - share * (a + np.copysign(length, a)))
        block[along, i] = z * (1.0 - share)
        block[r, i] = z * length * t
    for k in range(1, m):
        a = first + k
        n = normal + k - 1
        for i in range(count):
            block[a, i] = block[along, i] * block[a, i] + block[r, i] * block[n, i]


@inner
def _multiply_back(block, rows, n, m, count):
    """Replace task rows by PᵀL times them, with the scratch rows of :func:`_eliminate`."""
    task = rows.task
    lower = rows.spare + 4
    for k in range(m - 1, 0, -1):
        add_dot(block, task + k, 1.0, lower + k * n, task, k, count)
    flag = lower + m * n + m * (m - 1) // 2
    for k in range(m - 1, -1, -1):
        for below in range(m - 1, k, -1):
            flag -= 1
            _exchange(block, task + k, task + below, flag, count)


@inner
def _exchange(block, x, y, flag, count):
    """Exchange rows ``x`` and ``y`` at poses where row ``flag`` is not zero."""
    for i in range(count):
        above = block[x, i]
        below = block[y, i]
        exchanged = block[flag, i] != 0.0
        block[x, i] = below if exchanged else above
        block[y, i] = above if exchanged else below


@inner
def _eliminate(block, rows, n, m, count):
    """Replace task rows v by L⁻¹Pv of PJ = LU with partial pivoting. Scratch rows contain the
    multipliers, below the diagonal of a copy of J, then one flag for each exchange.
    """
    task = rows.task
    lower = rows.spare + 4
    flag = lower + m * n
    for k in range(m * n):
        copy(block, lower + k, rows.jacobian + k, count)
    for k in range(m):
        pivot = lower + k * n + k
        for below in range(k + 1, m):
            candidate = lower + below * n + k
            for i in range(count):
                greater = abs(block[candidate, i]) > abs(block[pivot, i])
                block[flag, i] = 1.0 if greater else 0.0
            for j in range(n):
                _exchange(block, lower + k * n + j, lower + below * n + j, flag, count)
            _exchange(block, task + k, task + below, flag, count)
            flag += 1
        for below in range(k + 1, m):
            multiple = lower + below * n + k
            for i in range(count):
                block[multiple, i] /= block[pivot, i]
            add_product(block, task + below, -1.0, multiple, task + k, count)
            for j in range(k + 1, m):
                under = lower + below * n + j
                above = lower + k * n + j
                add_product(block, under, -1.0, multiple, above, count)
