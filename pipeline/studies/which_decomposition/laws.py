"""Exact variances of a step under every decomposition J = J₁J₂ of the Wishart model and under the
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
    """Return J₁ (m, m, ...) up to a rotation from the right, and J₁⁻¹v (m, ...), of J (m, n, ...)
    and the commanded step v (m, ...).

    The law of B is invariant to rotations: the QR of J is J₁ = I, the one of Jᵀ the Cholesky factor
    of JJᵀ. LU is J₁ = PᵀL of PJ = LU, P a fixed order of three rows or by partial pivoting.
    """
    m, n = jacobian.shape[:2]
    identity = np.zeros((m, m, *jacobian.shape[2:]))
    identity[range(m), range(m)] = 1.0
    if reading == QR:
        return identity, v
    if reading == QR_TRANSPOSED:
        first, a = np.zeros_like(identity), np.empty_like(v)
        for i in range(m):
            for j in range(i + 1):
                rest = (jacobian[i] * jacobian[j]).sum(axis=0)
                rest = rest - (first[i, :j] * first[j, :j]).sum(axis=0)
                first[i, j] = np.sqrt(rest) if i == j else rest / first[j, j]
            a[i] = (v[i] - (first[i, :i] * a[:i]).sum(axis=0)) / first[i, i]
        return first, a
    # columns: J, which becomes multipliers and U; v; P
    rows = np.concatenate([jacobian, v[:, None], identity], axis=1)
    rows = rows[list(PLAIN.get(reading, range(m)))]
    for k in range(m):
        if reading == PIVOTED:
            greatest = k + np.abs(rows[k:, k]).argmax(axis=0)
            for i in range(k + 1, m):
                here = greatest == i
                rows[k], rows[i] = (
                    np.where(here, rows[i], rows[k]),
                    np.where(here, rows[k], rows[i]),
                )
        for i in range(k + 1, m):
            rows[i, k] /= rows[k, k]
            rows[i, k + 1 : n + 1] -= rows[i, k] * rows[k, k + 1 : n + 1]
    lower = identity
    for i in range(m):
        lower[i, :i] = rows[i, :i]
    return np.einsum("ki...,kj...->ij...", rows[:, n + 1 :], lower), rows[:, n]


def wishart_moments(m: int, sigma_b: float | np.ndarray) -> tuple:
    """Return (along, across): Var z and E z²/(d−m) of m task rows at ``sigma_b`` σ_B, which must be
    below sqrt((m+1)/(m+3)).
    """
    d = (m + 1) / np.square(sigma_b)
    square = d**2 / ((d - m - 1) * (d - m - 3))
    return 2 * square / (d - m - 1), square / (d - m)


def wishart_parts(
    reading: str, jacobian: np.ndarray, inverse: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (n, ...) parts A and C of the variances of a step's joints, which are
    across·(A − C) + along·C with the factors of :func:`wishart_moments`.

    A_j = r²·(J₂⁺J₂⁺ᵀ)_jj and C_j = (J⁺v)_j² of J (m, n, ...), J⁺ (n, m, ...) and v (m, ...).
    """
    first, a = first_factor(reading, jacobian, v)
    square, m = (a * a).sum(axis=0), len(a)
    total, nominal = [], []
    for row in inverse:
        back = [sum(row[i] * first[i, k] for i in range(m)) for k in range(m)]
        total.append(square * sum(entry * entry for entry in back))
        nominal.append(sum(row[i] * v[i] for i in range(m)) ** 2)
    return np.stack(total), np.stack(nominal)


def wishart_variance(parts: tuple[np.ndarray, np.ndarray], m: int, sigma_b: float) -> np.ndarray:
    """Return the (n, ...) variances of a step's joints in rad² from :func:`wishart_parts`."""
    along, across = wishart_moments(m, sigma_b)
    total, nominal = parts
    return across * (total - nominal) + along * nominal


def gaussian_variance(
    norm: np.ndarray, v: np.ndarray, alpha: float, u: float, n: int
) -> np.ndarray:
    """Return the (...) variance in rad² of every joint's step under the Gaussian model of the
    inverse Jacobian, α²(u² − ‖J⁺‖_F²)‖v‖²/(nm), of ``norm`` ‖J⁺‖_F (...) and ``v`` (m, ...).
    """
    return alpha**2 * (u**2 - norm**2) * (v * v).sum(axis=0) / (n * len(v))
