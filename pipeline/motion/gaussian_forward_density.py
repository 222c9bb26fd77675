"""The density of x = A⁻¹v for a 3 × 3 matrix A of independent normal entries, A ~ N_{n,n}(J̲, I⊗sI): in closed form.

x is the single zero of f(x) = Ax − v, so by the formula of Kac and Rice p(x) = E[|det A| | Ax = v]·p_{Ax}(v) with Ax ~ N(J̲x, s‖x‖²·I).
Let U and V hold orthonormal bases of x⊥ and v⊥ in their columns. AU is independent of Ax, and given Ax = v

    |det A| = ‖v‖/‖x‖ · |det G|,   G = VᵀAU ~ N(M, sI),   M = VᵀJ̲U.

det G = (R₁² − R₂²)/2 with R₁² and R₂² the squared lengths of the independent vectors (g₁₁ + g₂₂, g₂₁ − g₁₂)/√2 and
(g₁₁ − g₂₂, g₁₂ + g₂₁)/√2, whose entries have variance s. In m₁ ≥ m₂ ≥ 0, the singular values of M, the means of these vectors have
lengths √(2s)·a and √(2s)·b, a = (m₁ + m₂)/2√s, b = (m₁ − m₂)/2√s, and the law of the sign of R₁ − R₂ (Marcum's Q function) gives

    E|det G| = |det M|·(1 − 2Q₁(b, a)) + s·e^{−(a² + b²)/2}·[(1 + 2a²)·I₀(ab) + 2ab·I₁(ab)].

M enters through ‖M‖_F² and det M alone, and both follow without U and V: det M is ± v̂ᵀ·cof(J̲)·x̂.
"""

from __future__ import annotations

import numpy as np
from scipy.special import i0e, i1e

# Q₁(b, a) ≤ e^{−(a−b)²/2} for b ≤ a: beyond this a − b the sign of the determinant is certain to the last bit of a double
CERTAIN = 8.6
NODES = 16  # of the quadrature of Marcum's Q, which leaves an absolute error below 1e-9
_ROOTS, _WEIGHTS = np.polynomial.legendre.leggauss(NODES)


def marcum_q(b: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(...,) Q₁(b, a) = ∫_a^∞ r·e^{−(r² + b²)/2}·I₀(rb) dr for 0 ≤ b ≤ a, the tail of Rice's distribution, by Gauss and Legendre's rule.

    As b ≤ a the integrand falls at least as fast as e^{−(r−a)²/2}·r: the tail beyond a + CERTAIN is nothing.
    """
    total = np.zeros(np.broadcast_shapes(np.shape(a), np.shape(b)))
    for root, weight in zip(_ROOTS, _WEIGHTS, strict=True):
        r = a + CERTAIN * (root + 1) / 2
        total += weight * r * i0e(r * b) * np.exp(-((r - b) ** 2) / 2)
    return CERTAIN / 2 * total


def expected_absolute_determinant(determinant: np.ndarray, squared_norm: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(...,) E|det G| of a 2 × 2 matrix G of independent normal entries of variance ``s`` > 0 about M.

    ``determinant`` |det M| and ``squared_norm`` ‖M‖_F² ≥ 2|det M|, to which rounding is held.
    """
    determinant, squared_norm, s = np.broadcast_arrays(determinant, squared_norm, s)
    result = np.array(determinant, dtype=float)
    a = np.sqrt(np.maximum(squared_norm + 2 * determinant, 4 * determinant) / s) / 2
    b = np.sqrt(np.maximum(squared_norm - 2 * determinant, 0.0) / s) / 2
    # a − b without the difference of two large numbers
    gap = determinant / s / np.maximum(a + b, np.finfo(float).tiny)
    open_ = gap < CERTAIN
    a, b, gap, s = a[open_], b[open_], gap[open_], s[open_]
    bessel = (1 + 2 * a**2) * i0e(a * b) + 2 * a * b * i1e(a * b)
    result[open_] = result[open_] * (1 - 2 * marcum_q(b, a)) + s * np.exp(-(gap**2) / 2) * bessel
    return result


def crossing(jacobian: np.ndarray, v: np.ndarray, direction: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(N, D) E|det G| for x along ``direction`` (N, D, 3), of any length but zero; ``jacobian`` J̲ (N, 3, 3), ``v`` (N, 3), ``s`` (N,).

    It does not depend on how far x reaches, nor on its sign.
    """
    speed, length = np.sqrt(np.vecdot(v, v))[:, None], np.sqrt(np.vecdot(direction, direction))
    image = direction @ np.swapaxes(jacobian, -1, -2) / length[..., None]
    unit = v / speed
    back = np.matvec(np.swapaxes(jacobian, -1, -2), unit)
    nominal = np.linalg.solve(jacobian, v[..., None])
    determinant = np.abs((direction @ nominal)[..., 0] * np.linalg.det(jacobian)[:, None]) / (speed * length)
    norms = np.sum(jacobian**2, axis=(-1, -2)) - np.vecdot(back, back)
    squared_norm = norms[:, None] - np.vecdot(image, image) + (image @ unit[..., None])[..., 0] ** 2
    return expected_absolute_determinant(determinant, squared_norm, s[:, None])


def action_log_density(x: np.ndarray, v: np.ndarray, jacobian: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(N,) log density of A⁻¹v at ``x`` (N, 3); −inf at zero, which only an infinite A maps to ``v`` (N, 3), not zero.

    ``jacobian`` J̲ (N, 3, 3) regular; ``s`` (N,) positive, the variance of every entry of A.
    """
    squared = np.vecdot(x, x)
    away = squared > 0
    reached = np.where(away, squared, 1.0)
    x = np.where(away[:, None], x, [1.0, 0.0, 0.0])
    miss = v - np.matvec(jacobian, x)
    weight = np.sqrt(np.vecdot(v, v) / reached) * crossing(jacobian, v, x[:, None], s)[:, 0]
    # the density at zero is zero: ‖Ax‖ = ‖v‖ is out of reach there
    of_image = -1.5 * np.log(2 * np.pi * s * reached) - np.vecdot(miss, miss) / (2 * s * reached)
    return np.where(away, np.log(weight) + of_image, -np.inf)
