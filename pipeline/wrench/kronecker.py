"""Σ_S and Ψ_S of the matrix model from recorded static Jacobians.

Wrenches alone cannot tell Ψ_S: it enters their covariance by the trace tr{(Σ_T + T̲T̲ᵀ)Ψ_S} only,
times Σ_S. Recorded S tell both, but for a factor that Σ_S takes from Ψ_S; so do wrenches at several
known T, one for each entry of Ψ_S.

Columns that are directions scatter across themselves alone, so that no Σ_S ⊗ Ψ_S is their
covariance; the moments keep the trace on which the wrench depends, and the likelihood of a
matrix-variate normal law would not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError


@dataclass(frozen=True)
class KroneckerFit:
    """S ~ N(mean, Σ_S ⊗ Ψ_S) with tr Ψ_S = m."""

    mean: np.ndarray  # (n, m)
    sigma_s: np.ndarray  # Σ_S (n, n), per cable
    psi: np.ndarray  # Ψ_S (m, m)


def moment_fit(jacobians: np.ndarray) -> KroneckerFit:
    """The law of ``jacobians`` (N, n, m) by two of its moments, with X = S − E[S]: E[XXᵀ] =
    tr(Ψ_S)·Σ_S and E[XᵀX] = tr(Σ_S)·Ψ_S (Theorem 5).

    Where columns and tensions are independent the trace of the modelled Cov(W) is then exact,
    whatever the law of S. The rows need one unit, as a characteristic length gives them. Raises
    ModelDomainError for samples without any variance.
    """
    mean, covariance = _moments(jacobians)
    psi = np.einsum("iaib->ab", covariance)
    if not np.trace(psi) > 0:
        raise ModelDomainError("the recorded Jacobians are all alike; Σ_S and Ψ_S need variance")
    m = len(psi)
    return KroneckerFit(mean, np.einsum("iaja->ij", covariance) / m, psi * m / np.trace(psi))


def _moments(jacobians: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, m) and covariance (n, m, n, m) of ``jacobians`` (N, n, m)."""
    mean = jacobians.mean(axis=0)
    x = jacobians - mean
    return mean, np.einsum("kia,kjb->iajb", x, x) / len(x)
