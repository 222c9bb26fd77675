"""The Wishart model's part of a compiled step: B⁻¹a, and J₁ of every decomposition.

With a = J₁⁻¹v a step is J₂⁺B⁻¹a = J⁺J₁B⁻¹a: the decompositions differ in what they do to the task's
step before and after B⁻¹ (Eqs. LUDecom, Thetaa). B⁻¹a = r·R·[z, z·T]ᵀ, r = ‖a‖
(:mod:`.law`), takes two χ² variates and m − 1 normals: T = N/sqrt(χ²(d−m+2)). For three task rows
‖T‖ has a closed form, P(‖T‖² > s) = (1 + s)^{−(d−1)/2}, so that ‖T‖² is exp(2E/(d−1)) − 1 for an
exponential E. ‖N‖²/2 is one, and independent of N's direction:

    T = N·sqrt((exp(‖N‖²/(d−1)) − 1)/‖N‖²),

which saves the second χ² variate, half of what a planar step would cost.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.rows import Rows, add_combination, add_dot, add_product, copy, dot, fill
from pipeline.core.compiled import inner
from pipeline.core.elementary import expm1
from pipeline.models.model import GIVEN_LAW, PIVOTED_LU_LAW, Law


@inner
def act(d: float, block: np.ndarray, rows: Rows, m: int, count: int) -> None:
    """a = B⁻¹a = z(a + rR[0, T]ᵀ) of the task rows a, zero where a is.

    R is the Householder reflection of the first axis to a/r, up to its sign.
    """
    first, normal, chi_square = rows.task, rows.normal, rows.chi_square
    stretch, r, along = rows.spare, rows.spare + 1, rows.spare + 2
    if m == 3:
        share, other = 1.0 / (d - 1.0), normal + 1
        for i in range(count):
            x, y = block[normal, i], block[other, i]
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
        a, length, z = block[first, i], np.sqrt(block[r, i]), d / block[chi_square, i]
        reach, t = length + abs(a), block[stretch, i]
        share = block[along, i] * t / (reach if reach > 0.0 else 1.0)
        block[first, i] = z * (a - share * (a + np.copysign(length, a)))
        block[along, i] = z * (1.0 - share)
        block[r, i] = z * length * t
    for k in range(1, m):
        a, n = first + k, normal + k - 1
        for i in range(count):
            block[a, i] = block[along, i] * block[a, i] + block[r, i] * block[n, i]


@inner
def to_action(law: Law, block: np.ndarray, rows: Rows, n: int, m: int, count: int) -> None:
    """Task rows v = J₁⁻¹v; by QR of J the law is that of J₁ = I, as it does not change with
    rotations of a.
    """
    if law.kind == PIVOTED_LU_LAW:
        _eliminate(block, rows, n, m, count)
    elif law.kind == GIVEN_LAW:
        _multiply(law.parameters, 1 + m * m, block, rows, m, count)


@inner
def from_action(law: Law, block: np.ndarray, rows: Rows, n: int, m: int, count: int) -> None:
    """Task rows x = J₁x."""
    if law.kind == GIVEN_LAW:
        _multiply(law.parameters, 1, block, rows, m, count)
    elif law.kind == PIVOTED_LU_LAW:
        task, lower = rows.task, rows.spare + 4
        for k in range(m - 1, 0, -1):
            add_dot(block, task + k, 1.0, lower + k * n, task, k, count)
        flag = lower + m * n + m * (m - 1) // 2
        for k in range(m - 1, -1, -1):
            for below in range(m - 1, k, -1):
                flag -= 1
                _exchange(block, task + k, task + below, flag, count)


@inner
def _multiply(
    matrix: np.ndarray, at: int, block: np.ndarray, rows: Rows, m: int, count: int
) -> None:
    """Task rows x = Mx, M (m, m) in ``matrix`` from ``at`` on, row by row."""
    for r in range(m):
        fill(block, rows.spare + r, 0.0, count)
        add_combination(block, rows.spare + r, matrix, at + r * m, rows.task, m, count)
    for r in range(m):
        copy(block, rows.task + r, rows.spare + r, count)


@inner
def _exchange(block: np.ndarray, x: int, y: int, flag: int, count: int) -> None:
    """Exchange rows ``x`` and ``y`` where row ``flag`` is not zero."""
    for i in range(count):
        one, two = block[x, i], block[y, i]
        exchanged = block[flag, i] != 0.0
        block[x, i] = two if exchanged else one
        block[y, i] = one if exchanged else two


@inner
def _eliminate(block: np.ndarray, rows: Rows, n: int, m: int, count: int) -> None:
    """Task rows v = L⁻¹Pv of PJ = LU with partial pivoting; multipliers below the diagonal of a
    copy of J, behind it one flag an exchange.

    Rows are exchanged by selection, not by branches.
    """
    task, lower = rows.task, rows.spare + 4
    flag = lower + m * n
    for k in range(m * n):
        copy(block, lower + k, rows.jacobian + k, count)
    for k in range(m):
        pivot = lower + k * n + k
        for below in range(k + 1, m):
            other = lower + below * n + k
            for i in range(count):
                greater = abs(block[other, i]) > abs(block[pivot, i])
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
                under, above = lower + below * n + j, lower + k * n + j
                add_product(block, under, -1.0, multiple, above, count)
