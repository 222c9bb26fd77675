"""Matrix-variate normal law N_{p,q}(M, Σ⊗Ψ) (Definition 1, Theorems 1, 2, 5), Wishart law W_n(d, Σ)
of real degrees of freedom (Definition 2, Theorems 3, 4), and MaxEnt law of matrices of mean I.
"""

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.core.errors import ModelDomainError


def sample_matrix_normal(
    mean: ndarray, rows: ndarray, columns: ndarray, size: tuple[int, ...], rng: Generator
) -> ndarray:
    """(*size, p, q) draws of X ~ N_{p,q}(M, Σ⊗Ψ), M (p, q), as M + L_Σ Z L_Ψᵀ, Z of independent
    standard normals: Definition 1. vec(Xᵀ), Eq. (vec-of-a-matrix), has the covariance Σ⊗Ψ, Eq.
    (Kron), of ``rows`` Σ (p, p) and ``columns`` Ψ (q, q). By Theorem 2 XXᵀ > 0 for M = 0, Ψ = I and
    q ≥ p. It serves tests alone.
    """
    noise = rng.standard_normal((*size, *mean.shape))
    return mean + np.linalg.cholesky(rows) @ noise @ np.linalg.cholesky(columns).T


def matrix_normal_log_density(
    x: ndarray, mean: ndarray, rows: ndarray, columns: ndarray
) -> ndarray:
    """(...,) log density, Eq. (GaussMatr), of ``x`` (..., p, q); Xᵀ with Σ and Ψ exchanged has the
    same density: Theorem 1. It serves tests alone.
    """
    p, q = mean.shape
    left, right = np.linalg.cholesky(rows), np.linalg.cholesky(columns)
    # tr{Σ⁻¹(X−M)Ψ⁻¹(X−M)ᵀ} = ‖L_Σ⁻¹(X−M)L_Ψ⁻ᵀ‖_F²
    half = np.linalg.solve(left, x - mean)
    white = np.linalg.solve(right, np.swapaxes(half, -1, -2))
    log_determinants = q * np.log(np.diag(left)).sum() + p * np.log(np.diag(right)).sum()
    return -0.5 * (white**2).sum(axis=(-1, -2)) - log_determinants - 0.5 * p * q * np.log(2 * np.pi)


def expected_quadratic(mean: ndarray, rows: ndarray, columns: ndarray, a: ndarray) -> ndarray:
    """(..., p, p) E[XAXᵀ] = tr{AᵀΨ}Σ + MAMᵀ of X ~ N_{p,q}(M, Σ⊗Ψ) for a constant A (..., q, q):
    Theorem 5. It serves tests alone.
    """
    trace = np.einsum("...ij,...ij->...", a, columns)
    return trace[..., None, None] * rows + mean @ a @ np.swapaxes(mean, -1, -2)


def sample(d: float, sigma: ndarray, size: tuple[int, ...], rng: Generator) -> ndarray:
    """(*size, n, n) draws of S ~ W_n(d, Σ), ``sigma`` Σ (n, n), by Bartlett's decomposition S =
    (LT)(LT)ᵀ, T lower triangular with independent entries: T_ii² ~ χ²(d − i + 1) for i = 1 … n,
    standard normals below. For whole d it is the law of Theorem 3. The paper requires d ≥ n; here d
    > n − 1 is enough. It serves tests alone.
    """
    n = len(sigma)
    triangle = np.tril(rng.standard_normal((*size, n, n)), -1)
    triangle[..., np.arange(n), np.arange(n)] = np.sqrt(rng.chisquare(d - np.arange(n), (*size, n)))
    factor = np.linalg.cholesky(sigma) @ triangle
    return factor @ np.swapaxes(factor, -1, -2)


def log_density(s: ndarray, d: float, sigma: ndarray) -> ndarray:
    """(...,) log density of ``s`` (..., n, n), d > n − 1: Definition 2, Eq. (Wishart). It serves
    tests alone.
    """
    from scipy.special import multigammaln  # a model is loaded without SciPy

    n, diagonal = len(sigma), np.diagonal(np.linalg.cholesky(s), axis1=-2, axis2=-1)
    log_det_s = 2 * np.log(diagonal).sum(axis=-1)
    trace = np.trace(np.linalg.solve(sigma, s), axis1=-2, axis2=-1)
    constant = n * np.log(2) + np.linalg.slogdet(sigma)[1]
    return ((d - n - 1) * log_det_s - trace - d * constant) / 2 - multigammaln(d / 2, n)


def mean(d: float, sigma: ndarray) -> ndarray:
    """(n, n) E[S] = dΣ of S ~ W_n(d, Σ): Theorem 4. It serves tests alone."""
    return d * sigma


def largest_dispersion(n: int, *, inverse_moments: int = 0) -> float:
    """Supremum of σ_B for which B ~ W_n(d, I/d) has a density and B⁻¹ has ``inverse_moments``
    moments: 0 (d > n − 1), 1 (d > n + 1) or 2 (d > n + 3), Eq. (invmomnt).
    """
    least = n - 1 + 2 * inverse_moments  # 0 for n = 1: every σ_B has a density
    return float(np.sqrt((n + 1) / least)) if least else np.inf


def maxent_theta(sigma_b: float, n: int) -> float:
    """θ = (n+1)/σ_B² − (n+1) of Eq. (Thetaa) for the mean I_n, where {tr B̲}²/tr B̲² = n."""
    return (1 + n) / sigma_b**2 - (n + 1)


def degrees_of_freedom(sigma_b: float, n: int) -> float:
    """d = θ + n + 1 of the MaxEnt law B ~ W_n(d, I/d) of mean I_n and dispersion ``sigma_b``, which
    solves Eqs. (Maxenmeas)–(invmomnt). Raises ModelDomainError for σ_B ≤ 0 and for a B without a
    density.
    """
    limit = largest_dispersion(n)
    if not 0 < sigma_b < limit:
        message = f"sigma_B must lie between 0 and {limit:.4g}, where B has a density"
        raise ModelDomainError(message, sigma_B=sigma_b, n=n)
    return maxent_theta(sigma_b, n) + n + 1


def normalized_std(samples: ndarray, expected: ndarray) -> ndarray:
    """(...,) normalised standard deviation sqrt(mean ‖B − E[B]‖_F² / ‖E[B]‖_F²), Eq. (NormStd), of
    ``samples`` B (N, ..., n, n) about the given ``expected`` E[B] (n, n).
    """
    squared = ((samples - expected) ** 2).sum(axis=(-1, -2)).mean(axis=0)
    return np.sqrt(squared / (expected**2).sum())
