"""Exact covariances of a step of the Wishart model under every decomposition J = J₁J₂, and of the
Gaussian model.

A Wishart step J₂⁺B⁻¹a, a = J₁⁻¹v, r = ‖a‖, has the covariance
r²·J₂⁺R·diag(Var z, (E z²/(d−m))·I)·RᵀJ₂⁺ᵀ, R orthonormal with first column a/r, d = (m+1)/σ_B².
Here E z² = d²/((d−m−1)(d−m−3)) and Var z = 2d²/((d−m−1)²(d−m−3)). As J₂⁺ = J⁺J₁ it needs J⁺, J₁
and J₁⁻¹v alone. J has m task rows and n ≥ m joints. The batch comes last, so that every entry is
contiguous over it.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

PIVOTED, QR, QR_TRANSPOSED, GAUSSIAN = "pivoted_lu", "qr", "qr_transposed", "gaussian"
PLAIN = {
    "lu_" + "".join("xzp"[row] for row in order): order for order in permutations(range(3))
}  # LU without pivoting of the planar task (x, z, φ) in every order of its rows
READINGS = (PIVOTED, *PLAIN, QR, QR_TRANSPOSED)


def first_factor(reading: str, jacobian: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """J₁ (m, m, ...) up to a rotation from the right, and J₁⁻¹v (m, ...).

    Args:
        reading: one of :data:`READINGS`; those of :data:`PLAIN` need three task rows.
        jacobian: (m, n, ...) J.
        v: (m, ...) commanded step of the task.

    The law of B is invariant to rotations: the QR of J is J₁ = I, the one of Jᵀ J₁ = Rᵀ.
    """
    m = len(jacobian)
    identity = np.zeros((m, m, *jacobian.shape[2:]))
    identity[range(m), range(m)] = 1.0
    if reading == QR:
        return identity, v
    if reading == QR_TRANSPOSED:
        return _orthonormalized(jacobian, v)
    return _eliminated(jacobian, v, identity, PLAIN.get(reading))


def _orthonormalized(jacobian: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rᵀ and R⁻ᵀv of Jᵀ = QR, by the Cholesky factor of JJᵀ."""
    m = len(jacobian)
    lower = np.zeros((m, m, *jacobian.shape[2:]))
    a = np.empty_like(v)
    for i in range(m):
        for j in range(i + 1):
            rest = (jacobian[i] * jacobian[j]).sum(axis=0)
            rest = rest - (lower[i, :j] * lower[j, :j]).sum(axis=0)
            lower[i, j] = np.sqrt(rest) if i == j else rest / lower[j, j]
        a[i] = (v[i] - (lower[i, :i] * a[:i]).sum(axis=0)) / lower[i, i]
    return lower, a


def _eliminated(
    jacobian: np.ndarray, v: np.ndarray, identity: np.ndarray, order: tuple[int, ...] | None
) -> tuple[np.ndarray, np.ndarray]:
    """PᵀL and L⁻¹Pv of PJ = LU, for a fixed ``order`` of the rows or, where that is None, with
    partial pivoting.
    """
    m, n = jacobian.shape[:2]
    rows = list(range(m) if order is None else order)
    # columns: J, the multipliers, P
    upper, a, place = jacobian[rows].copy(), v[rows].copy(), identity[rows].copy()
    lower = identity.copy()
    for k in range(m):
        if order is None:
            greatest = k + np.abs(upper[k:, k]).argmax(axis=0)
            for i in range(k + 1, m):
                here = greatest == i
                for part in (upper, a, place):
                    part[k], part[i] = (
                        np.where(here, part[i], part[k]),
                        np.where(here, part[k], part[i]),
                    )
                lower[k, :k], lower[i, :k] = (
                    np.where(here, lower[i, :k], lower[k, :k]),
                    np.where(here, lower[k, :k], lower[i, :k]),
                )
        for i in range(k + 1, m):
            multiple = upper[i, k] / upper[k, k]
            lower[i, k] = multiple
            a[i] -= multiple * a[k]
            for j in range(k + 1, n):
                upper[i, j] -= multiple * upper[k, j]
    if order is not None:
        first = np.empty_like(lower)
        first[rows] = lower
        return first, a
    return np.einsum("ki...,kj...->ij...", place, lower), a


def wishart_moments(m: int, sigma_b: float | np.ndarray) -> tuple:
    """(along, across): Var z and E z²/(d−m) of m task rows at ``sigma_b`` σ_B, which must be below
    sqrt((m+1)/(m+3)).
    """
    d = (m + 1) / np.square(sigma_b)
    square = d**2 / ((d - m - 1) * (d - m - 3))
    return 2 * square / (d - m - 1), square / (d - m)


def wishart_parts(
    reading: str, jacobian: np.ndarray, inverse: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(n, ...) parts A and C of the variances of a step's joints: across·(A − C) + along·C.

    Args:
        reading: one of :data:`READINGS`.
        jacobian: (m, n, ...) J.
        inverse: (n, m, ...) J⁺.
        v: (m, ...) commanded step of the task.

    A_j = r²·(J₂⁺J₂⁺ᵀ)_jj and C_j = (J⁺v)_j², along and across those of :func:`wishart_moments`.
    """
    first, a = first_factor(reading, jacobian, v)
    square = (a * a).sum(axis=0)
    m = len(a)
    total, nominal = [], []
    for row in inverse:
        back = [sum(row[i] * first[i, k] for i in range(m)) for k in range(m)]
        total.append(square * sum(entry * entry for entry in back))
        nominal.append(sum(row[i] * v[i] for i in range(m)) ** 2)
    return np.stack(total), np.stack(nominal)


def wishart_variance(parts: tuple[np.ndarray, np.ndarray], m: int, sigma_b: float) -> np.ndarray:
    """(n, ...) variances of a step's joints in rad² from its :func:`wishart_parts`."""
    along, across = wishart_moments(m, sigma_b)
    total, nominal = parts
    return across * (total - nominal) + along * nominal


def gaussian_variance(
    norm: np.ndarray, v: np.ndarray, alpha: float, u: float, n: int
) -> np.ndarray:
    """(...,) variance in rad² of every joint's step under the Gaussian model of the inverse
    Jacobian, α²(u² − ‖J⁺‖_F²)‖v‖²/(nm), of ``norm`` ‖J⁺‖_F (...) and ``v`` (m, ...).
    """
    return alpha**2 * (u**2 - norm**2) * (v * v).sum(axis=0) / (n * len(v))
