"""Compiled laws of the Wishart model (:mod:`.law`): no matrix is drawn, formed or inverted.

With a = J₁⁻¹v, r = ‖a‖ and R orthonormal of first column a/r, B⁻¹a = r·R·[z, z·T]ᵀ and a step is
J₂⁻¹B⁻¹a = J⁻¹J₁B⁻¹a. As T has n − 1 = 2 components, N/sqrt(χ²(d−1)) with N ~ N(0, I₂), its length
has a closed form: P(‖T‖² > s) = (1 + s)^{−(d−1)/2}, so that ‖T‖² is exp(2E/(d−1)) − 1 for an
exponential E. ‖N‖²/2 is one, and independent of N's direction:

    T = N·sqrt((exp(‖N‖²/(d−1)) − 1)/‖N‖²).

So a step takes one gamma and two normals; the second gamma, half of what a step would cost, is
saved. A block goes through several short loops: for one long one the processor has too few
registers, and each pose waits for the roots and quotients of the one before.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.compiled import plane_of
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import inlined, passed
from pipeline.core.elementary import fma
from pipeline.models.law import (
    Numbers,
    Poses,
    at,
    jacobians,
    nominal_step,
    planar,
    transformed,
)
from pipeline.models.wishart.action import act_on_three


@inlined
def task(room: np.ndarray) -> tuple[np.ndarray, ...]:
    """Room behind the Jacobians for a, and then B⁻¹a."""
    return room[7], room[8], room[9]


@inlined
def upper_of(room: np.ndarray) -> tuple[np.ndarray, ...]:
    """Room for what :func:`back` needs of U."""
    return room[10], room[11], room[12], room[13]


@passed
def given_factor(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for a constant J₁; ``parameters`` (1 + 2·n·n,) d and, row by row, J₁ and J₁⁻¹. Both
    are I for the decomposition by QR.
    """
    plane, (v, here, there), a = plane_of(arm), planar(poses), task(numbers.room)
    end = 1 + len(parameters) // 2
    left, inverse = parameters[1:end], parameters[end:]
    jacobian = jacobians(plane, here, numbers.room)
    for i in range(poses.count):
        a[0][i], a[1][i], a[2][i] = transformed(inverse, at(v, i))
    act_on_three(numbers, parameters[0], a[0], a[1], a[2], poses.count)
    for i in range(poses.count):
        dq = nominal_step(plane, jacobian, i, transformed(left, at(a, i)))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j]
    return 0


@passed
def qr_transposed(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = Rᵀ and J₂ = Qᵀ of Jᵀ = QR; ``parameters`` (1,) d.

    The step is Q·B⁻¹Qᵀ·J⁻¹v, and as Q·B⁻¹Qᵀ has the law of B⁻¹ neither factor is needed.
    """
    plane, (v, here, there), a = plane_of(arm), planar(poses), task(numbers.room)
    jacobian = jacobians(plane, here, numbers.room)
    for i in range(poses.count):
        a[0][i], a[1][i], a[2][i] = nominal_step(plane, jacobian, i, at(v, i))
    act_on_three(numbers, parameters[0], a[0], a[1], a[2], poses.count)
    for i in range(poses.count):
        for j in range(3):
            there[j][i] = here[j][i] + a[j][i]
    return 0


@inlined
def eliminate(rows: tuple, v: tuple) -> tuple[tuple[float, ...], ...]:
    """L⁻¹v and, of the matrix LU of these ``rows``, what :func:`back` needs of U: the inverses of
    its pivots and its entry (2, 3).

    What elimination leaves of a row stays times the pivot above it, so that one quotient is enough
    for all of them.
    """
    ((f1, f2, f3), (s1, s2, s3), (t1, t2, t3)), (v1, v2, v3) = rows, v
    s2, s3 = fma(f1, s2, -s1 * f2), fma(f1, s3, -s1 * f3)
    t2, t3 = fma(f1, t2, -t1 * f2), fma(f1, t3, -t1 * f3)
    pivots, t3 = f1 * s2, fma(s2, t3, -t2 * s3)
    over = 1 / (pivots * t3)
    over_f, over_s = over * (s2 * t3), over * (f1 * t3)
    a2 = fma(-s1 * over_f, v1, v2)
    a3 = fma(-t2 * over_s, a2, fma(-t1 * over_f, v1, v3))
    return (v1, a2, a3), (over_f, f1 * over_s, over * pivots * pivots, s3 * over_f)


@inlined
def back(first: tuple, upper: tuple, w: tuple) -> tuple[float, ...]:
    """U⁻¹w of the matrix whose ``first`` row is given and of whose others :func:`eliminate` says
    the rest.
    """
    (_, f2, f3), (over_f, over_s, over_t, u), (w1, w2, w3) = first, upper, w
    y3 = w3 * over_t
    y2 = fma(-u, y3, w2) * over_s
    return fma(-f2, y2, fma(-f3, y3, w1)) * over_f, y2, y3


@passed
def pivoted_lu(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = PᵀL of PJ = LU with partial pivoting; ``parameters`` (1,) d.

    The rows are exchanged by selection, not by branches. The first one takes the place of x.
    """
    plane, (v, here, there), room = plane_of(arm), planar(poses), numbers.room
    x, z, _ = jacobians(plane, here, room)
    a, upper = task(room), upper_of(room)
    for i in range(poses.count):
        (x1, x2, x3), (z1, z2, z3), (xv, zv, phiv) = at(x, i), at(z, i), at(v, i)
        # first pivot: the greatest of |x1|, |z1| and 1, the first of equals
        by_x = (abs(x1) >= abs(z1)) & (abs(x1) >= 1.0)
        by_z = (abs(z1) >= 1.0) & (not by_x)
        f1, f2, f3, fv = (
            (x1, x2, x3, xv) if by_x else ((z1, z2, z3, zv) if by_z else (1.0, 1.0, 1.0, phiv))
        )
        s1, s2, s3, sv = (z1, z2, z3, zv) if by_x else (x1, x2, x3, xv)
        t1, t2, t3, tv = (1.0, 1.0, 1.0, phiv) if by_x or by_z else (z1, z2, z3, zv)
        exchanged = abs(fma(f1, t2, -t1 * f2)) > abs(fma(f1, s2, -s1 * f2))
        second, v2 = ((t1, t2, t3), tv) if exchanged else ((s1, s2, s3), sv)
        third, v3 = ((s1, s2, s3), sv) if exchanged else ((t1, t2, t3), tv)
        (a1, a2, a3), u = eliminate(((f1, f2, f3), second, third), (fv, v2, v3))
        a[0][i], a[1][i], a[2][i] = a1, a2, a3
        upper[0][i], upper[1][i], upper[2][i], upper[3][i] = u
        x[1][i], x[2][i] = f2, f3
    act_on_three(numbers, parameters[0], a[0], a[1], a[2], poses.count)
    for i in range(poses.count):
        u = upper[0][i], upper[1][i], upper[2][i], upper[3][i]
        dq = back(at(x, i), u, at(a, i))
        for k in range(3):
            there[k][i] = fma(plane.signs[k], dq[k], here[k][i])
    return 0
