"""Noise whose covariance differs from step to step: the root that draws need, and the density."""

from __future__ import annotations

import numpy as np

from pipeline.errors import ModelDomainError
from pipeline.motion.density import principal_axes


def root(covariance: np.ndarray) -> np.ndarray:
    """(3, 3) symmetric square root of ``covariance`` (3, 3): unlike Cholesky's it exists for a singular covariance too.

    Raises ModelDomainError for what is not a covariance of the three joints.
    """
    if np.shape(covariance) != (3, 3):
        raise ModelDomainError("a covariance of the joints must be a 3 × 3 matrix", shape=np.shape(covariance))
    variances, axes = principal_axes(covariance)
    return (axes * np.sqrt(variances)) @ axes.T


def gaussian_log_density(residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) natural log of N(``residual``; 0, ``covariance``), (..., n) in rad and (..., n, n) in rad²; in rad⁻ⁿ.

    Raises ModelDomainError where a covariance is singular: the law then has no density.
    """
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise ModelDomainError(
            "the covariance is singular at some step, where the law has no density: give the covariance of the measurement noise"
        ) from None
    white = np.linalg.solve(lower, residual[..., None])[..., 0]
    log_root = np.log(np.diagonal(lower, axis1=-2, axis2=-1)).sum(axis=-1)
    return -0.5 * (np.vecdot(white, white) + residual.shape[-1] * np.log(2 * np.pi)) - log_root
