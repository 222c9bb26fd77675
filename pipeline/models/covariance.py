"""Covariances of the joints: whether a matrix is one, its axes, and the root that draws need."""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ModelDomainError

# what rounding may leave of asymmetry or of a negative eigenvalue, as a share of the largest entry
# or eigenvalue
TOLERANCE = 1e-12


def principal_axes(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances (n,), ascending and not negative, and axes (n, n), in columns, of ``covariance``
    (n, n).

    Raises ModelDomainError for what is not finite, symmetric and positive semidefinite.
    """
    covariance = np.asarray(covariance, dtype=float)
    square = covariance.ndim == 2 and covariance.shape[0] == covariance.shape[1] > 0
    whole = square and np.all(np.isfinite(covariance))
    if not whole or np.abs(covariance - covariance.T).max() > TOLERANCE * np.abs(covariance).max():
        raise ModelDomainError(
            "a covariance must be a finite symmetric matrix", covariance=covariance.tolist()
        )
    variances, axes = np.linalg.eigh(covariance)
    if variances[0] < -TOLERANCE * abs(variances[-1]):
        raise ModelDomainError(
            "a covariance must be positive semidefinite", eigenvalues=variances.tolist()
        )
    return np.maximum(variances, 0.0), axes


def root(covariance: np.ndarray) -> np.ndarray:
    """(n, n) symmetric square root of ``covariance`` (n, n): unlike Cholesky's it exists for a
    singular covariance too.

    Raises ModelDomainError for what is not a covariance.
    """
    variances, axes = principal_axes(covariance)
    return (axes * np.sqrt(variances)) @ axes.T


def trace_factor(covariances: np.ndarray, trace: float) -> float:
    """Factor on ``covariances`` (..., n, n) in rad² that gives them a mean trace of ``trace`` rad².

    Raises ModelDomainError where they are zero throughout.
    """
    own = float(np.trace(covariances, axis1=-2, axis2=-1).mean())
    if not own > 0:
        raise ModelDomainError(
            "a model without noise at any step has no level that could be solved", trace_rad2=own
        )
    return trace / own


def without_measurement(covariance: np.ndarray, measurement: np.ndarray) -> tuple[np.ndarray, int]:
    """(n, n) what ``covariance`` holds beyond ``measurement`` (n, n), in rad², and along how many
    axes that is nothing.

    There the difference would be negative by chance, and is set to zero.
    """
    variances, axes = np.linalg.eigh(covariance - measurement)
    return (axes * np.maximum(variances, 0.0)) @ axes.T, int(np.count_nonzero(variances < 0))
