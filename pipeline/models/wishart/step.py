"""Compiled laws of the Wishart model (:mod:`.law`): no matrix is drawn, formed or inverted.

With a = J₁⁻¹v, r = ‖a‖ and R orthonormal of first column a/r, B⁻¹a = r·R·[z, z·T]ᵀ and a step is
J₂⁻¹B⁻¹a = J⁻¹J₁B⁻¹a. As T has n − 1 = 2 components, N/sqrt(χ²(d−1)) with N ~ N(0, I₂), its length
has a closed form: P(‖T‖² > s) = (1 + s)^{−(d−1)/2}, so that ‖T‖² is exp(2E/(d−1)) − 1 for an
exponential E. ‖N‖²/2 is one, and independent of N's direction:

    T = N·sqrt((exp(‖N‖²/(d−1)) − 1)/‖N‖²).

So a step takes one gamma and two normals; the second gamma, half of what a step would cost, is
saved.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from pipeline.arm.compiled import joint_step, plane_of, segments
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import inlined, passed
from pipeline.models.law import Numbers, Poses, at, nominal_step, planar, transformed
from pipeline.models.wishart.factors import PIVOT

# Taylor coefficients of (exp(y) − 1)/y: up to y = 0.7 the first term left out is below half a unit
# in the last place
EXPONENTIAL = tuple(1 / factorial(k + 1) for k in range(15))


@inlined
def expm1(x: float) -> float:
    """exp(x) − 1 for 0 ≤ x < 88: Taylor's series at x/128, then exp(2y) − 1 = (exp(y) − 1)(exp(y) +
    1) seven times.

    The C library's is as good, but takes one pose at a time, and the particle filter 2.7 times as
    long.
    """
    y = x / 128
    result = EXPONENTIAL[14]
    for k in range(13, -1, -1):
        result = result * y + EXPONENTIAL[k]
    result *= y
    for _ in range(7):
        result *= 2.0 + result
    return result


@inlined
def inverse_action(a: tuple, d: float, gamma: float, normal: tuple) -> tuple[float, ...]:
    """B⁻¹a = z·(a + rR[0, T]ᵀ), zero where a is, from ``gamma`` ~ χ²(d−2) and two normals; R is the
    Householder reflection of the first axis to a/r, up to its sign.
    """
    (a1, a2, a3), (n2, n3) = a, normal
    square = n2 * n2 + n3 * n3
    stretch = np.sqrt(expm1(square * (1 / (d - 1))) / square)
    t2, t3 = stretch * n2, stretch * n3
    r = np.sqrt(a1 * a1 + a2 * a2 + a3 * a3)
    m1 = a1 + np.copysign(r, a1)
    reach = r + abs(a1)
    along = (a2 * t2 + a3 * t3) * (1 / reach if reach > 0 else 0.0)
    z = d / gamma
    return z * (a1 - along * m1), z * (a2 + r * t2 - along * a2), z * (a3 + r * t3 - along * a3)


@inlined
def lower_action(lower: tuple, v: tuple, d: float, gamma: float, normal: tuple) -> tuple:
    """L·B⁻¹L⁻¹v for the unit lower triangular L whose entries (2, 1), (3, 1), (3, 2) are
    ``lower``.
    """
    (l21, l31, l32), (v1, v2, v3) = lower, v
    a2 = v2 - l21 * v1
    a3 = v3 - l31 * v1 - l32 * a2
    w1, w2, w3 = inverse_action((v1, a2, a3), d, gamma, normal)
    return w1, l21 * w1 + w2, l31 * w1 + l32 * w2 + w3


@passed
def given_factor(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for a constant J₁; ``parameters`` (1 + 2·n·n,) d and, row by row, J₁ and J₁⁻¹. Both
    are I for the decomposition by QR.
    """
    plane, (v, here, there) = plane_of(arm), planar(poses)
    gamma, normal = numbers.chi_square[0], numbers.normal
    d, end = parameters[0], 1 + len(parameters) // 2
    left, inverse = parameters[1:end], parameters[end:]
    for i in range(poses.count):
        w = inverse_action(
            transformed(inverse, at(v, i)), d, gamma[i], (normal[0, i], normal[1, i])
        )
        dq = nominal_step(plane, here, i, transformed(left, w))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j]
    return 0


