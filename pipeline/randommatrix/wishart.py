"""MaxEnt law B ~ W_n(d, I/d) of random matrices of mean I, with real degrees of freedom d."""

import numpy as np
from numpy import ndarray

from pipeline.core.errors import ModelDomainError


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
    """d = θ + n + 1 of the MaxEnt law B ~ W_n(d, I/d) (Definition 2) of mean I_n (Theorem 4) and
    dispersion ``sigma_b``, which solves Eqs. (Maxenmeas)–(invmomnt). The paper requires d ≥ n; here
    d > n − 1 is enough. Raises ModelDomainError for σ_B ≤ 0 and for a B without a density.
    """
    limit = largest_dispersion(n)
    if not 0 < sigma_b < limit:
        message = f"sigma_B must lie between 0 and {limit:.4g}, where B has a density"
        raise ModelDomainError(message, sigma_B=sigma_b, n=n)
    return maxent_theta(sigma_b, n) + n + 1


def normalized_std(samples: ndarray, expected: ndarray) -> ndarray:
    """(...,) normalised standard deviation sqrt(mean ‖B − E[B]‖_F² / ‖E[B]‖_F²), Eq. (NormStd), of
    ``samples`` B (N, ..., n, n) about ``expected`` E[B] (n, n), or (..., n, n).
    """
    squared = ((samples - expected) ** 2).sum(axis=(-1, -2)).mean(axis=0)
    return np.sqrt(squared / (expected**2).sum(axis=(-1, -2)))
