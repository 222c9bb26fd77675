"""Exact variances of a step under every decomposition J = J₁J₂ of the Wishart model and under the
Gaussian model.

A Wishart step J₂⁺B⁻¹a, a = J₁⁻¹v, r = ‖a‖, has the covariance
r²·J₂⁺R·diag(Var z, (E z²/(d−m))·I)·RᵀJ₂⁺ᵀ, R orthonormal with first column a/r, d = (m+1)/σ_B².
J has m task rows and n ≥ m joints. The batch comes last, so that every entry is contiguous over it.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from pipeline.models.wishart.decomposition import orthonormalize
from pipeline.models.wishart.law import step_variances

PIVOTED, QR, QR_TRANSPOSED, GAUSSIAN = "pivoted_lu", "qr", "qr_transposed", "gaussian"
PLAIN = {
    "lu_" + "".join("xzp"[row] for row in order): order for order in permutations(range(3))
}  # LU without pivoting of the planar task (x, z, φ) in every order of its rows
READINGS = (PIVOTED, *PLAIN, QR, QR_TRANSPOSED)


def factors_of(
    reading: str, jacobian: np.ndarray, inverse: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return J₂⁺ (n, m, ...) up to a rotation from the right, and a = J₁⁻¹v (m, ...), of
    J (m, n, ...), J⁺ (n, m, ...) and the commanded step v (m, ...).

    The law of B is invariant to rotations: the QR of J is J₁ = I. LU is J₁ = PᵀL of PJ = LU, P a
    fixed order of three rows or by partial pivoting.
    """
    if reading == QR:
        return inverse, v
    m, n = jacobian.shape[:2]
    identity = np.zeros((m, m, *jacobian.shape[2:]))
    identity[range(m), range(m)] = 1.0
    # columns: J, which becomes multipliers and J₂; v, which becomes a; P
    rows = np.concatenate([jacobian, v[:, None], identity], axis=1)
    if reading == QR_TRANSPOSED:
        orthonormalize(rows, n)
        return np.swapaxes(rows[:, :n], 0, 1), rows[:, n]
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
    for i in range(m):
        identity[i, :i] = rows[i, :i]
    first = np.einsum("ki...,kj...->ij...", rows[:, n + 1 :], identity)
    return np.einsum("ij...,jk...->ik...", inverse, first), rows[:, n]


def wishart_parts(
    reading: str, jacobian: np.ndarray, inverse: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (n, ...) parts A and C of the variances of a step's joints, which are
    across·(A − C) + along·C with the factors of
    :func:`pipeline.models.wishart.law.step_variances`.

    A_j = r²·(J₂⁺J₂⁺ᵀ)_jj and C_j = (J⁺v)_j², of the arguments of :func:`factors_of`.
    """
    back, a = factors_of(reading, jacobian, inverse, v)
    nominal = np.einsum("ij...,j...->i...", inverse, v)
    return (a * a).sum(axis=0) * (back * back).sum(axis=1), nominal * nominal


def wishart_variance(parts: tuple[np.ndarray, np.ndarray], m: int, sigma_b: float) -> np.ndarray:
    """Return the (n, ...) variances of a step's joints in rad² from :func:`wishart_parts`."""
    along, across = step_variances((m + 1) / sigma_b**2, m)
    total, nominal = parts
    return across * (total - nominal) + along * nominal


def gaussian_variance(
    norm: np.ndarray, v: np.ndarray, alpha: float, u: float, n: int
) -> np.ndarray:
    """Return the (...) variance in rad² of every joint's step under the Gaussian model of the
    inverse Jacobian, α²(u² − ‖J⁺‖_F²)‖v‖²/(nm), of ``norm`` ‖J⁺‖_F (...) and ``v`` (m, ...).
    """
    return alpha**2 * (u**2 - norm**2) * (v * v).sum(axis=0) / (n * len(v))
