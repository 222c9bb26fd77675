"""The density of a normal deviation whose covariance is σ²I + C: of a step of the Gaussian forms, and of what is measured at rest."""

from __future__ import annotations

import numpy as np

from pipeline.errors import ModelDomainError

# what rounding may leave of asymmetry or of a negative eigenvalue, as a share of the largest entry or eigenvalue
TOLERANCE = 1e-12


def principal_axes(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances (3,), ascending and not negative, and axes (3, 3), in columns, of ``covariance`` (3, 3).

    Raises ModelDomainError for what is not finite, symmetric and positive semidefinite.
    """
    covariance = np.asarray(covariance, dtype=float)
    whole = covariance.shape == (3, 3) and np.all(np.isfinite(covariance))
    if not whole or np.abs(covariance - covariance.T).max() > TOLERANCE * np.abs(covariance).max():
        raise ModelDomainError("a covariance must be a finite symmetric 3 × 3 matrix", covariance=covariance.tolist())
    variances, axes = np.linalg.eigh(covariance)
    if variances[0] < -TOLERANCE * abs(variances[-1]):
        raise ModelDomainError("a covariance must be positive semidefinite", eigenvalues=variances.tolist())
    return np.maximum(variances, 0.0), axes


def normal_log_density(deviation: np.ndarray, variance: np.ndarray | float, covariance: np.ndarray) -> np.ndarray:
    """(...,) log density of ``deviation`` (..., 3) under N(0, σ²I + C), σ² = ``variance`` (...,) ≥ 0 and C = ``covariance`` (3, 3).

    All C + σ²I have the axes of C, so no matrix is factorised but C. Raises ModelDomainError where σ²I + C is singular: the law then
    has no density.
    """
    least, axes = principal_axes(covariance)
    variances = np.asarray(variance)[..., None] + least
    singular = ~(variances[..., 0] > TOLERANCE * variances[..., -1])
    if np.any(singular):
        raise ModelDomainError(
            f"the covariance is singular at {int(np.count_nonzero(singular))} of {singular.size} step(s), where the law has no density: "
            "give the covariance of the measurement noise",
            least_variance=float(variances.min()),
        )
    squared = (deviation @ axes) ** 2
    return -0.5 * (np.log(2 * np.pi * variances) + squared / variances).sum(axis=-1)
