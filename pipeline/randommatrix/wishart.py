"""The Wishart law W_n(d, Σ) of real degrees of freedom, and the MaxEnt law of matrices of mean I.

Definition 2, Theorems 3 and 4, Eqs. (NormStd) and (Thetaa).
"""

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.randommatrix.normal import cholesky


def _require_density(d: float, n: int) -> None:
    # the paper asks for d ≥ n; real degrees of freedom have a density down to n − 1
    if not d > n - 1:
        raise ModelDomainError(
            f"a Wishart matrix of size {n} has a density only for d > {n - 1}", d=d
        )


def sample(
    d: float, sigma: np.ndarray, size: tuple[int, ...], rng: np.random.Generator
) -> np.ndarray:
    """(*size, n, n) draws of S ~ W_n(d, Σ), ``sigma`` Σ (n, n), by Bartlett's decomposition S =
    (LT)(LT)ᵀ, T lower triangular with independent entries: T_ii² ~ χ²(d − i + 1) for i = 1 … n,
    standard normals below. For whole d that is the law of Theorem 3, and d need not be an integer.
    Raises ModelDomainError for d ≤ n − 1 or Σ not positive definite. It serves tests alone: the
    models draw what B does to one vector.
    """
    n = len(sigma)
    _require_density(d, n)
    triangle = np.tril(rng.standard_normal((*size, n, n)), -1)
    triangle[..., np.arange(n), np.arange(n)] = np.sqrt(rng.chisquare(d - np.arange(n), (*size, n)))
    factor = cholesky(np.asarray(sigma, dtype=float), what="Σ") @ triangle
    return factor @ np.swapaxes(factor, -1, -2)


def log_density(s: np.ndarray, d: float, sigma: np.ndarray) -> np.ndarray:
    """(...,) log density of ``s`` (..., n, n): Definition 2, Eq. (Wishart). Raises ModelDomainError
    outside its domain. It serves tests alone.
    """
    from scipy.special import multigammaln  # here, as what loads a model does without SciPy

    n = len(sigma)
    _require_density(d, n)
    log_det_s = 2 * np.log(
        np.diagonal(cholesky(s, what="a Wishart matrix"), axis1=-2, axis2=-1)
    ).sum(axis=-1)
    log_det_sigma = 2 * np.log(np.diag(cholesky(sigma, what="Σ"))).sum()
    trace = np.trace(np.linalg.solve(sigma, s), axis1=-2, axis2=-1)
    return (
        (d - n - 1) / 2 * log_det_s
        - trace / 2
        - d * n / 2 * np.log(2)
        - d / 2 * log_det_sigma
        - multigammaln(d / 2, n)
    )


def mean(d: float, sigma: np.ndarray) -> np.ndarray:
    """(n, n) E[S] = dΣ of S ~ W_n(d, Σ): Theorem 4. It serves tests alone."""
    return d * sigma


def largest_dispersion(n: int, *, inverse_moments: int = 0) -> float:
    """Supremum of σ_B for which B ~ W_n(d, I/d) has a density and B⁻¹ ``inverse_moments`` moments.

    They exist for d > n − 1 (none), d > n + 1 (the mean), d > n + 3 (the variance): Eq. (invmomnt).
    A matrix of one number has a density for every σ_B.
    """
    least = n - 1 + 2 * inverse_moments  # of a number no dispersion is too large
    return float(np.sqrt((n + 1) / least)) if least else np.inf


def maxent_theta(sigma_b: float, n: int) -> float:
    """θ = (n+1)/σ_B² − (n+1) of Eq. (Thetaa) for the mean I_n, where {tr B̲}²/tr B̲² = n."""
    return (1 + n) / sigma_b**2 - (n + 1)


def degrees_of_freedom(sigma_b: float, n: int) -> float:
    """d = θ + n + 1 of the MaxEnt law B ~ W_n(d, I/d) of mean I_n and dispersion ``sigma_b``, which
    solves Eqs. (Maxenmeas)–(invmomnt). Raises ModelDomainError where σ_B is not positive or so
    large that B has no density.
    """
    limit = largest_dispersion(n)
    if not 0 < sigma_b < limit:
        raise ModelDomainError(
            f"sigma_B must lie between 0 and {limit:.4g}, where B has a density",
            sigma_B=sigma_b,
            n=n,
        )
    return maxent_theta(sigma_b, n) + n + 1


def normalized_std(samples: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """(...,) normalised standard deviation, Eq. (NormStd), of ``samples`` (N, ..., n, n).

    sqrt(mean ‖B − E[B]‖_F² / ‖E[B]‖_F²) with a given ``expected`` E[B] (n, n): no degree of freedom
    is spent on a sample mean.
    """
    squared = ((samples - expected) ** 2).sum(axis=(-1, -2)).mean(axis=0)
    return np.sqrt(squared / (expected**2).sum())
