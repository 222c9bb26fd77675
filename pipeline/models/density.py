"""Densities of a normal deviation: of one whose covariance is σ²I + C, as a step of the Gaussian
matrix model, and of one whose covariance differs from step to step.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.covariance import TOLERANCE, principal_axes


def normal_log_density(
    deviation: np.ndarray, variance: np.ndarray | float, covariance: np.ndarray
) -> np.ndarray:
    """(...,) log density of ``deviation`` (..., n) under N(0, σ²I + C), σ² = ``variance`` (...,) ≥
    0 and C = ``covariance`` (n, n).

    All C + σ²I have the axes of C, so no matrix is factorised but C. Raises ModelDomainError where
    σ²I + C is singular: the law then has no density.
    """
    least, axes = principal_axes(covariance)
    return axis_log_density((deviation @ axes) ** 2, variance, least)


def axis_log_density(
    squared: np.ndarray, variance: np.ndarray | float, least: np.ndarray
) -> np.ndarray:
    """What :func:`normal_log_density` gives of the ``squared`` (..., n) parts of a deviation along
    the axes of C, which has the variances ``least`` (n,) ascending; raises what it raises.
    """
    variances = np.asarray(variance)[..., None] + least
    singular = ~(variances[..., 0] > TOLERANCE * variances[..., -1])
    if np.any(singular):
        raise ModelDomainError(
            f"the covariance is singular at {int(np.count_nonzero(singular))} of {singular.size} "
            "step(s), where the law has no density: "
            "give the covariance of the measurement noise",
            least_variance=float(variances.min()),
        )
    return -0.5 * (np.log(2 * np.pi * variances) + squared / variances).sum(axis=-1)


def gaussian_log_density(residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(...,) natural log of N(``residual``; 0, ``covariance``), (..., n) in rad and (..., n, n) in
    rad²; in rad⁻ⁿ.

    Raises ModelDomainError where a covariance is singular: the law then has no density.
    """
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise ModelDomainError(
            "the covariance is singular at some step, where the law has no density: give the "
            "covariance of the measurement noise"
        ) from None
    white = np.linalg.solve(lower, residual[..., None])[..., 0]
    log_root = np.log(np.diagonal(lower, axis1=-2, axis2=-1)).sum(axis=-1)
    return -0.5 * (np.vecdot(white, white) + residual.shape[-1] * np.log(2 * np.pi)) - log_root