@passed
def qr_transposed(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = Rᵀ and J₂ = Qᵀ of Jᵀ = QR; ``parameters`` (1,) d.

    The step is Q·B⁻¹Qᵀ·J⁻¹v, and as Q·B⁻¹Qᵀ has the law of B⁻¹ neither factor is needed.
    """
    plane, (v, here, there) = plane_of(arm), planar(poses)
    gamma, normal = numbers.chi_square[0], numbers.normal
    d = parameters[0]
    for i in range(poses.count):
        dq = inverse_action(
            nominal_step(plane, here, i, at(v, i)), d, gamma[i], (normal[0, i], normal[1, i])
        )
        for j in range(3):
            there[j][i] = here[j][i] + dq[j]
    return 0


@passed
def lu(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = PᵀL of PJ = LU without pivoting; ``parameters`` (1 + 3·n·n,) d and, row by
    row, P, Pᵀ and the matrix that puts the joints in the order of their elimination.

    NaN where a pivot is small: J has no such decomposition to be trusted, and the filter counts the
    pose as outside its domain. L has three numbers; the signs of the joints cancel. U is never
    needed: J⁻¹J₁ is applied by the chain's closed form.
    """
    plane, (v, here, there) = plane_of(arm), planar(poses)
    gamma, normal = numbers.chi_square[0], numbers.normal
    d, size = parameters[0], len(parameters) // 3
    rows, back, order = (
        parameters[1 : 1 + size],
        parameters[1 + size : 1 + 2 * size],
        parameters[1 + 2 * size :],
    )
    for i in range(poses.count):
        shape = segments(plane, at(here, i))
        ax, az, bx, bz, tx, tz = shape
        x = transformed(order, (az + bz + tz, bz + tz, tz))
        z = transformed(order, (-(ax + bx + tx), -(bx + tx), -tx))
        f1, s1, t1 = transformed(rows, (x[0], z[0], 1.0))
        f2, s2, t2 = transformed(rows, (x[1], z[1], 1.0))
        f3, s3, _ = transformed(rows, (x[2], z[2], 1.0))
        l21, l31 = s1 / f1, t1 / f1
        s2, s3, t2 = s2 - l21 * f2, s3 - l21 * f3, t2 - l31 * f2
        # the third pivot is all that is left of its row
        defined = (f1 * f1 >= PIVOT**2 * (f1 * f1 + f2 * f2 + f3 * f3)) & (
            s2 * s2 >= PIVOT**2 * (s2 * s2 + s3 * s3)
        )
        v1, v2, v3 = transformed(rows, at(v, i))
        y = lower_action(
            (l21, l31, t2 / s2),
            (v1 if defined else np.nan, v2, v3),
            d,
            gamma[i],
            (normal[0, i], normal[1, i]),
        )
        dq = joint_step(plane, shape, transformed(back, y))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j]
    return 0


@passed
def pivoted_lu(numbers: Numbers, parameters: np.ndarray, arm: Arm, poses: Poses) -> int:
    """A step for J₁ = PᵀL of PJ = LU with partial pivoting; ``parameters`` (1,) d.

    L has three numbers, and the columns of joints 1 and 2 alone decide them and P; the signs of the
    joints cancel. The rows are exchanged by selection, not by branches. U is never needed: J⁻¹J₁ is
    applied by the chain's closed form.
    """
    plane, (v, here, there) = plane_of(arm), planar(poses)
    gamma, normal = numbers.chi_square[0], numbers.normal
    d = parameters[0]
    for i in range(poses.count):
        shape = segments(plane, at(here, i))
        ax, az, bx, bz, tx, tz = shape
        # rows of J: columns of joints 1 and 2, and the commanded step
        xv, zv, phiv = at(v, i)
        x1, x2, z1, z2 = az + bz + tz, bz + tz, -(ax + bx + tx), -(bx + tx)
        # first pivot: the greatest of |x1|, |z1| and 1, the first of equals
        by_x = abs(x1) >= abs(z1) and abs(x1) >= 1.0
        by_z = not by_x and abs(z1) >= 1.0
        f1, f2, fv = (x1, x2, xv) if by_x else ((z1, z2, zv) if by_z else (1.0, 1.0, phiv))
        s1, s2, sv = (z1, z2, zv) if by_x else (x1, x2, xv)
        t1, t2, tv = (z1, z2, zv) if not (by_x or by_z) else (1.0, 1.0, phiv)
        over = 1 / f1
        ls, lt = s1 * over, t1 * over
        s2, t2 = s2 - ls * f2, t2 - lt * f2
        exchanged = abs(t2) > abs(s2)
        pivot, below = (t2, s2) if exchanged else (s2, t2)
        lower = below / pivot
        l21, l31 = (lt, ls) if exchanged else (ls, lt)
        v2, v3 = (tv, sv) if exchanged else (sv, tv)
        y1, y2, y3 = lower_action(
            (l21, l31, lower), (fv, v2, v3), d, gamma[i], (normal[0, i], normal[1, i])
        )
        # PᵀL·B⁻¹a, back in the rows x, z, φ
        ys, yt = (y3, y2) if exchanged else (y2, y3)
        x = y1 if by_x else ys
        z = y1 if by_z else (ys if by_x else yt)
        phi = yt if by_x or by_z else y1
        dq = joint_step(plane, shape, (x, z, phi))
        for j in range(3):
            there[j][i] = here[j][i] + dq[j]
    return 0
