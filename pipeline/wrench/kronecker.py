"""Σ_S and Ψ_S of the matrix model from recorded static Jacobians.

Wrenches alone cannot tell Ψ_S: it enters their covariance by the trace tr{(Σ_T + T̲T̲ᵀ)Ψ_S} only,
times Σ_S. Recorded S tell both, but for a factor that Σ_S takes from Ψ_S; so do wrenches at several
known T, one for each entry of Ψ_S.

The two estimators agree where S is matrix-variate normal. Columns that are directions scatter
across themselves alone, so that no Σ_S ⊗ Ψ_S is their covariance: there the likelihood weighs by
variances that the cables do not have, and the moments keep what the wrench depends on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ModelDomainError, SolverError

TOLERANCE = 1e-9  # of a step of the iteration, relative to the greatest entry of Ψ_S
ITERATIONS = 20_000  # a few cables that nearly agree take thousands


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


def likelihood_fit(jacobians: np.ndarray) -> KroneckerFit:
    """The law of the matrix-variate normal ``jacobians`` (N, n, m) by maximum likelihood.

    Each of Σ_S = E[XΨ_S⁻¹Xᵀ]/m and Ψ_S = E[XᵀΣ_S⁻¹X]/n has a closed form given the other; they are
    solved in turn (Dutilleul 1999). Raises ModelDomainError for so few samples that the likelihood
    has no single maximum, N − 1 ≤ n/m + m/n (Drton, Kuriki & Hoff 2021), or samples that leave a
    row or cable without variance of its own, and SolverError where the iteration does not settle.
    """
    samples, n, m = jacobians.shape
    if samples - 1 <= n / m + m / n:
        raise ModelDomainError(
            f"Σ_S and Ψ_S need more than {1 + n / m + m / n:.3g} recorded Jacobians of {n} rows "
            f"and {m} cables",
            samples=samples,
        )
    mean, covariance = _moments(jacobians)
    psi = np.eye(m)
    for _ in range(ITERATIONS):
        sigma_s = np.einsum("iajb,ab->ij", covariance, _inverse(psi)) / m
        updated = np.einsum("iajb,ij->ab", covariance, _inverse(sigma_s)) / n
        updated *= m / np.trace(updated)
        settled = np.abs(updated - psi).max() <= TOLERANCE * np.abs(updated).max()
        psi = updated
        if settled:
            sigma_s = np.einsum("iajb,ab->ij", covariance, _inverse(psi)) / m
            return KroneckerFit(mean, sigma_s, psi)
    raise SolverError(f"Σ_S and Ψ_S did not settle in {ITERATIONS} iterations; record more")


def _moments(jacobians: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, m) and covariance (n, m, n, m) of ``jacobians`` (N, n, m)."""
    mean = jacobians.mean(axis=0)
    x = jacobians - mean
    return mean, np.einsum("kia,kjb->iajb", x, x) / len(x)


def _inverse(covariance: np.ndarray) -> np.ndarray:
    if np.linalg.cond(covariance) > 1 / np.finfo(float).eps:
        raise ModelDomainError(
            "the recorded Jacobians leave a row or a cable without variance of its own; the law "
            "has no density"
        )
    return np.linalg.inv(covariance)
