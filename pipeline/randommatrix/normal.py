"""The matrix-variate normal distribution N_{p,q}(M, Σ⊗Ψ): Definition 1, Theorems 1 and 5."""

import numpy as np

from pipeline.core.errors import ModelDomainError

# asymmetry that rounding may leave in a covariance, as a share of its largest entry
SYMMETRY_TOLERANCE = 1e-12


def cholesky(matrix: np.ndarray, *, what: str) -> np.ndarray:
    """(..., p, p) lower Cholesky factor; ModelDomainError names ``what`` where there is none."""
    # NumPy's routine reads the lower triangle alone, and passes on what is not a number
    scale = np.abs(matrix).max()
    if (
        np.isfinite(scale)
        and np.abs(matrix - np.swapaxes(matrix, -1, -2)).max() <= SYMMETRY_TOLERANCE * scale
    ):
        try:
            return np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            pass
    raise ModelDomainError(
        f"{what} must be finite, symmetric and positive definite", largest_entry=float(scale)
    )


def sample(
    mean: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    size: tuple[int, ...],
    rng: np.random.Generator,
) -> np.ndarray:
    """(*size, p, q) draws of X ~ N_{p,q}(M, Σ⊗Ψ), M (p, q), as M + L_Σ Z L_Ψᵀ, Z of independent
    standard normals: Definition 1. vec(Xᵀ), Eq. (vec-of-a-matrix), then has the covariance Σ⊗Ψ, Eq.
    (Kron), of ``rows`` Σ (p, p) and ``columns`` Ψ (q, q). By Theorem 2 XXᵀ > 0 for M = 0, Ψ = I and
    q ≥ p. It serves tests alone.
    """
    noise = rng.standard_normal((*size, *mean.shape))
    return mean + cholesky(rows, what="Σ") @ noise @ cholesky(columns, what="Ψ").T


def log_density(
    x: np.ndarray, mean: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """(...,) log density, Eq. (GaussMatr), of ``x`` (..., p, q); others as in :func:`sample`.

    By Theorem 1 it is that of Xᵀ with Σ and Ψ exchanged. It serves tests alone.
    """
    p, q = mean.shape
    left, right = cholesky(rows, what="Σ"), cholesky(columns, what="Ψ")
    # tr{Σ⁻¹(X−M)Ψ⁻¹(X−M)ᵀ} = ‖L_Σ⁻¹(X−M)L_Ψ⁻ᵀ‖_F²
    half = np.linalg.solve(left, x - mean)
    white = np.linalg.solve(right, np.swapaxes(half, -1, -2))
    log_determinants = q * np.log(np.diag(left)).sum() + p * np.log(np.diag(right)).sum()
    return -0.5 * (white**2).sum(axis=(-1, -2)) - log_determinants - 0.5 * p * q * np.log(2 * np.pi)


def expected_quadratic(
    mean: np.ndarray, rows: np.ndarray, columns: np.ndarray, a: np.ndarray
) -> np.ndarray:
    """(..., p, p) E[XAXᵀ] = tr{AᵀΨ}Σ + MAMᵀ of X ~ N_{p,q}(M, Σ⊗Ψ) and a constant A (..., q, q):
    Theorem 5. It serves tests alone.
    """
    trace = np.einsum("...ij,...ij->...", a, columns)
    return trace[..., None, None] * rows + mean @ a @ np.swapaxes(mean, -1, -2)
